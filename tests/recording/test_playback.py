"""Playing a log: the frames that were written, each when its time has come."""

from dataclasses import replace

import numpy as np
import pytest
from test_estimate_log import a_frame, rollouts

from dirprim_filter import load_map, read_estimates, write_tracks
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates, Particles, TrackedFrame
from dirprim_filter.forecasting import Forecasts
from dirprim_filter.recording.errors import DamagedRecordingError
from dirprim_filter.recording.playback import Playback, paced
from dirprim_filter.recording.writer import EstimateWriter
from situations import tracks_of

N, STEP_NS = 30, 100_000_000


@pytest.fixture
def straight(tmp_path):
    """Two vehicles, east at 10 m/s and north at 5 m/s."""
    way = np.arange(N)[:, None] * [[[1.0, 0.0]], [[0.0, 0.5]]]
    tracks = tracks_of(way, track_id=[[1], [2]], direction=[[0.0], [np.pi / 2]], speed=[[10.0], [5.0]])
    write_tracks(tracks, tmp_path / "objects.mcap")
    return tmp_path / "objects.mcap"


@pytest.fixture
def tracked(straight, tmp_path):
    """The same as a tracker would have written it."""
    with EstimateWriter(tmp_path / "tracked.mcap", metadata={}) as log:
        for frame in Playback(straight):
            log.write(
                TrackedFrame(
                    time_ns=frame.time_ns,
                    detections=frame.detections,
                    estimates=frame.estimates,
                    particles=Particles.none(),
                )
            )
    return tmp_path / "tracked.mcap"


def test_objects_move_as_their_log_says(straight):
    frames = list(Playback(straight))
    assert [frame.time_ns for frame in frames] == [i * STEP_NS for i in range(N)]
    for frame in frames:
        assert (frame.estimates.direction_resultant == 1).all()
        np.testing.assert_allclose(frame.estimates.speed, [10.0, 5.0])
        np.testing.assert_allclose(frame.estimates.direction, [0.0, np.pi / 2])
        np.testing.assert_array_equal(frame.estimates.position, frame.detections.position)


def test_estimates_are_those_of_the_log_whole_in_part_and_damaged(tracked, straight):
    played = Estimates.concatenate([frame.estimates for frame in Playback(tracked)])
    expected = read_estimates(tracked)
    np.testing.assert_array_equal(played.time_ns, expected.time_ns)
    np.testing.assert_array_equal(played.position, expected.position)
    np.testing.assert_array_equal(played.direction, expected.direction)
    for path in (straight, tracked):
        frames = list(Playback(path, start_ns=5 * STEP_NS, end_ns=9 * STEP_NS))
        assert [frame.time_ns for frame in frames] == [i * STEP_NS for i in range(5, 9)]
    tracked.write_bytes(tracked.read_bytes()[:-30])
    playback = Playback(tracked)
    assert len(list(playback)) == N
    assert playback.losses.damage
    with pytest.raises(DamagedRecordingError):
        list(Playback(tracked, strict=True))


def test_a_run_plays_with_its_detections_what_they_were_assigned_to_its_forecasts_and_its_map(tmp_path, ring_map):
    """Far from the origin: what is drawn is relative to the scene's frame."""
    far, path, sent = np.array([680_123.0, 4_100_567.0]), tmp_path / "run.mcap", a_frame(0)
    estimates = replace(sent.estimates, position=sent.estimates.position + far)
    assigned = np.where(np.arange(len(sent.detections)) == 0, "7", "")
    frame = replace(sent, estimates=estimates, assigned=assigned)
    names, start, paths = [frame.names[0], "unknown"], estimates.position[:2], far + rollouts()[:2]
    with EstimateWriter(path, metadata={}) as log:
        log.write_map_scene(ring_map)
        log.write(frame)
        log.write(replace(frame, time_ns=STEP_NS, estimates=replace(estimates, time_ns=estimates.time_ns + STEP_NS)))
        log.write_forecast(Forecasts(STEP_NS, names, start, paths))
    playback = Playback(path)
    first, second = playback
    np.testing.assert_array_equal(first.detections.position, sent.detections.position)
    assert first.assigned.tolist() == assigned.tolist()
    assert playback.forecast(first) is None
    found = playback.forecast(second)
    assert found is not None
    assert found.track_id == names[:1]
    np.testing.assert_allclose(found.paths, paths[:1], atol=1e-6)
    np.testing.assert_array_equal(found.start, start[:1])
    np.testing.assert_array_equal(load_map(path).direction.weight, ring_map.direction.weight)


@pytest.mark.parametrize("rate", [0.5, 1.0, 4.0, float("inf")])
def test_each_frame_comes_when_its_time_has_come(rate):
    now, came = [100.0], []
    busy = {3: 0.31}  # the fourth frame takes the viewer long: the next comes late, those behind it in time again
    nothing = {
        "detections": Detections.none(), "estimates": Estimates.concatenate([]), "particles": Particles.none(),
    }  # fmt: skip
    frames = [TrackedFrame(time_ns=i * STEP_NS, **nothing) for i in range(10)]

    def sleep(seconds):
        now[0] += seconds

    for i, _ in enumerate(paced(frames, rate, clock=lambda: now[0], sleep=sleep)):
        came.append(now[0] - 100.0)
        now[0] += busy.get(i, 0.0)
    due = np.arange(10) * 0.1 / rate
    ready = came[3] + 0.31
    expected = np.where(np.arange(10) > 3, np.maximum(due, ready), due)
    np.testing.assert_allclose(came, expected, atol=1e-9)


def test_no_frame_is_waited_for_longer_than_the_clock_can_count():
    nothing = {
        "detections": Detections.none(), "estimates": Estimates.concatenate([]), "particles": Particles.none(),
    }  # fmt: skip
    frames = [TrackedFrame(time_ns=time_ns, **nothing) for time_ns in (0, 1 << 62)]
    waited = []
    assert len([*paced(frames, 1e-308, clock=lambda: 0.0, sleep=waited.append)]) == 2
    assert waited == [86_400.0]
