"""Estimates as ROS 2 messages: what mcap-ros2-support, rosbags and our own reader find is what was estimated."""

import uuid
from dataclasses import replace

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from test_estimate_log import STEP, a_frame

from dirprim_filter.recording import read_tracks
from dirprim_filter.recording.topic_names import ROS_MESSAGES
from dirprim_filter.recording.writer import EstimateWriter

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


@pytest.fixture(params=ROS_MESSAGES)
def written(request, tmp_path):
    path = tmp_path / "out.mcap"
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
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(topics=[topic]):
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            store = get_typestore(Stores.EMPTY)
            store.register(get_types_from_msg(schema.data.decode(), schema.name))
            yield store.deserialize_cdr(message.data, schema.name)


@pytest.mark.parametrize("read", [read_by_mcap, read_by_rosbags])
@pytest.mark.parametrize("topic", ["/dirprim/tracks", "/dirprim/smoothed"])
def test_others_read_what_was_estimated(written, read, topic):
    form, path = written
    for message, frame in zip(read(path, f"{topic}/{form}"), frames(), strict=True):
        sent, stamp = frame.estimates, message.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == frame.time_ns
        assert message.header.frame_id == "map"
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
    sent = [frame.estimates for frame in frames()]
    assert len(np.unique(tracks.track_id)) == 4
    np.testing.assert_array_equal(tracks.position, np.concatenate([one.position for one in sent]))
    if form == "autoware":
        np.testing.assert_allclose(tracks.speed, np.concatenate([one.speed for one in sent]))


def test_a_time_that_ros_cannot_hold_is_refused(tmp_path):
    late = 2**31 * 10**9
    frame = a_frame(late)
    with pytest.raises(ValueError, match="as ROS 2 holds no others"), EstimateWriter(
        tmp_path / "out.mcap", metadata={}, also_as="autoware"
    ) as log:  # fmt: skip
        log.write(frame)
