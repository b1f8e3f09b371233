"""What `EstimateWriter` writes: the estimates exactly, as ROS 2 messages too, and a log that plays back."""

import uuid
from dataclasses import replace

import numpy as np
import pytest
from google.protobuf.message import DecodeError
from mcap.reader import make_reader
from mcap_files import stock
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from dirprim_filter import load_map
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates, Particles, TrackedFrame
from dirprim_filter.forecasting import Forecasts
from dirprim_filter.recording import read_assigned, read_estimates, read_tracks
from dirprim_filter.recording.errors import DamagedRecordingError, NoTracksError
from dirprim_filter.recording.playback import Playback
from dirprim_filter.recording.schemas import ASSIGNMENTS_SCHEMA, ESTIMATES_SCHEMA
from dirprim_filter.recording.schemas.dirprim import decoded, encode_assignments, encode_estimates
from dirprim_filter.recording.topic_names import ROS_MESSAGES
from dirprim_filter.recording.writer import EstimateWriter

STEP = 100_000_000


def a_frame(time_ns, *, n=4):
    rng, n_particles = np.random.default_rng([0, time_ns % 1000]), 60
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
    return [m for _, _, m in stock(path, topic)]


def test_broken_estimates_are_refused():
    message = encode_estimates(a_frame(4).estimates, 4)
    for name in ("y", "covariance_xy", "direction", "log_evidence"):
        short = type(message)()
        short.CopyFrom(message)
        getattr(short, name).pop()
        with pytest.raises(DecodeError, match=f"{name}: expected 4 numbers, got 3"):
            decoded(ESTIMATES_SCHEMA, short.SerializeToString())
    message.speed[2] = np.nan
    with pytest.raises(DecodeError, match="speed: expected finite"):
        decoded(ESTIMATES_SCHEMA, message.SerializeToString())


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
    short = type(encode_assignments(found, 0))(track_id=["a"], x=[1], y=[1])
    with pytest.raises(DecodeError, match="columns: expected one length n"):
        decoded(ASSIGNMENTS_SCHEMA, short.SerializeToString())


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
    with pytest.raises(NoTracksError, match="/dirprim/tracks: holds results; `dirprim export` makes a table"):
        read_tracks(path)
    frames, later = ([a_frame(i * STEP, n=n) for i in range(10)] for n in (4, 2))
    with EstimateWriter(path, metadata={}, force=True) as log:
        for i, frame in enumerate(frames):
            log.write(frame)
            if i >= 7:
                log.write_smoothed(later[i - 7])  # .7 s late
        for frame in later[3:]:
            log.write_smoothed(frame)
    assert read_estimates(path) == Estimates.concatenate([frame.estimates for frame in frames])
    assert read_estimates(path, smoothed=True) == Estimates.concatenate([frame.estimates for frame in later])
    assert [m.log_time for m in messages(path, "/dirprim/smoothed/scene")] == [i * STEP for i in range(10)]


KNOWN = "0ab7cde0-1111-4222-8333-123456789abc"
SIZE = (4.25, 1.875, 1.5)


def frames():
    for k in range(1, 4):
        frame = a_frame(k * STEP)
        ids = np.array(["a", KNOWN, "7", "3/b"])
        size = np.array([SIZE, *[[np.nan] * 3] * 3])
        estimates = replace(
            frame.estimates, track_id=ids, existence=np.array([1.0, 0.5, 0.25, 0.0]),
            direction_resultant=np.array([1.0, 0.9, 0.2, 0.0]),
        )  # fmt: skip
        yield replace(frame, estimates=estimates, detections=replace(frame.detections, track_id=ids, size=size))


@pytest.fixture(scope="module", params=ROS_MESSAGES)
def written(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("written") / "out.mcap"
    with EstimateWriter(path, metadata={}, also_as=request.param) as log:
        for frame in frames():
            log.write(frame)
            log.write_smoothed(frame)
    return request.param, path


def read_by_mcap(path, topic):
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [message for *_, message in reader.iter_decoded_messages(topics=[topic])]


def read_by_rosbags(path, topic):
    found = stock(path, topic)
    schema = found[0][0]
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema.data.decode(), schema.name))
    assert {(schema.encoding, channel.message_encoding) for schema, channel, _ in found} == {("ros2msg", "cdr")}
    return [store.deserialize_cdr(message.data, schema.name) for *_, message in found]


@pytest.mark.parametrize("read", [read_by_mcap, read_by_rosbags])
@pytest.mark.parametrize("topic", ["/dirprim/tracks", "/dirprim/smoothed"])
def test_others_read_what_was_estimated(written, read, topic):
    form, path = written
    for message, frame in zip(read(path, f"{topic}/{form}"), frames(), strict=True):
        sent, stamp = frame.estimates, message.header.stamp
        assert (stamp.sec * 10**9 + stamp.nanosec, message.header.frame_id) == (frame.time_ns, "map")
        items = message.detections if form == "vision_msgs" else message.objects
        for i, (item, name) in enumerate(zip(items, sent.track_id.tolist(), strict=True)):
            if form == "vision_msgs":
                (result,) = item.results
                assert item.id == name
                pose, existence, size = result.pose, result.hypothesis.score, item.bbox.size
                assert item.bbox.center.position.x == pose.pose.position.x
            else:
                own = uuid.UUID(name) if name == KNOWN else uuid.uuid5(uuid.NAMESPACE_OID, name)
                assert bytes(item.object_id.uuid) == own.bytes
                moves = item.kinematics
                pose, existence, size = moves.pose_with_covariance, item.existence_probability, item.shape.dimensions
                assert moves.twist_with_covariance.twist.linear.x == sent.speed[i]
                assert moves.twist_with_covariance.covariance[0] == pytest.approx(sent.speed_std[i] ** 2)
                assert moves.orientation_availability == (2, 2, 0, 0)[i]
            assert (pose.pose.position.x, pose.pose.position.y) == tuple(sent.position[i])
            yaw = 2 * np.arctan2(pose.pose.orientation.z, pose.pose.orientation.w)
            assert np.cos(yaw - sent.direction[i]) == pytest.approx(1.0)
            np.testing.assert_array_equal(np.reshape(pose.covariance, (6, 6))[:2, :2], sent.covariance[i])
            assert existence == (1.0, 0.5, 0.25, 0.0)[i]
            if topic == "/dirprim/tracks":
                assert (size.x, size.y, size.z) == (SIZE if i == 0 else (0.0, 0.0, 0.0))  # unset, no placeholder


def test_our_own_reader_takes_them_for_tracks(written):
    form, path = written
    tracks = read_tracks(path, topics=f"/dirprim/tracks/{form}")
    sent = Estimates.concatenate([frame.estimates for frame in frames()])
    assert len(np.unique(tracks.track_id)) == 4
    np.testing.assert_array_equal(tracks.position, sent.position)
    if form == "autoware":
        np.testing.assert_allclose(tracks.speed, sent.speed)


def test_a_time_that_ros_cannot_hold_is_refused(tmp_path):
    log = EstimateWriter(tmp_path / "out.mcap", metadata={}, also_as="autoware")
    with pytest.raises(ValueError, match="as ROS 2 holds no others"), log:
        log.write(a_frame(2**31 * 10**9))


def test_a_run_plays_whole_in_part_and_damaged(tmp_path):
    path = tmp_path / "tracked.mcap"
    with EstimateWriter(path, metadata={}) as log:
        for i in range(10):
            log.write(a_frame(i * STEP))
    assert Estimates.concatenate([frame.estimates for frame in Playback(path)]) == read_estimates(path)
    assert [frame.time_ns for frame in Playback(path, start_ns=5 * STEP, end_ns=9 * STEP)] == [
        i * STEP for i in range(5, 9)
    ]
    path.write_bytes(path.read_bytes()[:-30])
    playback = Playback(path)
    assert len(list(playback)) == 10
    assert playback.losses.damage
    with pytest.raises(DamagedRecordingError):
        list(Playback(path, strict=True))


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
        log.write(replace(frame, time_ns=STEP, estimates=replace(estimates, time_ns=estimates.time_ns + STEP)))
        log.write_forecast(Forecasts(STEP, names, start, paths))
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
