"""Objects in the frame of a moving vehicle arrive in the map's; pytransform3d is the oracle."""

import itertools
from itertools import pairwise

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from mcap.writer import CompressionType
from mcap_files import CHUNK, records, stock, transform, write_messages, write_protobuf_log
from ros_messages import array, header, point, quaternion, ros2_log_in_order, ros_transform, tf, write_ros2_log
from scipy.spatial.transform import Rotation
from test_osi_sensor_data import homogeneous
from test_ros2_schemas import ARRAYS, START_NS, STEP_NS, carla

from dirprim_filter.recording.container.log import Log
from dirprim_filter.recording.errors import DamagedRecordingError, DecodeError, MissingTransformError
from dirprim_filter.recording.losses import TRANSFORMS, UNDECODABLE, UNPLACED
from dirprim_filter.recording.reader import read_track_logs, read_tracks, stream_detections
from dirprim_filter.recording.transforms.transform_tree import TransformTree

N = 12


def ego(time_s):
    """The vehicle on a circle, in odom."""
    angle = 0.4 * time_s
    return np.array([30 * np.cos(angle), 30 * np.sin(angle), 0.5]), angle + np.pi / 2


MAP_TO_ODOM = (np.array([100.0, -20.0, 1.0]), 0.7)
BASE_TO_SENSOR = (np.array([1.5, 0.2, 1.8]), -0.1)
OBJECTS = [("base_link", [carla(k, 1)]) for k in range(N)]
"""One in the axes of the vehicle."""


def write_ros(path, objects, *, transforms=range(-1, N + 1), more=(), static=()):
    """A log of moving objects and the transforms of all its frames; the moving one at other times than objects."""
    before, still = START_NS - STEP_NS, (("map", "odom", *MAP_TO_ODOM), ("base_link", "sensor", *BASE_TO_SENSOR))
    messages = [tf(before, *(ros_transform(before, *of) for of in still), topic="/tf_static")]
    for k in transforms:
        time_ns = START_NS + k * STEP_NS + STEP_NS // 2
        messages.append(tf(time_ns, ros_transform(time_ns, "odom", "base_link", *ego((time_ns - START_NS) * 1e-9))))
    messages += [array(START_NS + k * STEP_NS, *of, late_ns=30_000_000) for k, of in enumerate(objects)]
    messages += [*(tf(*of) for of in more), *(tf(*of, topic="/tf_static") for of in static)]
    return ros2_log_in_order(path, *messages)


def streamed(path, **options):
    return list(stream_detections(path, **options))


def sensor_in_map(time_s):
    return homogeneous(*MAP_TO_ODOM) @ homogeneous(*ego(time_s)) @ homogeneous(*BASE_TO_SENSOR)


def test_objects_of_a_sensor_arrive_in_the_map(tmp_path):
    """A parked and a moving car, reported in the sensor's axes: in the map one stands, the other goes straight."""
    parked, start, velocity = np.array([5.0, 9.0, 0.0]), np.array([-40.0, 3.0, 0.0]), np.array([8.0, -6.0, 0.0])
    frames = []
    for k in range(N):
        back = np.linalg.inv(sensor_in_map(k * 0.1))
        reported = []
        for i, (place, v) in enumerate([(parked, np.zeros(3)), (start + velocity * k * 0.1, velocity)]):
            one = carla(k, i)
            yaw = np.arctan2(*(back[:3, :3] @ (velocity / 10 if i else [0.0, 1.0, 0.0]))[1::-1])
            one["pose"] = {"position": point(*(back @ [*place, 1.0])[:3]), "orientation": quaternion(0, 0, yaw)}
            one["twist"] = {"linear": point(*(back[:3, :3] @ v)), "angular": point(0, 0, 0)}
            reported.append(one)
        frames.append(("sensor", reported))
    path = write_ros(tmp_path / "log.mcap", frames)
    tracks = read_tracks(path)
    still, moving = tracks[tracks.track_id == 1], tracks[tracks.track_id == 2]
    # between two transforms 0.1 s apart the chord leaves the circle by 30 m * (0.04 rad)^2 / 8 = 6 mm
    np.testing.assert_allclose(still.position, np.broadcast_to(parked[:2], (N, 2)), atol=0.02)
    np.testing.assert_allclose(moving.position, (start + velocity * np.arange(N)[:, None] * 0.1)[:, :2], atol=0.02)
    np.testing.assert_allclose(moving.speed, 10.0)
    np.testing.assert_allclose(moving.direction, np.arctan2(-6, 8), atol=1e-6)
    np.testing.assert_allclose(still.direction, np.pi / 2, atol=1e-6)
    np.testing.assert_array_equal(still.heading, still.direction)
    np.testing.assert_allclose(moving.heading, np.arctan2(-6, 8), atol=1e-6)
    np.testing.assert_array_equal(np.concatenate([frame.position for frame in streamed(path)]), tracks.position)
    in_base = read_tracks(path, frame="base_link")
    expected = np.linalg.inv(homogeneous(*BASE_TO_SENSOR))
    first = in_base.position[in_base.track_id == 1][0]
    reported = np.linalg.inv(expected) @ np.linalg.inv(sensor_in_map(0.0)) @ [*parked, 1.0]
    np.testing.assert_allclose(first, reported[:2], atol=1e-9)


def test_the_tree_agrees_with_pytransform3d(tmp_path):
    from pytransform3d.transform_manager import NumpyTimeseriesTransform, TemporalTransformManager

    rng = np.random.default_rng(5)
    times = np.sort(rng.choice(10**9, 20, replace=False)).astype(np.int64)
    names = ["map", "odom", "base", "head", "camera"]
    messages, poses = [], {}
    for parent, child in pairwise(names):
        place = np.cumsum(rng.normal(size=(20, 3)), axis=0)
        turn = Rotation.from_rotvec(np.cumsum(rng.normal(scale=0.1, size=(20, 3)), axis=0)).as_quat()
        poses[parent, child] = np.column_stack([place, turn[:, [3, 0, 1, 2]]])
        for t, p, q in zip(times.tolist(), place.tolist(), turn.tolist(), strict=True):
            one = transform(parent, child, time_ns=t, place=p, turn=q)
            messages.append((f"/{child}", t, FrameTransforms(transforms=[one]) if child == "head" else one))
    tree = TransformTree.of_log(Log(write_protobuf_log(tmp_path / "tf.mcap", sorted(messages, key=lambda m: m[1]))))
    assert tree.root_of("camera") == "map"
    # at the times of the transforms no interpolation enters, where pytransform3d's (screws) differs from ours
    manager = TemporalTransformManager()
    for (parent, child), pose in poses.items():
        manager.add_transform(child, parent, NumpyTimeseriesTransform(times.astype(float), pose))
    for source, target in (("camera", "map"), ("map", "camera"), ("head", "odom")):
        ours = tree.placement(source, target, times)
        assert ours.known.all()
        expected = manager.get_transform_at_time(source, target, times.astype(float))
        np.testing.assert_allclose(ours.rotation.as_matrix(), expected[:, :3, :3], atol=1e-9)
        np.testing.assert_allclose(ours.translation, expected[:, :3, 3], atol=1e-9)


def test_rotation_is_at_a_constant_rate_the_short_way(tmp_path):
    messages = []
    for time_ns, yaw in ((0, 3.0), (1_000_000_000, -3.0)):
        turn = 0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)
        one = transform("map", "car", time_ns=time_ns + 10**9, place=(yaw, 0.0, 0.0), turn=turn)
        messages.append(("/tf", time_ns, one))
    tree = TransformTree.of_log(Log(write_protobuf_log(tmp_path / "tf.mcap", messages)))
    at = tree.placement("car", "map", 10**9 + np.array([250_000_000, 1_050_000_000, 1_200_000_000, -200_000_000]))
    yaw = at.rotation.as_euler("ZYX")[:, 0] % (2 * np.pi)
    turn = 2 * np.pi - 6.0
    np.testing.assert_allclose(yaw[:2], [3.0 + 0.25 * turn, 3.0 + 1.05 * turn])
    assert at.translation[0, 0] == pytest.approx(1.5)
    assert at.known.tolist() == [True, True, False, False]


def test_a_missing_transform_names_both_frames_and_the_time(tmp_path):
    path = write_ros(tmp_path / "log.mcap", OBJECTS, transforms=())
    assert len(read_tracks(path, frame="base_link")) == N
    early = write_ros(tmp_path / "early.mcap", OBJECTS, transforms=range(100, 110))
    both = [(("base_link", "camera")[k % 2], [carla(k, 1)]) for k in range(N)]
    two = write_ros(tmp_path / "two.mcap", both, transforms=())
    for log, asked, missing in (
        (path, "map", f"'base_link' to frame 'map' at {START_NS} ns"),
        (path, None, f"'base_link' to frame 'map' at {START_NS} ns"),  # the root of its tree, but one that moves
        (early, None, f"'base_link' to frame 'map' at {START_NS} ns"),
        (path, "moon", "'base_link' to frame 'moon'"),
        (two, "base_link", "'camera' to frame 'base_link'"),
    ):
        for read in (read_tracks, streamed):
            with pytest.raises(MissingTransformError, match=missing) as error:
                read(log, frame=asked)
            assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("frame", "asked", "is_reported"),
    [("lidar_top", None, True), ("lidar_top", "lidar_top", False), ("map", None, False), ("world", None, False)],
)
def test_positions_in_a_frame_that_may_be_a_sensors_are_reported(tmp_path, caplog, frame, asked, is_reported):
    sent = [array(START_NS + k * STEP_NS, frame, [carla(k, 1)]) for k in range(N)]
    assert len(read_tracks(write_ros2_log(tmp_path / "log.mcap", sent), frame=asked)) == N
    assert (f"--set frame={frame} says that this is meant" in caplog.text) == is_reported
    among = write_ros(tmp_path / "among.mcap", [(frame, [carla(k, 1)]) for k in range(N)])
    if is_reported:  # the log has a map, but this sensor is not placed in it
        with pytest.raises(MissingTransformError, match=r"'lidar_top' to frame 'map'.*'base_link' in 'odom'"):
            read_tracks(among)
    else:
        assert len(read_tracks(among, frame=asked)) == N


def test_objects_of_a_time_without_transforms_are_counted(tmp_path, caplog):
    log = read_track_logs(write_ros(tmp_path / "log.mcap", OBJECTS, transforms=range(4, N)))
    assert log.losses.dropped[UNPLACED] == 4  # the fourth is within 0.1 s before the first transform
    assert len(log.tracks) == N - 4
    assert "no transform from 'base_link' to 'map' at" in caplog.text
    gap = read_track_logs(write_ros(tmp_path / "gap.mcap", OBJECTS, transforms=[-1, 0, 30]))
    assert 0 < gap.losses.dropped[UNPLACED] < N


@pytest.mark.parametrize("late_ns", [50_000_000, 110_000_000])
def test_an_object_is_where_the_vehicle_was_at_its_stamp_then(tmp_path, late_ns):
    """A parked car seen from a vehicle at 12 m/s, logged late: it stands, and the vehicle's own speed is 12 m/s."""
    n, speed, rng = 40, 12.0, np.random.default_rng(5)
    messages = []
    for k in range(2 * n + 4):
        now = START_NS + (k - 2) * STEP_NS // 2
        messages.append(tf(now, ros_transform(now, "map", "base_link", (speed * (now - START_NS) * 1e-9, 0, 0))))
    for k in range(n):
        ahead, driving = carla(0, 0), carla(0, 1)
        for one, x in ((ahead, 90.0 - speed * k * 0.1), (driving, 0)):
            one["pose"] = {"position": point(x, 0, 0), "orientation": quaternion(0, 0, 0)}
        late = late_ns - int(rng.integers(40_000_000))
        messages.append(array(START_NS + k * STEP_NS, "base_link", [ahead, driving], late_ns=late))
    path = ros2_log_in_order(tmp_path / "log.mcap", *messages)
    tracks = read_tracks(path)
    still, driving = tracks[tracks.track_id == 1], tracks[tracks.track_id == 2]
    np.testing.assert_allclose(still.position[:, 0], 90.0, atol=1e-6)
    np.testing.assert_allclose(np.diff(driving.position[:, 0]) / np.diff(driving.time_ns * 1e-9), speed, atol=1e-4)
    np.testing.assert_array_equal(driving.time_ns, START_NS + np.arange(n) * STEP_NS)
    np.testing.assert_array_equal(np.unique([frame.time_ns for frame in streamed(path)]), driving.time_ns)


def test_a_static_transform_holds_at_all_times_and_of_several_the_latest(tmp_path):
    """A millimetre and 20 s apart: two that are interpolated would leave out what is between them."""
    still = [(START_NS + at_s * 10**9, ros_transform(START_NS, "map", "base_link", (x, 0, 0)))
             for at_s, x in ((0, 5.0), (20, 5.001))]  # fmt: skip
    path = write_ros(tmp_path / "log.mcap", OBJECTS, transforms=(), static=still)
    log = read_track_logs(path, frame="map")
    assert log.losses.dropped == {}
    own = read_tracks(path, frame="base_link").position
    np.testing.assert_allclose(log.tracks.position, own + np.array([5.001, 0.0]), atol=1e-9)


@pytest.mark.parametrize(("of_objects", "of_transforms"), [("/base_link", ""), ("base_link", "/"), ("/base_link", "/")])
def test_a_slash_before_a_frame_is_no_part_of_its_name(tmp_path, of_objects, of_transforms):
    still = ros_transform(START_NS, f"{of_transforms}map", f"{of_transforms}base_link", (5.0, 0, 0))
    frames = [(of_objects if k % 2 else "base_link", [carla(k, 1)]) for k in range(N)]
    path = write_ros(tmp_path / "log.mcap", frames, transforms=(), static=[(START_NS, still)])
    own = read_tracks(path, frame="/base_link").position
    for asked in (None, "map", "/map"):
        np.testing.assert_allclose(read_tracks(path, frame=asked).position, own + np.array([5.0, 0.0]), atol=1e-9)


@pytest.mark.parametrize("schema", ["derived_object_msgs/msg/ObjectArray", "vision_msgs/msg/Detection3DArray"])
@pytest.mark.parametrize(
    ("headers", "is_reported"),
    [
        (((False, ""), (True, "base_link")), False),
        (((True, "base_link"), (False, "")), False),
        (((True, "map"), (True, "base_link")), True),
        (((True, "base_link"), (False, "map")), True),  # not filled in
        (((False, "base_link"), (True, "")), False),
    ],
)
def test_an_objects_own_header_counts_where_it_is_filled_in(tmp_path, caplog, schema, headers, is_reported):
    field, make = ARRAYS[schema]
    messages = [tf(START_NS, ros_transform(START_NS, "map", "base_link", (5.0, 0, 0)), topic="/tf_static")]
    for k in range(N):
        of_all, own = (header((START_NS + k * STEP_NS) * is_set, frame) for is_set, frame in headers)
        message = {"header": of_all, field: [make(k, 1) | {"header": own}]}
        messages.append(("/objects", START_NS + k * STEP_NS + 7, schema, message))
    tracks = read_tracks(write_ros2_log(tmp_path / "log.mcap", messages))
    reported = [make(k, 1).get("pose") or make(k, 1)["bbox"]["center"] for k in range(N)]
    expected = [[of["position"]["x"] + 5.0, of["position"]["y"]] for of in reported]
    np.testing.assert_allclose(tracks.position, expected)
    np.testing.assert_array_equal(tracks.time_ns, START_NS + np.arange(N) * STEP_NS)
    assert caplog.text.count("another frame or stamp than their message") == is_reported


def broken_transform(k):
    """One that is none: not finite, of no rotation, of a frame in itself."""
    one = ros_transform(START_NS, "odom", "base_link" if k % 3 else "odom", (np.nan if k % 3 == 1 else 0.0, 0.0, 0.0))
    if k % 3 == 2:
        one["transform"]["rotation"] = dict.fromkeys("xyzw", 0.0)
    return one


def spoiled(path, spoil, **options):
    """A log of objects of a moving sensor, the data of its k-th moving transform as `spoil` makes it."""
    sent, count = [], itertools.count()
    for s, c, m in stock(write_ros(path, OBJECTS)):
        data = spoil(next(count), m.data) if c.topic == "/tf" else m.data
        sent.append((c.topic, m.log_time, data, (s.name, s.encoding, s.data)))
    return write_messages(path, sent, "cdr", **options)


def test_transforms_that_are_none_or_cannot_be_decoded_are_counted_and_strict_refuses_them(tmp_path):
    whole = read_tracks(write_ros(tmp_path / "log.mcap", OBJECTS))
    path = write_ros(tmp_path / "log.mcap", OBJECTS, more=[(START_NS + k, broken_transform(k)) for k in range(5)])
    log = read_track_logs(path)
    assert (log.losses.dropped[TRANSFORMS], log.losses.dropped.total()) == (5, 5)
    assert "5 transforms" in str(log.losses)
    np.testing.assert_array_equal(log.tracks.position, whole.position)
    whole = read_tracks(spoiled(tmp_path / "log.mcap", lambda _, data: data))
    path = spoiled(tmp_path / "log.mcap", lambda k, data: data[:20] if k in (3, 9) else data)
    log = read_track_logs(path)
    assert log.losses.dropped[UNDECODABLE] == sum(log.losses.why.values()) == 2
    assert len(log.tracks) == N
    np.testing.assert_allclose(log.tracks.position, whole.position, atol=0.2)  # interpolated over 0.2 s
    for read in (read_tracks, streamed):
        with pytest.raises(DecodeError, match="topic /tf, message at"):
            read(path, strict=True)
    assert len(read_tracks(path, strict=True, frame="base_link")) == N  # these transforms are not needed


def test_damage_among_the_transforms_is_reported_once_and_strict_refuses_it(tmp_path):
    path = spoiled(tmp_path / "log.mcap", lambda _, data: data, chunk_size=1, compression=CompressionType.NONE)
    data = bytearray(path.read_bytes())
    places = [at for opcode, at, end in records(bytes(data)) if opcode == CHUNK and b"base_link" in data[at:end]]
    data[places[6] + 120] ^= 1
    path.write_bytes(data)
    stream = stream_detections(path)
    list(stream)
    for losses in (read_track_logs(path).losses, stream.losses):
        assert [damage.kind for damage in losses.damage] == ["chunk_crc"]
    for read in (read_tracks, streamed):
        with pytest.raises(DamagedRecordingError):
            read(path, strict=True)
