"""What `EstimateWriter` writes: the estimates exactly, and scenes that say the same to the eye."""

from dataclasses import replace

import numpy as np
import pytest
from google.protobuf.message import DecodeError
from mcap.reader import make_reader

from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates, Particles, TrackedFrame
from dirprim_filter.recording import read_assigned, read_estimates
from dirprim_filter.recording.errors import NoTracksError
from dirprim_filter.recording.schemas.dirprim import (
    decode_assignments,
    decode_estimates,
    encode_assignments,
    encode_estimates,
)
from dirprim_filter.recording.writer import EstimateWriter

COLUMNS = (
    "track_id", "time_ns", "position", "covariance", "direction", "direction_resultant", "speed", "speed_std",
    "effective_sample_size", "log_evidence",
)  # fmt: skip


STEP = 100_000_000


def a_frame(time_ns, *, n=4, n_particles=60, seed=0):
    rng = np.random.default_rng([seed, time_ns % 1000])
    root = rng.normal(size=(n, 2, 2))
    root[0] = 0.0  # a belief in one point
    estimates = Estimates(
        track_id=np.arange(n) + 10**12,
        time_ns=np.full(n, time_ns),
        position=rng.normal(scale=500.0, size=(n, 2)),
        covariance=root @ root.transpose(0, 2, 1),
        direction=rng.uniform(-np.pi, np.pi, n),
        direction_resultant=rng.random(n),
        speed=rng.gamma(2.0, 4.0, n),
        speed_std=rng.random(n),
        effective_sample_size=rng.uniform(1, n_particles, n),
        log_evidence=-rng.gamma(2.0, 4.0, n),
    )
    particles = Particles(
        position=1e6 + rng.normal(size=(n * n_particles, 2)),
        direction=rng.uniform(-np.pi, np.pi, n * n_particles),
        speed=rng.random(n * n_particles),
        weight=np.full(n * n_particles, 1 / n_particles),
        vehicle=np.repeat(np.arange(n), n_particles),
    )
    detections = Detections(track_id=estimates.track_id, time_ns=estimates.time_ns, position=estimates.position)
    return TrackedFrame(time_ns=time_ns, detections=detections, estimates=estimates, particles=particles)


def rollouts():
    """Of two vehicles, 60 each, that part as they go on: (2, 60, 10, 2) metres."""
    rng = np.random.default_rng(0)
    heading = np.cumsum(rng.normal(0.0, 0.1, (2, 60, 10)), axis=2)
    return np.cumsum(4.0 * np.stack([np.cos(heading), np.sin(heading)], axis=-1), axis=2)


def messages(path, topic):
    with path.open("rb") as file:
        return [m for _, _, m in make_reader(file, validate_crcs=True).iter_messages(topics=topic)]


def test_broken_estimates_are_refused():
    message = encode_estimates(a_frame(4).estimates, 4)
    for name in ("y", "covariance_xy", "direction", "log_evidence"):
        short = type(message)()
        short.CopyFrom(message)
        getattr(short, name).pop()
        with pytest.raises(DecodeError, match=f"{name}: expected 4 numbers, got 3"):
            decode_estimates(short.SerializeToString())
    message.speed[2] = np.nan
    with pytest.raises(DecodeError, match="speed: expected finite"):
        decode_estimates(message.SerializeToString())


def test_which_track_each_detection_was_assigned_to_comes_back(tmp_path):
    some, none = a_frame(STEP), a_frame(3 * STEP)
    named = np.array(["car", "", "2/track-1", "=1+1"])
    seen = replace(some.detections, track_id=["", "7", "2/x", "=x"], group=[0, 0, 2, 2], origin=(48.0, 11.0))
    some = replace(some, detections=seen, assigned=named, estimates=replace(some.estimates, origin=(48.0, 11.0)))
    silent = TrackedFrame(
        time_ns=2 * STEP, detections=Detections.none(), estimates=Estimates.none(), particles=Particles.none()
    )
    with EstimateWriter(tmp_path / "log.mcap", metadata={}) as log:
        for frame in (some, silent, replace(none, detections=replace(none.detections, origin=(48.0, 11.0)))):
            log.write(frame)
    found = read_assigned(tmp_path / "log.mcap")
    assert found[:4] == some.assignments
    assert found[4:].assigned.tolist() == [""] * 4
    assert len(messages(tmp_path / "log.mcap", "/dirprim/assigned")) == 3
    with pytest.raises(DecodeError, match="columns: expected one length n"):
        decode_assignments(type(encode_assignments(found, 0))(track_id=["a"], x=[1], y=[1]).SerializeToString())


def test_what_fails_while_a_frame_is_written_is_raised_by_the_next_call_or_at_the_end(tmp_path):
    right, wrong = a_frame(2 * STEP), replace(a_frame(STEP), time_ns=3 * STEP)  # estimates of another time
    taken = []

    def write_all(frames):
        with EstimateWriter(tmp_path / "a.mcap", metadata={}) as log:
            for frame in frames:
                log.write(frame)
                taken.append(frame)

    with pytest.raises(ValueError, match="expected all at"):
        write_all([right, wrong, right, right])
    assert len(taken) == 2
    with pytest.raises(ValueError, match="expected all at"):
        write_all([wrong])
    left = list(tmp_path.iterdir())
    assert [path.suffix for path in left] == [".partial"] * 2  # nothing that looks whole, and nothing thrown away


def test_particles_are_copied_before_the_tracker_moves_them(tmp_path):
    moving = Moving(a_frame(STEP).particles)
    with EstimateWriter(tmp_path / "a.mcap", metadata={}, particle_stride=1) as log:
        for k in range(1, 6):
            log.write(replace(a_frame(k * STEP), particles=moving))
            moving.is_gone = True
            moving = Moving(a_frame(STEP).particles)
    assert len(messages(tmp_path / "a.mcap", "/dirprim/particles")) == 5


class Moving:
    """Samples that are there only while their frame is written."""

    def __init__(self, samples):
        self.samples, self.is_gone = samples, False

    def __len__(self):
        return len(self.samples)

    def thinned(self, stride):
        assert not self.is_gone
        return self.samples.thinned(stride)


def test_smoothed_estimates_stand_beside_the_filters_and_come_back_bit_for_bit(tmp_path):
    path = tmp_path / "out.mcap"
    with EstimateWriter(path, metadata={}) as log:
        log.write(a_frame(0))
    with pytest.raises(NoTracksError, match="/dirprim/smoothed"):
        read_estimates(path, smoothed=True)
    frames = [a_frame(i * STEP) for i in range(40)]
    later = [a_frame(i * STEP, n=2) for i in range(40)]
    with EstimateWriter(path, metadata={}, force=True) as log:
        for i, frame in enumerate(frames):
            log.write(frame)
            if i >= 30:
                log.write_smoothed(later[i - 30])  # three seconds late
        for frame in later[10:]:
            log.write_smoothed(frame)
    for found, wanted in ((read_estimates(path), frames), (read_estimates(path, smoothed=True), later)):
        for name in COLUMNS:
            np.testing.assert_array_equal(
                getattr(found, name), np.concatenate([getattr(frame.estimates, name) for frame in wanted]), name
            )
    assert [m.log_time for m in messages(path, "/dirprim/smoothed/scene")] == [i * STEP for i in range(40)]
