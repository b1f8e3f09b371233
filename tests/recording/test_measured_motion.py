"""What a sensor measures besides the place reaches the stream: motion in whichever axes it is put, errors, names."""

import numpy as np
import pytest
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Odometry_pb2 import Odometry
from google.protobuf.json_format import ParseDict
from mcap_files import detections, json_log, scene, transform, write_protobuf_log
from ros_messages import header, point, quaternion, write_ros2_log
from scipy.spatial.transform import Rotation
from test_ros2_schemas import ARRAYS, START_NS, STEP_NS, carla, tracked

from dirprim_filter import write_tracks
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.recording.losses import REPEATED
from dirprim_filter.recording.reader import FieldMapping, read_tracks, stream_detections
from dirprim_filter.recording.schemas import decoders as decoding
from dirprim_filter.recording.schemas import dirprim_pb2
from situations import tracks_of

N = 12


def seen(*, named=True):
    """Of two vehicles, one measured whole, the other's position alone."""
    rng = np.random.default_rng(2)
    whole = np.tile([True, False], N)
    root = rng.normal(size=(2 * N, 2, 2))
    covariance = root @ root.transpose(0, 2, 1)
    covariance[:, 0, 1] = covariance[:, 1, 0]
    return Detections(
        track_id=np.where(whole, "a", "b") if named else np.full(2 * N, NO_ID),
        time_ns=np.repeat(np.arange(N) * 100_000_000, 2),
        position=rng.normal(scale=100.0, size=(2 * N, 2)),
        direction=np.where(whole, rng.uniform(-np.pi, np.pi, 2 * N), np.nan),
        speed=np.where(whole, rng.gamma(2.0, 5.0, 2 * N), np.nan),
        covariance=np.where(whole[:, None, None], covariance, np.nan),
        size=np.where(whole[:, None], [4.25, 1.875, 1.5], np.nan),
    )


@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize("batch", [1, 3, 1 << 14])
def test_what_was_measured_reads_back_to_the_last_bit(tmp_path, monkeypatch, named, batch):
    monkeypatch.setattr(decoding, "BATCH_MESSAGES", batch)
    sent, path = seen(named=named), tmp_path / "log.mcap"
    write_tracks(tracks_of(np.zeros((1, N, 2))), path, detections=sent)
    stream = stream_detections(path, motion=True)
    frames = list(stream)
    assert [len(frame) for frame in frames] == [2] * N
    assert Detections.concatenate(frames) == sent
    assert stream.losses.dropped == {}
    unasked = detections(path)
    assert np.isnan([unasked.direction, unasked.speed]).all()  # measurements on request only


@pytest.mark.parametrize("batch", [1, 2, 3, 1 << 14])
def test_an_instant_may_come_in_several_batches(tmp_path, monkeypatch, batch):
    monkeypatch.setattr(decoding, "BATCH_MESSAGES", batch)
    messages = [
        (topic, time_ns, scene([(name, float(time_ns), 0.0), *[("both", place, 0.0)] * 2, ("", place, 0.0)]))
        for time_ns in (10, 20)
        for topic, name, place in (("/left", "l", 1.0), ("/mid", "m", 2.0), ("/right", "r", 3.0))
    ]
    stream = stream_detections(write_protobuf_log(tmp_path / "log.mcap", messages), topics="/.*")
    frames = list(stream)
    assert [frame.track_id.tolist() for frame in frames] == [
        ["/left/l", "/left/both", "", "/mid/m", "/mid/both", "", "/right/r", "/right/both", ""]
    ] * 2
    assert [frame.position[1, 0] for frame in frames] == [1.0, 1.0]
    assert stream.losses.dropped[REPEATED] == stream.losses.dropped.total() == 6


def of_turned_sensor(path, yaw_and_roll_deg, xx, xy, yy):
    """What a sensor that is turned so reports of one vehicle."""
    turn = Rotation.from_euler("ZX", yaw_and_roll_deg, degrees=True).as_quat().tolist()
    seen = dirprim_pb2.Observations(
        frame_id="sensor", track_id=["a"], x=[1.0], y=[2.0], direction=[0.1],
        covariance_xx=[xx], covariance_xy=[xy], covariance_yy=[yy],
    )  # fmt: skip
    write_protobuf_log(path, [("/tf", 0, transform("map", "sensor", turn=turn)), ("/objects", 5, seen)])
    return detections(path, motion=True)


def test_errors_turn_with_the_frame_they_are_reported_in(tmp_path):
    """The ellipse of a sensor that looks 30 degrees to the left, beside the eigenvectors that it must then have."""
    frame = of_turned_sensor(tmp_path / "log.mcap", (30.0, 0.0), 4.0, 0.0, 0.25)
    values, vectors = np.linalg.eigh(frame.covariance[0])
    np.testing.assert_allclose(values, [0.25, 4.0])
    assert abs(vectors[:, 1] @ [np.cos(np.pi / 6), 0.5]) == pytest.approx(1.0)
    assert frame.direction[0] == pytest.approx(0.1 + np.pi / 6)


@pytest.mark.parametrize("reported", [
    ((0.0, 0.0), 0.0, 0.0, 0.0), ((0.0, 0.0), 1.0, 2.0, 1.0), ((0.0, 0.0), np.inf, 0.0, 1.0),
    ((10.0, 0.0), 1e300, 1e300, 1e300),
    ((20.0, 90.0), 4.0, 0.0, 0.25),  # seen from the side the ellipse is a line
])  # fmt: skip
def test_errors_that_cannot_be_are_unknown(tmp_path, reported):
    assert np.isnan(of_turned_sensor(tmp_path / "log.mcap", *reported).covariance).all()


def covariance(k, *, n_rows=6):
    """As a message contains it, row by row; of x and y [[4, 1], [1, 2 + k]]."""
    matrix = np.diag(np.arange(1.0, n_rows + 1))
    matrix[:2, :2] = [[4.0, 1.0], [1.0, 2.0 + k]]
    return matrix.ravel().tolist()


def autoware(kind, **flags):
    schema = f"autoware_perception_msgs/msg/{kind}"
    one = ARRAYS[schema][1](1, 0)
    one["kinematics"]["pose_with_covariance"]["covariance"] = covariance(1)
    one["kinematics"] |= flags
    return schema, {"objects": [one]}


POSE = {"pose": {"position": point(1, 2, 3), "orientation": quaternion(0, 0, 0)}, "covariance": covariance(1)}
FIX = {"latitude": 48.0, "longitude": 11.0, "altitude": 0.0,
       "position_covariance": covariance(1, n_rows=3)}  # fmt: skip
PROTOBUF_FIX = {"latitude": 48.0, "longitude": 11.0, "position_covariance": FIX["position_covariance"]}


@pytest.mark.parametrize(
    ("message", "is_known"),
    [
        (autoware("TrackedObjects"), True),
        (autoware("DetectedObjects", has_position_covariance=True), True),
        (autoware("DetectedObjects", has_position_covariance=False), False),
        (("nav_msgs/msg/Odometry", {"child_frame_id": "car", "pose": POSE}), True),
        (("geometry_msgs/msg/PoseWithCovarianceStamped", {"pose": POSE}), True),
        (("sensor_msgs/msg/NavSatFix", FIX | {"position_covariance_type": 3}), True),
        (("sensor_msgs/msg/NavSatFix", FIX | {"position_covariance_type": 0}), False),
        (LocationFix(**PROTOBUF_FIX, position_covariance_type=LocationFix.KNOWN), True),
        (LocationFix(**PROTOBUF_FIX), False),
        (Odometry(frame_id="map", body_frame_id="car", pose_covariance=covariance(1)), True),
        (Odometry(frame_id="map", body_frame_id="car"), False),
    ],
)
def test_errors_are_those_reported(tmp_path, message, is_known):
    path = tmp_path / "log.mcap"
    if isinstance(message, tuple):
        write_ros2_log(path, [("/a", 7, message[0], {"header": header(7, "map")} | message[1])])
    else:
        write_protobuf_log(path, [("/a", 7, message)])
    (frame,) = stream_detections(path)
    expected = [[[4.0, 1.0], [1.0, 3.0]]] if is_known else np.full((1, 2, 2), np.nan)
    np.testing.assert_array_equal(frame.covariance, expected)


N_ROWS = 60
SPEED = 7.0


def moving(rate, yaw=0.0):
    """Place, heading and velocity at each time of a vehicle that turns at a rate, and drives where it looks."""
    time_s = np.arange(N_ROWS) * STEP_NS * 1e-9
    heading = yaw + rate * time_s
    velocity = SPEED * np.column_stack([np.cos(heading), np.sin(heading)])
    way = np.cumsum(velocity, axis=0) * STEP_NS * 1e-9
    return way - way[0], heading, velocity


def twist_in(heading, velocity, axes):
    x, y = {"frame": velocity, "body": (SPEED, 0.0), "sideways": (0.0, -SPEED)}[axes]
    return {"linear": point(x, y, 0), "angular": point(0, 0, 0)}


def ros_odometry(stamp, pose, v, child):
    return "nav_msgs/msg/Odometry", {
        "header": header(stamp), "child_frame_id": child, "pose": {"pose": pose}, "twist": {"twist": v},
    }  # fmt: skip


def odometry(stamp, pose, v, child):
    """Foxglove's."""
    said = {"frame_id": "map", "body_frame_id": child, "pose": pose, "linear_velocity": v["linear"]}
    one = ParseDict(said, Odometry())
    one.timestamp.FromNanoseconds(stamp)
    return (one,)


def tracked_objects(stamp, pose, v, _):
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
        messages.append(("/car", stamp, *make(stamp, pose, twist_in(yaw, velocity, axes), child)))
    return (write_protobuf_log if make is odometry else write_ros2_log)(path, messages)


def apart(tracks, heading):
    return np.abs(np.angle(np.exp(1j * (tracks.direction - heading))))


MAKERS = {ros_odometry: "body", odometry: "body", tracked_objects: "body", derived: "frame"}


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


def test_a_twist_in_the_frame_that_positions_are_in_needs_no_turn(tmp_path, caplog):
    """By the message's own definition; a driver that names the frame but means the body is found by its way."""
    drive = moving(0.3, 0.4)
    for axes, is_reported in (("frame", False), ("body", True)):
        path = log_of(tmp_path / "log.mcap", ros_odometry, axes, drive, child="/map")
        assert apart(read_tracks(path), drive[1]).max() < 1e-6
        assert ("the twist of /car" in caplog.text) == is_reported


def test_a_body_that_goes_sideways_is_left_as_it_says(tmp_path, caplog):
    """A ferry that looks north and goes east: neither the heading nor a wrong guess of axes moves its course."""
    way, _, velocity = moving(0.0)
    path = log_of(tmp_path / "log.mcap", ros_odometry, "sideways", (way, np.full(N_ROWS, np.pi / 2), velocity))
    assert apart(read_tracks(path), 0.0).max() < 1e-6
    assert "axes" not in caplog.text


def test_negative_speeds_are_reported_once_with_their_number(tmp_path, caplog):
    speeds = [-3.0 if k % 4 == 0 else 5.0 for k in range(N)]
    sent = [(k * STEP_NS, {"id": "a", "x": 0.5 * k, "y": 0.0, "speed": speed}) for k, speed in enumerate(speeds)]
    path, mapping = json_log(tmp_path / "log.mcap", "Object", sent), FieldMapping.parse("id=.id,x=.x,y=.y,speed=.speed")
    np.testing.assert_allclose(read_tracks(path, mapping=mapping).speed, 5.0)
    assert caplog.text.count(f"{N // 4} speeds below 0, which count as unknown") == 1
    stated = detections(path, mapping=mapping, motion=True).speed
    np.testing.assert_array_equal(stated, np.where(np.array(speeds) < 0, np.nan, speeds))
    assert caplog.text.count("speeds below 0") == 2
