"""What independent writers write of ROS 2's objects, we read right."""

import numpy as np
import pytest
from ros_messages import header, point, quaternion, write_ros2_log
from scipy.spatial.transform import Rotation

from dirprim_filter.detections import NO_ID
from dirprim_filter.recording.losses import ALONE
from dirprim_filter.recording.reader import read_track_logs, read_tracks, stream_detections

STEP_NS = 100_000_000
START_NS = 1_700_000_000_000_000_000
N_TIMES = 12
NAMES = ("a", "b", "c")


class Scene:
    """Three vehicles on arcs, the last standing: place, heading and velocity at each time."""

    def __init__(self):
        rng = np.random.default_rng(3)
        self.place = rng.normal(scale=50, size=(N_TIMES, 3, 3))
        self.yaw = rng.uniform(-3, 3, size=(N_TIMES, 3))
        self.speed = np.array([5.0, 12.5, 0.0]) * np.ones((N_TIMES, 1))

    def pose(self, k, i):
        return {"position": point(*self.place[k, i]), "orientation": quaternion(0, 0, self.yaw[k, i])}

    def body_twist(self, k, i):
        return {"linear": point(self.speed[k, i], 0, 0), "angular": point(0, 0, 0)}

    def frame_twist(self, k, i):
        v, a = self.speed[k, i], self.yaw[k, i]
        return {"linear": point(v * np.cos(a), v * np.sin(a), 0), "angular": point(0, 0, 0)}


SCENE = Scene()


def tracked(k, i):
    return {
        "object_id": {"uuid": [i + 1] * 16},
        "existence_probability": 0.75,
        "classification": [{"label": 1, "probability": 0.5}] * (i + k % 2),
        "kinematics": {
            "pose_with_covariance": {"pose": SCENE.pose(k, i)},
            "orientation_availability": 2,
            "twist_with_covariance": {"twist": SCENE.body_twist(k, i)},
        },
        "shape": {"type": 0, "footprint": {"points": [point(1, 2, 3)] * k}, "dimensions": point(4, 2, 1)},
    }


def detected(k, i, *, has_twist=True, availability=2):
    one = {key: value for key, value in tracked(k, i).items() if key != "object_id"}
    kinematics = {key: one["kinematics"][key] for key in ("pose_with_covariance", "twist_with_covariance")}
    flags = {"has_position_covariance": False, "has_twist": has_twist, "has_twist_covariance": False}
    return one | {"kinematics": kinematics | flags | {"orientation_availability": availability}}


def carla(k, i):
    return {
        "header": header(0), "id": i + 1, "pose": SCENE.pose(k, i), "twist": SCENE.frame_twist(k, i),
        "polygon": {"points": [point(0, 0, 0)] * i}, "shape": {"type": 1, "dimensions": [4.0, 2.0, 1.5]},
        "classification": 6, "classification_certainty": 255,
    }  # fmt: skip


def detection(k, i):
    hypothesis = {"hypothesis": {"class_id": "car" * i, "score": 0.5}, "pose": {"pose": SCENE.pose(k, i)}}
    return {
        "header": header(0), "results": [hypothesis] * (k % 3), "id": NAMES[i],
        "bbox": {"center": SCENE.pose(k, i), "size": point(4, 2, 1)},
    }  # fmt: skip


def marker(k, i, *, kind=1, action=0):
    return {
        "header": header(START_NS + k * STEP_NS), "ns": "cars", "id": i, "type": kind, "action": action,
        "pose": SCENE.pose(k, i), "scale": point(4, 2, 1), "points": [point(0, 0, 0)] * i, "text": "t" * k,
    }  # fmt: skip


ARRAYS = {
    "autoware_perception_msgs/msg/TrackedObjects": ("objects", tracked),
    "autoware_auto_perception_msgs/msg/TrackedObjects": ("objects", tracked),
    "autoware_perception_msgs/msg/DetectedObjects": ("objects", detected),
    "autoware_auto_perception_msgs/msg/DetectedObjects": ("objects", detected),
    "derived_object_msgs/msg/ObjectArray": ("objects", carla),
    "vision_msgs/msg/Detection3DArray": ("detections", detection),
    "visualization_msgs/msg/MarkerArray": ("markers", marker),
}
TELLS_MOTION = {name for name in ARRAYS if "Objects" in name or "ObjectArray" in name}
IDS = {
    "TrackedObjects": {"01" * 16, "02" * 16, "03" * 16}, "ObjectArray": {1, 2, 3}, "Detection3DArray": set(NAMES),
    "MarkerArray": {"cars/0", "cars/1", "cars/2"},
}  # fmt: skip


def array_log(tmp_path, schema, items=lambda k, make: [make(k, i) for i in range(3)]):
    (field, make), sent = ARRAYS[schema], []
    for k in range(N_TIMES):
        time_ns = START_NS + k * STEP_NS
        stamped = {} if field == "markers" else {"header": header(time_ns)}
        sent.append(("/objects", time_ns + 5, schema, stamped | {field: items(k, make)}))
    return write_ros2_log(tmp_path / "log.mcap", sent)


@pytest.mark.parametrize("schema", ARRAYS)
@pytest.mark.parametrize("time_source", ["log", "header"])
def test_objects_are_those_that_were_written(tmp_path, schema, time_source):
    log_path = array_log(tmp_path, schema)
    log = read_track_logs(log_path, time_source=time_source)
    assert log.losses.dropped == {}
    tracks = log.tracks
    assert tracks.time_ns.tolist() == [
        START_NS + k * STEP_NS + 5 * (time_source == "log") for k in range(N_TIMES) for _ in range(3)
    ]
    np.testing.assert_array_equal(tracks.position, SCENE.place[..., :2].reshape(-1, 2))
    if schema in TELLS_MOTION:
        np.testing.assert_allclose(tracks.speed, SCENE.speed.ravel(), atol=1e-12)
        np.testing.assert_allclose(np.exp(1j * tracks.direction), np.exp(1j * SCENE.yaw.ravel()), atol=1e-12)
    np.testing.assert_allclose(np.exp(1j * tracks.heading), np.exp(1j * SCENE.yaw.ravel()), atol=1e-12)
    ids = IDS.get(schema.rpartition("/")[2])  # else none is stated: each row is a track of its own
    assert set(tracks.track_id.tolist()) == ids if ids else tracks.n_tracks == len(tracks)
    seen = {name for frame in stream_detections(log_path) for name in frame.track_id.tolist()}
    assert seen == ({str(name) for name in ids} if ids else {NO_ID})


def test_a_twist_that_is_not_reported_is_no_standstill_and_who_stands_unturned_has_no_direction(tmp_path):
    schema = "autoware_perception_msgs/msg/DetectedObjects"
    path = array_log(tmp_path, schema, lambda k, _: [detected(k, i, has_twist=i != 0) for i in range(3)])
    log = read_track_logs(path)
    assert (len(log.tracks), log.losses.notes[ALONE]) == (2 * N_TIMES, N_TIMES)
    assert sum(len(frame) for frame in stream_detections(path)) == 3 * N_TIMES
    path = array_log(tmp_path, schema, lambda k, _: [detected(k, i, availability=0) for i in (1, 2)])
    np.testing.assert_allclose(read_tracks(path).speed, [12.5] * N_TIMES)


def test_markers_that_draw_no_body_are_no_objects(tmp_path):
    def items(k, make):
        return [make(k, 0), make(k, 1, kind=0), make(k, 2, kind=9), make(k, 2, action=2), make(k, 1, kind=4)]

    assert read_tracks(array_log(tmp_path, "visualization_msgs/msg/MarkerArray", items)).n_tracks == 1


def test_a_fleet_is_read_in_whole_and_no_two_become_one(tmp_path, caplog):
    """Each calls itself base_link; vehicles 200 m apart would be one that jumps, or all but one not read.

    Their twists are turned from the body into its frame.
    """
    messages = []
    for k, i in np.ndindex(N_TIMES, 23):
        pose = {"position": point(k, 200.0 * i, 0), "orientation": quaternion(0.1, -0.2, SCENE.yaw[k, 1])}
        reported = {
            "header": header(START_NS + k * STEP_NS, "odom"), "child_frame_id": "base_link", "pose": {"pose": pose},
            "twist": {"twist": {"linear": point(3.0, 1.0, 0.5), "angular": point(0, 0, 1)}},
        }  # fmt: skip
        messages.append((f"/car{i}/odom", START_NS + k * STEP_NS + i, "nav_msgs/msg/Odometry", reported))
    turned = Rotation.from_euler("ZYX", [(yaw, -0.2, 0.1) for yaw in SCENE.yaw[:, 1]]).apply([3.0, 1.0, 0.5])
    path = write_ros2_log(tmp_path / "log.mcap", messages)
    for options in ({}, {"topics": "/car.*"}):
        tracks = read_tracks(path, **options)
        assert set(tracks.track_id) == {f"/car{i}/odom/base_link" for i in range(23)}
        for i in range(23):
            of = tracks[tracks.track_id == f"/car{i}/odom/base_link"]
            np.testing.assert_array_equal(of.position, [[k, 200.0 * i] for k in range(N_TIMES)])
            velocity = of.speed[:, None] * np.stack([np.cos(of.direction), np.sin(of.direction)], -1)
            np.testing.assert_allclose(velocity, turned[:, :2], atol=1e-12)
    assert all(len(frame) == 23 for frame in stream_detections(path))
    assert set(read_tracks(path, topics="/car7/odom").track_id) == {"base_link"}
    assert "is read, not" not in caplog.text


def poses(i, *, begins=(0.0, 0.0), frame="map"):
    for k in range(N_TIMES):
        time_ns, place = START_NS + k * STEP_NS + i, point(begins[0] + k, begins[1] + 0.1 * i * k, 0)
        pose = {"position": place, "orientation": quaternion(0, 0, 0)}
        stamped = {"header": header(time_ns, frame), "pose": pose}
        yield f"/car{i}/pose", time_ns, "geometry_msgs/msg/PoseStamped", stamped


OWN, UNNAMED = "begin at 0 0, while others go on from there", "the frame of 12 rows has no name: they are taken to be"


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({}, "3 of 3 vehicles " + OWN), ({1: {"begins": (5.0, 0.0)}}, "2 of 3 vehicles " + OWN),
        ({0: {"begins": (0.0, -9.0)}, 1: {"begins": (5.0, 0.0)}}, ""),
        ({i: {"begins": (9.0 * i, 9.0)} for i in range(3)}, ""),
        ({i: {"begins": (9.0 * i, 9.0), "frame": "map" if i else ""} for i in range(3)}, UNNAMED),
        ({i: {"begins": (9.0 * i, 9.0), "frame": "/map" if i else "map"} for i in range(3)}, ""),
        ({i: {"begins": (9.0 * i, 9.0), "frame": ""} for i in range(3)}, ""),
    ],
)  # fmt: skip
def test_vehicles_that_may_not_be_of_one_frame_are_reported(tmp_path, caplog, changed, said):
    """Each counts from its own start, though all call it the map; or some do not say what they count in."""
    messages = [message for i in range(3) for message in poses(i, **changed.get(i, {}))]
    assert len(read_tracks(write_ros2_log(tmp_path / "log.mcap", messages)).first_rows) == 3
    assert len(caplog.messages) == (said != "")
    assert said in caplog.text


def test_topics_of_other_kinds_that_are_not_read_are_named(tmp_path, caplog):
    """But for drawings, which show what others say."""
    fix = {
        "status": {"status": 0, "service": 1}, "latitude": 52.0, "longitude": 13.0, "altitude": 0.0,
        "position_covariance": [0.0] * 9, "position_covariance_type": 0,
    }  # fmt: skip
    times = START_NS + np.arange(N_TIMES) * STEP_NS
    fixes = [("/fix", at, "sensor_msgs/msg/NavSatFix", {"header": header(at, "gps")} | fix) for at in times.tolist()]
    read_tracks(write_ros2_log(tmp_path / "log.mcap", [*poses(0, begins=(9.0, 9.0)), *fixes]))
    assert [line.partition(": ")[2] for line in caplog.messages] == ["/car0/pose is read, not /fix; --topics chooses"]
