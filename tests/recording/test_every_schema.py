"""`info`, `learn`, `track` and `replay` on a log of each schema and encoding that is read, by independent writers."""

import json

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Odometry_pb2 import Odometry
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.json_format import ParseDict
from mcap_files import scene, write_log, write_protobuf_log
from ros_messages import header, write_ros2_log
from test_ros2_schemas import point, quaternion

from dirprim_filter.cli.main import run
from dirprim_filter.cli.reading import Reading

N, STEP_NS, START_NS = 80, 100_000_000, 1_700_000_000_000_000_000
TIMES = (START_NS + STEP_NS * np.arange(N)).tolist()
ANGLE = 0.05 * np.arange(N)
PLACE = np.column_stack([20 * np.cos(ANGLE), 20 * np.sin(ANGLE)]).tolist()
SPEED = 10.0
STILL = point(0, 0, 0)
ORIGIN = ["--origin", "48,11"]


def stamp(k, nanos="nanosec"):
    return {"sec": TIMES[k] // 10**9, nanos: TIMES[k] % 10**9}


def pose(k):
    """Where the vehicle is, and which way it points, as ROS and JSON have it."""
    return {"position": point(*PLACE[k], 0), "orientation": quaternion(0, 0, ANGLE[k] + np.pi / 2)}


def in_protobuf(kind, make):
    def one(k):
        message = ParseDict({"frame_id": "map"} | make(k), kind(), ignore_unknown_fields=True)
        message.timestamp.FromNanoseconds(TIMES[k])
        return message

    return lambda path: write_protobuf_log(path, [("/car", TIMES[k], one(k)) for k in range(N)])


def pb_transforms(path):
    reported = (FrameTransforms(transforms=[ParseDict(transform(k), FrameTransform())]) for k in range(N))
    return write_protobuf_log(path, [("/car", *sent) for sent in zip(TIMES, reported, strict=True)])


def pb_scene(path):
    return write_protobuf_log(path, [("/car", TIMES[k], scene([("car", *PLACE[k])])) for k in range(N)])


def in_json(schema, make):
    def one(k):
        return json.dumps({"timestamp": stamp(k, "nsec"), "frame_id": "map"} | make(k)).encode()

    return lambda path: write_log(
        path, [("/car", TIMES[k], one(k)) for k in range(N)], (schema, "jsonschema", b"{}"), "json"
    )


def fix(k):
    x, y = PLACE[k]
    return {
        "latitude": 48.0 + y / 111_200, "longitude": 11.0 + x / 74_500, "altitude": 0.0,
        "position_covariance": [0.0] * 9, "position_covariance_type": 0,
    }  # fmt: skip


def transform(k):
    return {
        "parent_frame_id": "map", "child_frame_id": "car",
        "translation": pose(k)["position"], "rotation": pose(k)["orientation"],
    }  # fmt: skip


def ros(schema, make):
    return lambda path: write_ros2_log(path, [("/car", TIMES[k], schema, make(k)) for k in range(N)])


def ros_transform(k):
    turned = {"translation": pose(k)["position"], "rotation": pose(k)["orientation"]}
    return {"transforms": [{"header": header(TIMES[k]), "child_frame_id": "car", "transform": turned}]}


def ros_fix(k):
    return fix(k) | {"header": header(TIMES[k], "gps"), "status": {"status": 0, "service": 1}}


def odometry(k):
    return {"body_frame_id": "car", "pose": pose(k), "linear_velocity": point(SPEED, 0, 0), "angular_velocity": STILL}


def foxglove_scene(k):
    nothing = {name: [] for name in ("arrows", "spheres", "cylinders", "lines", "triangles", "texts", "models")}
    cube = {"pose": pose(k), "size": point(4, 2, 1), "color": dict.fromkeys("rgba", 1.0)}
    entity = {
        "timestamp": stamp(k), "frame_id": "map", "id": "car", "lifetime": {"sec": 0, "nanosec": 0},
        "frame_locked": False, "metadata": [], "cubes": [cube], **nothing,
    }  # fmt: skip
    return {"deletions": [], "entities": [entity]}


NAMED = ["--topics", "/car"]
FOXGLOVE = {
    PoseInFrame: (lambda k: {"pose": pose(k)}, []), PosesInFrame: (lambda k: {"poses": [pose(k)]}, []),
    Odometry: (odometry, ["--frame", "map"]), FrameTransform: (transform, NAMED), LocationFix: (fix, ORIGIN),
    SceneUpdate: (foxglove_scene, []),
}  # fmt: skip
LOGS = {}
for kind, (make, options) in FOXGLOVE.items():
    name = kind.DESCRIPTOR.name
    LOGS |= {
        f"{name}, protobuf": (pb_scene if kind is SceneUpdate else in_protobuf(kind, make), options),
        f"{name}, JSON": (in_json(f"foxglove.{name}", make), options),
        f"{name}, ROS 2": (
            ros(f"foxglove_msgs/msg/{name}", lambda k, make=make: {"timestamp": stamp(k), "frame_id": "map"} | make(k)),
            options,
        ),
    }
LOGS |= {
    "FrameTransforms, protobuf": (pb_transforms, NAMED),
    "NavSatFix": (ros("sensor_msgs/msg/NavSatFix", ros_fix), ORIGIN),
    "tf2_msgs/TFMessage": (ros("tf2_msgs/msg/TFMessage", ros_transform), NAMED),
    "PoseStamped": (ros("geometry_msgs/msg/PoseStamped", lambda k: {"header": header(TIMES[k]), "pose": pose(k)}), []),
    "private JSON": (
        in_json("acme.Car", lambda k: {"car": {"e": PLACE[k][0], "n": PLACE[k][1]}}), ["--fields", "x=.car.e,y=.car.n"],
    ),
    "private ROS 2": (
        ros("acme/msg/Detections", lambda k: {
            "frame": "map", "detections": [{"kind": 1, "place": PLACE[k], "id": "car"}],
        }),
        ["--fields", "id=.detections[].id,x=.detections[].place[0],y=.detections[].place[1],frame=.frame"],
    ),
    "private protobuf": (
        in_protobuf(PoseInFrame, FOXGLOVE[PoseInFrame][0]),
        ["--fields", "x=.pose.position.x,y=.pose.position.y,time=.timestamp"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", LOGS)
def test_every_command_reads_it(tmp_path, capsys, name):
    """All commands read what `Reading.tracks` reads."""
    write, options = LOGS[name]
    if options == ORIGIN:
        pytest.importorskip("pyproj", reason="the extra geo is not installed")
    log = tmp_path / "log.mcap"
    write(log)
    assert run(["info", str(log), "--json", *(["--set", f"fields={options[1]}"] if "--fields" in options else [])]) == 0
    (topic,) = json.loads(capsys.readouterr().out)["topics"]
    assert topic["messages"] == N
    assert topic["tracks"] == (None if options == NAMED else 1)
    asked = {option.removeprefix("--"): value for option, value in zip(options[::2], options[1::2], strict=True)}
    tracks = Reading(asked).tracks([log]).tracks
    assert set(tracks.track_id.tolist()) <= {"car", "/car", "/car/0"}
    np.testing.assert_allclose(tracks.position, PLACE, atol=0.05)  # fixes are written by a sphere
    np.testing.assert_array_equal(tracks.time_ns, TIMES)
    np.testing.assert_allclose(tracks.speed[5:-5], SPEED, rtol=0.01)
    np.testing.assert_allclose(np.cos(tracks.direction - ANGLE - np.pi / 2)[5:-5], 1.0, atol=1e-4)
