"""Courses are those of the ways that vehicles go, in whichever axes their drivers put the twist."""

import numpy as np
import pytest
from foxglove_schemas_protobuf.Odometry_pb2 import Odometry
from mcap_files import write_protobuf_log
from ros_messages import header, write_ros2_log
from test_ros2_schemas import START_NS, STEP_NS, ZEROS, carla, point, quaternion, tracked

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
    x, y = velocity if axes == "frame" else (SPEED, 0.0)
    return {"linear": point(x, y, 0), "angular": point(0, 0, 0)}


def ros_odometry(stamp, place, yaw, v, child):
    pose = {"position": point(*place, 0), "orientation": quaternion(0, 0, yaw)}
    return "nav_msgs/msg/Odometry", {
        "header": header(stamp), "child_frame_id": child, "pose": {"pose": pose, "covariance": ZEROS},
        "twist": {"twist": v, "covariance": ZEROS},
    }  # fmt: skip


def autoware(stamp, place, yaw, v, _):
    one = tracked(0, 0)
    one["kinematics"]["pose_with_covariance"]["pose"] = {
        "position": point(*place, 0), "orientation": quaternion(0, 0, yaw)
    }  # fmt: skip
    one["kinematics"]["twist_with_covariance"]["twist"] = v
    return "autoware_perception_msgs/msg/TrackedObjects", {"header": header(stamp), "objects": [one]}


def derived(stamp, place, yaw, v, _):
    one = carla(0, 0) | {"twist": v, "header": header(stamp)}
    one["pose"] = {"position": point(*place, 0), "orientation": quaternion(0, 0, yaw)}
    return "derived_object_msgs/msg/ObjectArray", {"header": header(stamp), "objects": [one]}


def log_of(path, make, axes, drive, child="base_link"):
    messages = []
    for k, (place, yaw, velocity) in enumerate(zip(*drive, strict=True)):
        stamp = START_NS + k * STEP_NS
        messages.append(("/car", stamp, *make(stamp, place, yaw, twist(yaw, velocity, axes), child)))
    return write_ros2_log(path, messages)


def apart(tracks, heading):
    return np.abs(np.angle(np.exp(1j * (tracks.direction - heading))))


MAKERS = {"odometry": (ros_odometry, "body"), "autoware": (autoware, "body"), "derived": (derived, "frame")}


@pytest.mark.parametrize("made", MAKERS)
@pytest.mark.parametrize("axes", ["body", "frame"])
@pytest.mark.parametrize("drive", [(0.3, 0.4), (0.0, 2.0), (0.0, 0.0)])
def test_courses_go_where_positions_do(tmp_path, caplog, made, axes, drive):
    """Whether the twist is in the axes of the schema or in the others; who drives east, has the same in both."""
    make, by_schema = MAKERS[made]
    drive = moving(*drive)
    path = log_of(tmp_path / "log.mcap", make, axes, drive)
    tracks = read_tracks(path)
    assert apart(tracks, drive[1]).max() < 1e-6
    np.testing.assert_allclose(tracks.speed, SPEED)
    streamed = [frame.direction[0] for frame in stream_detections(path, motion=True)]
    np.testing.assert_array_equal(streamed, tracks.direction)
    is_reported = axes != by_schema and drive[1].any()
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
    way = moving(0.0)[0]
    heading = np.full(N, np.pi / 2)
    messages = [
        ("/ferry", START_NS + k * STEP_NS,
         *ros_odometry(START_NS + k * STEP_NS, way[k], heading[k],
                       {"linear": point(0, -SPEED, 0), "angular": point(0, 0, 0)}, "base_link"))
        for k in range(N)
    ]  # fmt: skip
    assert apart(read_tracks(write_ros2_log(tmp_path / "log.mcap", messages)), 0.0).max() < 1e-6
    assert "axes" not in caplog.text


def test_foxgloves_odometry_is_judged_alike(tmp_path, caplog):
    drive, messages = moving(0.3, 0.4), []
    for k, (place, yaw, velocity) in enumerate(zip(*drive, strict=True)):
        one = Odometry(frame_id="map", body_frame_id="base_link")
        one.timestamp.FromNanoseconds(START_NS + k * STEP_NS)
        one.pose.position.x, one.pose.position.y = place
        one.pose.orientation.z, one.pose.orientation.w = np.sin(yaw / 2), np.cos(yaw / 2)
        one.linear_velocity.x, one.linear_velocity.y = velocity
        messages.append(("/car", START_NS + k * STEP_NS, one))
    assert apart(read_tracks(write_protobuf_log(tmp_path / "log.mcap", messages)), drive[1]).max() < 1e-6
    assert "the twist of /car is not in the axes" in caplog.text
