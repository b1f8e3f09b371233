"""A tracker's log as frames: those that were written."""

from dataclasses import replace

import numpy as np
import pytest
from test_estimate_log import a_frame, rollouts

from dirprim_filter import load_map, read_estimates
from dirprim_filter.estimates import Estimates
from dirprim_filter.forecasting import Forecasts
from dirprim_filter.recording.errors import DamagedRecordingError
from dirprim_filter.recording.playback import Playback
from dirprim_filter.recording.writer import EstimateWriter

N, STEP_NS = 30, 100_000_000


@pytest.fixture
def tracked(tmp_path):
    """A run as a tracker writes it."""
    with EstimateWriter(tmp_path / "tracked.mcap", metadata={}) as log:
        for i in range(N):
            log.write(a_frame(i * STEP_NS))
    return tmp_path / "tracked.mcap"


def test_estimates_are_those_of_the_log_whole_in_part_and_damaged(tracked):
    played = Estimates.concatenate([frame.estimates for frame in Playback(tracked)])
    expected = read_estimates(tracked)
    np.testing.assert_array_equal(played.time_ns, expected.time_ns)
    np.testing.assert_array_equal(played.position, expected.position)
    np.testing.assert_array_equal(played.direction, expected.direction)
    frames = list(Playback(tracked, start_ns=5 * STEP_NS, end_ns=9 * STEP_NS))
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
