"""Stamps that cannot be are left out and counted; honest clocks, whatever they do, lose nothing."""

import numpy as np
import pytest
from mcap_files import write_log

from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.losses import BACKWARD, STRAY, UNTIMED
from dirprim_filter.recording.objects import observations
from dirprim_filter.recording.objects.stamps import _TopicStamps
from dirprim_filter.recording.reader import FieldMapping, read_track_logs, stream_detections

N, STEP_NS, START_NS = 200, 100_000_000, 1_700_000_000_000_000_000
SECOND_NS, HOUR_NS, YEAR_NS = 10**9, 3600 * 10**9, 365 * 86_400 * 10**9
LOG_NS = START_NS + STEP_NS * np.arange(N)
FIELDS = FieldMapping.parse("id=.id,x=.x,y=.y,time=.t")


def log_of(folder, stamp_ns, *, log_ns=LOG_NS, topics=("/objects",), name="log.mcap"):
    """One vehicle on each topic at 5 m/s; messages take turns."""
    sent = [
        (topics[i % len(topics)], int(at), b'{"id": "a", "x": %f, "y": 0, "t": %d}' % (0.5 * i, stamp))
        for i, (at, stamp) in enumerate(zip(log_ns, stamp_ns, strict=True))
    ]
    return write_log(folder / name, sent, ("Object", "jsonschema", b'{"type": "object"}'), "json")


def streamed(path, **options):
    """The times of all detections, and what was left out."""
    stream = stream_detections(path, mapping=FIELDS, **options)
    return [int(frame.time_ns[0]) for frame in stream for _ in frame.time_ns], dict(stream.losses.dropped)


def wrong(at, by_ns):
    stamps = LOG_NS.copy()
    stamps[at] += by_ns
    return stamps


RNG = np.random.default_rng(0)
WRONG = {
    "a year ahead": (wrong([10], YEAR_NS), [10]),
    "an hour back": (wrong([10, 40, 41, 150], -HOUR_NS), [10, 40, 41, 150]),
    "the first": (wrong([0], YEAR_NS), [0]),
    "the first two, differently": (wrong([0, 1], np.array([YEAR_NS, -HOUR_NS])), [0, 1]),
    "the last": (wrong([N - 1], 60 * SECOND_NS), [N - 1]),
    "one in twenty, all by an hour": (wrong(slice(7, None, 20), HOUR_NS), [*range(7, N, 20)]),
    "ten in a row": (wrong(slice(60, 70), 30 * SECOND_NS), [*range(60, 70)]),
    "negative": (wrong([50], -START_NS - 7 * 10**9), [50]),
    "random": (wrong([3, 77, 140], RNG.integers(-START_NS, 7 * 10**18, 3)), [3, 77, 140]),
    "in simulated time": (wrong([50], YEAR_NS) - START_NS, [50]),
}


@pytest.mark.parametrize(("stamps", "bad"), WRONG.values(), ids=WRONG)
def test_stamps_far_from_the_usual_offset_are_left_out_and_the_others_are_kept(tmp_path, stamps, bad):
    path, good = log_of(tmp_path, stamps), np.delete(stamps, bad)
    assert streamed(path) == (good.tolist(), {STRAY: len(bad)})
    read = read_track_logs(path, mapping=FIELDS)
    assert (read.tracks.time_ns.tolist(), dict(read.losses.dropped)) == (good.tolist(), {STRAY: len(bad)})
    assert streamed(path, time_source="log") == (LOG_NS.tolist(), {})


LATE = np.where(np.arange(N) % 2, 0, 20 * SECOND_NS)
RARELY_LATE = np.where(np.arange(N) % 3, 0, 15 * SECOND_NS)
HONEST = {
    "another epoch": LOG_NS - START_NS,
    "drift": LOG_NS + np.arange(N) * 30_000_000,
    "a leap of 18 s": LOG_NS - np.where(np.arange(N) < N // 2, 0, 18 * SECOND_NS),
    "a clock that is set": LOG_NS - np.where(np.arange(N) < N // 2, 0, START_NS),
    "two sensors, one 20 s late": LOG_NS - LATE,
    "another, a third of the rows": LOG_NS - RARELY_LATE,
    "swapped": wrong([20, 21, 90, 91], STEP_NS * np.array([1, -1, 1, -1])),
    "ten times as fast": START_NS + (LOG_NS - START_NS) * 10,
    "delays of minutes": LOG_NS - RNG.integers(0, 300 * SECOND_NS, N),
    **{f"simulated, {pace} as fast": np.int64((LOG_NS - START_NS) * pace) + 1 for pace in (0.1, 0.5, 2.0, 10.0)},
}


@pytest.mark.parametrize("stamps", HONEST.values(), ids=HONEST)
def test_honest_clocks_lose_nothing(tmp_path, stamps):
    stamps = stamps + np.arange(N) % 7 * 1000 + np.arange(N) // 7  # no two alike
    assert streamed(log_of(tmp_path, stamps)) == (np.sort(stamps).tolist(), {})


@pytest.mark.parametrize("every_s", [0.1, 60.0, 3600.0])
def test_log_times_that_say_nothing_judge_no_stamp(tmp_path, every_s):
    """A converter gives all its messages one log time, or that of the conversion."""
    stamps = START_NS + (np.arange(N) * every_s * 1e9).astype(np.int64)
    for log_ns in (np.full(N, 5), START_NS + np.arange(N)):
        assert streamed(log_of(tmp_path, stamps, log_ns=log_ns)) == (stamps.tolist(), {})
    for few in (1, 2, 3, 4):
        assert streamed(log_of(tmp_path, stamps[:few], log_ns=np.full(few, 5))) == (stamps[:few].tolist(), {})


OF_B = np.arange(N) % 2 == 1
CLOCKS = {
    "simulated, and one stamp of /a a year ahead": (wrong([30], YEAR_NS) - START_NS * OF_B, 1_700_000_000),
    "simulated, and of /a none, so that log time counts": (np.where(OF_B, LOG_NS - START_NS, 0), 1_700_000_000),
    "of /a none": (np.where(OF_B, LOG_NS, 0), None),
    "as late as sensors are": (LOG_NS - 2 * SECOND_NS * OF_B, None),
    "never set": (LOG_NS - 5 * SECOND_NS * OF_B, 5),
}


@pytest.mark.parametrize(("stamps", "apart_s"), CLOCKS.values(), ids=CLOCKS)
def test_topics_have_clocks_of_their_own_and_such_that_differ_are_reported(tmp_path, caplog, stamps, apart_s):
    times, dropped = streamed(log_of(tmp_path, stamps, topics=("/a", "/b")), topics="/[ab]")
    is_stray = stamps > LOG_NS
    expected = np.sort(np.where(stamps == 0, LOG_NS, stamps)[~is_stray])
    assert (times, dropped) == (expected.tolist(), {STRAY: 1} if is_stray.any() else {})
    assert caplog.text.count("ahead of those") == (apart_s is not None)
    assert apart_s is None or f"times of /a are {apart_s} s ahead of those of /b" in caplog.text


def test_stamps_that_were_not_set_or_do_not_fit_are_counted_as_such(tmp_path):
    stamps = LOG_NS.astype(object)
    stamps[[5, 60]], stamps[100] = 0, 1 << 63
    times, dropped = streamed(log_of(tmp_path, stamps))
    assert (len(times), dropped) == (N - 3, {UNTIMED: 3})


def test_rows_too_late_to_be_put_in_order_are_counted(tmp_path, monkeypatch):
    stamps = LOG_NS - np.where(np.arange(N) % 2, 0, 5 * SECOND_NS)
    monkeypatch.setattr(
        observations, "batches", lambda columns, *_, **__: (b[i : i + 4] for b in columns for i in range(0, len(b), 4))
    )
    path = log_of(tmp_path, stamps + np.arange(N) % 2)
    assert len(streamed(path)[0]) == N
    monkeypatch.setattr(observations, "HELD_BYTES", 1 << 12)
    times, dropped = streamed(path)
    assert (dropped, times) == ({BACKWARD: N - len(times)}, sorted(times))


@pytest.mark.parametrize("n_at_once", [1, 3, 200])
@pytest.mark.parametrize("stamps", [*HONEST.values(), *(of for of, _ in WRONG.values())])
def test_verdicts_do_not_depend_on_how_many_stamps_come_at_once(stamps, n_at_once):
    """What is open waits for others; nothing is judged twice."""
    offset_s = (stamps - LOG_NS) * 1e-9
    judged, waiting = np.full(N, -1), np.empty(0, np.int64)
    topic = _TopicStamps()
    for begin in range(0, N, n_at_once):
        asked = np.r_[waiting, begin : min(begin + n_at_once, N)]
        usual, is_open = topic.judge(offset_s[asked], is_last=False)
        judged[asked[~is_open]], waiting = usual[~is_open], asked[is_open]
        assert waiting.size <= 50
    judged[waiting] = topic.judge(offset_s[waiting], is_last=True)[0]
    at_once = _TopicStamps().judge(offset_s, is_last=True)[0]
    assert (judged != at_once).sum() <= 2


UNITS = {
    "microseconds": LOG_NS // 1000,
    "milliseconds": LOG_NS // 10**6,
    "seconds": LOG_NS // 10**9,
    "milliseconds from the start": (LOG_NS - START_NS) // 10**6 + 1,
    "milliseconds for seconds": (LOG_NS - START_NS) * 1000 + 1,
}


@pytest.mark.parametrize(("unit", "stamps"), UNITS.items(), ids=UNITS)
@pytest.mark.parametrize("n", [N, 60])
def test_stamps_of_another_unit_end_tracking_and_learning_alike(tmp_path, unit, stamps, n):
    path = log_of(tmp_path, stamps[:n], log_ns=LOG_NS[:n])
    for read in (streamed, lambda path: read_track_logs(path, mapping=FIELDS)):
        with pytest.raises(RecordingError, match=f"stamps of /objects run .* are they {unit.split()[0]}"):
            read(path)
    assert streamed(path, time_source="log")[0] == LOG_NS[:n].tolist()


@pytest.mark.parametrize("factor", [1000, 10**6])
def test_log_times_of_a_fast_conversion_say_nothing_of_units(tmp_path, factor):
    assert streamed(log_of(tmp_path, LOG_NS, log_ns=START_NS + (LOG_NS - START_NS) // factor)) == (LOG_NS.tolist(), {})
