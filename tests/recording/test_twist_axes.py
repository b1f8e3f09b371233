"""Courses are those of the ways that vehicles go, in whichever axes their drivers put the twist."""

import numpy as np
import pytest
from foxglove_schemas_protobuf.Odometry_pb2 import Odometry
from google.protobuf.json_format import ParseDict
from mcap_files import write_protobuf_log
from ros_messages import header, write_ros2_log
from test_ros2_schemas import START_NS, STEP_NS, carla, point, quaternion, tracked

from dirprim_filter.recording.reader import read_tracks, stream_detections

N = 60
SPEED = 7.0


def moving(rate, yaw=0.0):
    """Place, heading and velocity at each time of a vehicle that turns at a rate, and drives where it looks."""
    time_s = np.arange(N) * STEP_NS * 1e-9
    heading = yaw + rate * time_s
    velocity = SPEED * np.column_stack([np.cos(heading), np.sin(heading)])
    way = np.cumsum(velocity, axis=0) * STEP_NS * 1e-9
    return way - way[0], heading, velocity


def twist(heading, velocity, axes):
    x, y = {"frame": velocity, "body": (SPEED, 0.0), "sideways": (0.0, -SPEED)}[axes]
    return {"linear": point(x, y, 0), "angular": point(0, 0, 0)}


def ros_odometry(stamp, pose, v, child):
    return "nav_msgs/msg/Odometry", {
        "header": header(stamp), "child_frame_id": child, "pose": {"pose": pose}, "twist": {"twist": v},
    }  # fmt: skip


def odometry(stamp, pose, v, child):
    """Foxglove's."""
    one = ParseDict(
        {"frame_id": "map", "body_frame_id": child, "pose": pose, "linear_velocity": v["linear"]}, Odometry()
    )
    one.timestamp.FromNanoseconds(stamp)
    return (one,)


def autoware(stamp, pose, v, _):
    one = tracked(0, 0)
    one["kinematics"]["pose_with_covariance"]["pose"] = pose
    one["kinematics"]["twist_with_covariance"]["twist"] = v
    return "autoware_perception_msgs/msg/TrackedObjects", {"header": header(stamp), "objects": [one]}


def derived(stamp, pose, v, _):
    one = carla(0, 0) | {"twist": v, "header": header(stamp), "pose": pose}
    return "derived_object_msgs/msg/ObjectArray", {"header": header(stamp), "objects": [one]}


def log_of(path, make, axes, drive, child="base_link"):
    messages = []
    for k, (place, yaw, velocity) in enumerate(zip(*drive, strict=True)):
        stamp, pose = START_NS + k * STEP_NS, {"position": point(*place, 0), "orientation": quaternion(0, 0, yaw)}
        messages.append(("/car", stamp, *make(stamp, pose, twist(yaw, velocity, axes), child)))
    return (write_protobuf_log if make is odometry else write_ros2_log)(path, messages)


def apart(tracks, heading):
    return np.abs(np.angle(np.exp(1j * (tracks.direction - heading))))


MAKERS = {ros_odometry: "body", odometry: "body", autoware: "body", derived: "frame"}


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("axes", ["body", "frame"])
@pytest.mark.parametrize("drive", [(0.3, 0.4), (0.0, 2.0), (0.0, 0.0)])
def test_courses_go_where_positions_do(tmp_path, caplog, make, axes, drive):
    """Whether the twist is in the axes of the schema or in the others; who drives east, has the same in both."""
    drive = moving(*drive)
    path = log_of(tmp_path / "log.mcap", make, axes, drive)
    tracks = read_tracks(path)
    assert apart(tracks, drive[1]).max() < 1e-6
    np.testing.assert_allclose(tracks.speed, SPEED)
    streamed = [frame.direction[0] for frame in stream_detections(path, motion=True)]
    np.testing.assert_array_equal(streamed, tracks.direction)
    is_reported = axes != MAKERS[make] and drive[1].any()
    assert caplog.text.count("the twist of /car is not in the axes") == (2 if is_reported else 0)


@pytest.mark.parametrize(("axes", "is_reported"), [("frame", False), ("body", True)])
def test_a_twist_in_the_frame_that_positions_are_in_needs_no_turn(tmp_path, caplog, axes, is_reported):
    """By the message's own definition; a driver that names the frame but means the body is found by its way."""
    drive = moving(0.3, 0.4)
    path = log_of(tmp_path / "log.mcap", ros_odometry, axes, drive, child="/map")
    assert apart(read_tracks(path), drive[1]).max() < 1e-6
    assert ("the twist of /car" in caplog.text) == is_reported


def test_a_body_that_goes_sideways_is_left_as_it_says(tmp_path, caplog):
    """A ferry that looks north and goes east: neither the heading nor a wrong guess of axes moves its course."""
    way, _, velocity = moving(0.0)
    path = log_of(tmp_path / "log.mcap", ros_odometry, "sideways", (way, np.full(N, np.pi / 2), velocity))
    assert apart(read_tracks(path), 0.0).max() < 1e-6
    assert "axes" not in caplog.text
