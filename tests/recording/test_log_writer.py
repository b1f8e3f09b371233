"""What `write_tracks` writes reads back exactly; Ctrl-C or a kill at any moment costs nothing that was handed over."""

import hashlib
import os
import signal
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_files import stock

from dirprim_filter.detections import Detections
from dirprim_filter.recording import read_tracks
from dirprim_filter.recording.container.mcap_writer import uninterrupted
from dirprim_filter.recording.container.recovery import recover
from dirprim_filter.recording.foxglove.elements import scene_transform
from dirprim_filter.recording.log_writer import LogWriter
from dirprim_filter.recording.scan import scan
from dirprim_filter.recording.writer import write_tracks
from dirprim_filter.tracks import Tracks

NAMES = ["a", "Ünïcode", "07", "a/b", "-"]


def crossing(vehicles):
    """200 instants of some of the vehicles; numbers of many magnitudes and at the edges of intervals."""
    rng = np.random.default_rng(5)
    instant, vehicle = np.nonzero(rng.random((200, len(vehicles))) < 0.6)
    n = len(instant)
    return Tracks(
        track_id=np.asarray(vehicles)[vehicle],
        time_ns=1_700_000_000_000_000_001 + instant * 33_333_333,
        position=rng.normal(size=(n, 2)) * 10.0 ** rng.uniform(-9, 6, (n, 1)),
        direction=np.where(rng.random(n) < 0.1, np.pi, rng.uniform(-np.pi, np.pi, n)),
        speed=np.where(rng.random(n) < 0.1, 0.0, rng.gamma(2.0, 5.0, n)),
        group=rng.integers(-(10**17), 10**17, n),
        heading=np.where(rng.random(n) < 0.2, np.nan, rng.uniform(-np.pi, np.pi, n)),
        size=np.where(rng.random((n, 3)) < 0.2, np.nan, rng.gamma(2.0, size=(n, 3))),
    )


@pytest.mark.parametrize("vehicles", [[3, -7, 10**17, 0, 12], NAMES])
def test_tracks_read_back_equal(tmp_path, vehicles):
    tracks = crossing(vehicles)
    for sent in (tracks, replace(tracks, heading=[], size=np.full((len(tracks), 3), np.nan))):
        write_tracks(sent, tmp_path / "a.mcap", detections=Detections.of(sent), force=True)
        assert read_tracks(tmp_path / "a.mcap") == sent


def test_the_same_tracks_give_the_same_bytes_and_a_record_names_producer_and_source(tmp_path):
    digests = []
    for name, vehicles in (("a", NAMES), ("b", NAMES), ("c", NAMES[1:])):
        write_tracks(crossing(vehicles), tmp_path / name, metadata={"source": "x.csv"})
        digests.append(hashlib.sha256((tmp_path / name).read_bytes()).digest())
    assert digests[0] == digests[1] != digests[2]
    with (tmp_path / "a").open("rb") as file:
        (record,) = make_reader(file).iter_metadata()
    assert record.name == "dirprim"
    assert record.metadata.items() >= {"producer": "dirprim-filter", "source": "x.csv"}.items()
    assert "version" in record.metadata


def test_a_negative_time_is_refused_and_nothing_stays(tmp_path):
    tracks = crossing(NAMES)
    early = replace(tracks, time_ns=tracks.time_ns - tracks.time_ns[50])
    with pytest.raises(ValueError, match=r"a\.mcap: expected times from 0 ns on"):
        write_tracks(early, tmp_path / "a.mcap")
    assert list(tmp_path.iterdir()) == []


def test_after_a_kill_all_but_the_last_chunk_is_in_the_partial_file(tmp_path):
    """What stands on the disk at any moment is what a kill would leave."""
    with LogWriter(tmp_path / "a.mcap", metadata={}, max_chunk_ns=1_000_000_000) as log:
        for time_ns in range(0, 10_000_000_000, 100_000_000):
            log.write("/tf", scene_transform(time_ns, np.zeros(2)), time_ns)
        (partial,) = tmp_path.glob("a.mcap.*")
        with scan(partial) as left:
            assert [m.log_time_ns for m in left] == list(range(0, 9_900_000_000, 100_000_000))
            assert left.damage


N = 9
N_IN_CHUNK = 4


class Interrupt:
    """Sends SIGINT when so many lines of the writer's modules have run; None: never."""

    MODULES = ("log_writer.py", "mcap_writer.py", "writer.py")

    def __init__(self, after):
        self.after = after
        self.lines = 0

    def __call__(self, frame, event, _):
        if Path(frame.f_code.co_filename).name not in self.MODULES:
            return None
        if event == "line":
            self.lines += 1
            if self.lines == self.after:
                signal.raise_signal(signal.SIGINT)
        return self


def write(path, *, keep, interrupt):
    """A log of N instants in chunks of four. -> how many were handed over before the interrupt."""
    handed_over = 0
    before = sys.gettrace()
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
    try:
        with LogWriter(path, metadata={}, max_chunk_ns=N_IN_CHUNK + 1, keep_when_interrupted=keep) as log:
            sys.settrace(interrupt)
            for time_ns in range(N):
                log.write("/tf", scene_transform(time_ns, np.zeros(2)), time_ns)
                handed_over += 1
    except KeyboardInterrupt:
        pass
    finally:
        sys.settrace(before)
        signal.signal(signal.SIGINT, handler)
    return handed_over


@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")  # of the one line that nothing can protect
@pytest.mark.parametrize("keep", [True, False])
def test_an_interrupt_at_any_line_costs_nothing_that_was_handed_over(tmp_path, keep):
    total = Interrupt(None)
    assert write(tmp_path / "whole.mcap", keep=keep, interrupt=total) == N
    assert total.lines > 200
    n_kept = set()
    for after in range(1, total.lines + 1, 13):  # a prime, so that at each instant other lines are hit
        path = tmp_path / f"{after}.mcap"
        handed_over = write(path, keep=keep, interrupt=Interrupt(after))
        if not path.exists() and handed_over == N:  # behind the body, before the end could begin: as after a kill
            (left,) = tmp_path.glob(f"{path.name}.*.partial")
            assert recover(left, path).saved == N - N % N_IN_CHUNK
            continue
        if not path.exists() and not keep:
            continue
        times = [message.log_time for _, _, message in stock(path)]
        assert times == list(range(len(times)))
        assert handed_over <= len(times) <= handed_over + 1
        assert keep or len(times) == N
        n_kept.add(len(times))
    assert n_kept >= (set(range(N + 1)) if keep else {N})


def test_what_a_process_of_the_same_number_left_is_kept(tmp_path):
    path = tmp_path / "a.mcap"
    left = [tmp_path / f"a.mcap.{os.getpid()}{number}.partial" for number in ("", ".2")]
    with LogWriter(tmp_path / "b.mcap", metadata={}) as log:
        log.write("/tf", scene_transform(1, np.zeros(2)), 1)
    for one in left:
        one.write_bytes((tmp_path / "b.mcap").read_bytes()[:-40])  # as a kill leaves it
    with LogWriter(path, metadata={}, force=True) as first, LogWriter(path, metadata={}) as second:
        for time_ns, log in enumerate((first, second)):
            log.write("/tf", scene_transform(time_ns, np.zeros(2)), time_ns)
    assert sorted(tmp_path.iterdir()) == sorted([path, tmp_path / "b.mcap", *left])
    for one in left:
        assert recover(one, one.with_suffix(".mcap")).saved == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_either_signal_waits_until_the_body_is_done(number):
    done = []
    before = signal.signal(number, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), uninterrupted():
            done.append(signal.raise_signal(number))
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, before)
    assert done
