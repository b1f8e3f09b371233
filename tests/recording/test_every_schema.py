"""Each schema and encoding that is read, by independent writers; fixes; fields of any schema by their paths."""

import json

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.LocationFixes_pb2 import LocationFixes
from foxglove_schemas_protobuf.Odometry_pb2 import Odometry
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.json_format import ParseDict
from mcap_files import json_log, scene, write_protobuf_log
from ros_messages import header, point, quaternion, ros_transform, write_ros2_log

from dirprim_filter.cli.main import run
from dirprim_filter.cli.reading import Reading
from dirprim_filter.origin import Origin, _topocentric
from dirprim_filter.recording.errors import MissingExtraError, NoTracksError
from dirprim_filter.recording.losses import INVALID, UNDECODABLE
from dirprim_filter.recording.reader import read_track_logs, read_tracks
from dirprim_filter.recording.schemas.family import FieldMapping

N, STEP_NS, START_NS = 80, 100_000_000, 1_700_000_000_000_000_000
TIMES = (START_NS + STEP_NS * np.arange(N)).tolist()
ANGLE = 0.05 * np.arange(N)
PLACE = np.column_stack([20 * np.cos(ANGLE), 20 * np.sin(ANGLE)]).tolist()
SPEED = 10.0
STILL = point(0, 0, 0)
ORIGIN = ["--origin", "48.137,11.575"]


def check_circle(tracks, times=TIMES, *, atol=0.0):
    assert tracks.time_ns.tolist() == times
    np.testing.assert_allclose(tracks.position, PLACE, atol=atol, rtol=0)
    np.testing.assert_allclose(tracks.speed[5:-5], SPEED, rtol=5e-3)
    np.testing.assert_allclose(np.cos(tracks.direction - ANGLE - np.pi / 2)[5:-5], 1.0, atol=1e-4)


def stamp(k, nanos="nanosec"):
    return {"sec": TIMES[k] // 10**9, nanos: TIMES[k] % 10**9}


def pose(k):
    """Where the vehicle is, and which way it points, as ROS and JSON have it."""
    return {"position": point(*PLACE[k], 0), "orientation": quaternion(0, 0, ANGLE[k] + np.pi / 2)}


def parsed(kind, make):
    """Makes messages of a kind out of what `make` says of them in JSON."""

    def one(k):
        message = ParseDict({"frame_id": "map"} | make(k), kind(), ignore_unknown_fields=True)
        message.timestamp.FromNanoseconds(TIMES[k])
        return message

    return one


def in_protobuf(one):
    return lambda path: write_protobuf_log(path, [("/car", TIMES[k], one(k)) for k in range(N)])


def in_json(schema, make):
    def one(k):
        return TIMES[k], {"timestamp": stamp(k, "nsec"), "frame_id": "map"} | make(k)

    return lambda path: json_log(path, schema, map(one, range(N)), topic="/car")


def fix(k):
    """On the circle about a place in Munich, by the radii of curvature there: an independent formula."""
    latitude, a, e2 = np.radians(48.137), 6378137.0, 6.69437999014e-3
    w = np.sqrt(1 - e2 * np.sin(latitude) ** 2)
    return {
        "latitude": 48.137 + float(np.degrees(PLACE[k][1] / (a * (1 - e2) / w**3))),
        "longitude": 11.575 + float(np.degrees(PLACE[k][0] / (a / w * np.cos(latitude)))), "altitude": 0.0,
        "position_covariance": [0.0] * 9, "position_covariance_type": 0,
    }  # fmt: skip


def transform(k):
    return {
        "parent_frame_id": "map", "child_frame_id": "car",
        "translation": pose(k)["position"], "rotation": pose(k)["orientation"],
    }  # fmt: skip


def ros(schema, make):
    return lambda path: write_ros2_log(path, [("/car", TIMES[k], schema, make(k)) for k in range(N)])


def ros_fix(k, status=0):
    return fix(k) | {"header": header(TIMES[k], "gps"), "status": {"status": status, "service": 1}}


def odometry(k):
    return {"body_frame_id": "car", "pose": pose(k), "linear_velocity": point(SPEED, 0, 0), "angular_velocity": STILL}


def drawn_car(k):
    return scene([("car", *PLACE[k])])


def foxglove_scene(k):
    cube = {"pose": pose(k), "size": point(4, 2, 1)}
    return {"entities": [{"timestamp": stamp(k), "frame_id": "map", "id": "car", "cubes": [cube]}]}


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
        f"{name}, protobuf": (in_protobuf(drawn_car if kind is SceneUpdate else parsed(kind, make)), options),
        f"{name}, JSON": (in_json(f"foxglove.{name}", make), options),
        f"{name}, ROS 2": (
            ros(f"foxglove_msgs/msg/{name}", lambda k, make=make: {"timestamp": stamp(k), "frame_id": "map"} | make(k)),
            options,
        ),
    }
LOGS |= {
    "FrameTransforms, protobuf": (in_protobuf(
        lambda k: FrameTransforms(transforms=[ParseDict(transform(k), FrameTransform())])
    ), NAMED),
    "NavSatFix": (ros("sensor_msgs/msg/NavSatFix", ros_fix), ORIGIN),
    "tf2_msgs/TFMessage": (ros("tf2_msgs/msg/TFMessage", lambda k: {
        "transforms": [ros_transform(TIMES[k], "map", "car", (*PLACE[k], 0), ANGLE[k] + np.pi / 2)],
    }), NAMED),
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
        in_protobuf(parsed(PoseInFrame, FOXGLOVE[PoseInFrame][0])),
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
    check_circle(tracks, atol=1e-3 if options == ORIGIN else 1e-6)  # some are written in 32 bits


fix_message = parsed(LocationFix, fix)


def test_satellite_fixes_come_on_a_local_plane(tmp_path, caplog, monkeypatch):
    pytest.importorskip("pyproj", reason="the extra geo is not installed")
    several = [("/gps", TIMES[k], LocationFixes(fixes=[fix_message(k)])) for k in range(N)]
    origin = Origin.parse("48.137,11.575")
    tracks = read_tracks(write_protobuf_log(tmp_path / "several.mcap", several), origin=origin, time_source="header")
    check_circle(tracks, atol=1e-3)
    assert set(tracks.track_id) == {"/gps"}
    assert caplog.text == ""
    path = write_protobuf_log(tmp_path / "log.mcap", [("/gps", TIMES[k], fix_message(k)) for k in range(N)])
    started = read_tracks(path)
    np.testing.assert_allclose(started.position - started.position[0], np.subtract(PLACE, PLACE[0]), atol=1e-3)
    assert f"--set origin={started.origin}" in caplog.text
    middle = np.sort(PLACE, axis=0)[[(N - 1) // 2]]
    np.testing.assert_allclose(origin.to_plane(np.array([started.origin])), middle, atol=1e-3)
    ros = [("/gps", TIMES[k], "sensor_msgs/msg/NavSatFix", ros_fix(k, status=-(k == 0))) for k in range(N)]
    log = read_track_logs(write_ros2_log(tmp_path / "ros.mcap", ros), origin=origin)
    np.testing.assert_allclose(log.tracks.position, PLACE[1:], atol=1e-3)
    assert log.losses.dropped[INVALID] == 1
    monkeypatch.setitem(__import__("sys").modules, "pyproj", None)
    _topocentric.cache_clear()
    with pytest.raises(MissingExtraError, match=r"pip install 'dirprim-filter\[geo\]'"):
        read_tracks(path)


@pytest.mark.parametrize("wrong", [{"latitude": 95.0}, {"longitude": 1e300}, {"latitude": np.inf}, {"altitude": 1e308}])
def test_what_is_no_fix_is_left_out_before_it_can_become_the_origin(tmp_path, wrong):
    """Placeholders too, as `test_origins.py` has them."""
    pytest.importorskip("pyproj", reason="the extra geo is not installed")
    fixes = [("/gps", TIMES[k], fix_message(k)) for k in range(N)]
    for name, value in wrong.items():
        setattr(fixes[0][2], name, value)
    log = read_track_logs(write_protobuf_log(tmp_path / "log.mcap", fixes), time_source="header")
    assert (log.losses.dropped[INVALID], log.losses.dropped.total(), len(log.tracks)) == (1, 1, N - 1)
    good = np.array(PLACE[1:])
    np.testing.assert_allclose(log.tracks.position, good - np.sort(good, axis=0)[(N - 1) // 2], atol=1e-3)


@pytest.mark.parametrize("x", [1e308, -1e308, 1e9, float("nan")])
def test_a_position_off_the_earth_costs_its_row(tmp_path, x):
    at = [x * (-1) ** k if k in (3, 4) else float(k) for k in range(N)]
    reported = [(TIMES[k], {"id": 4, "x": at[k], "y": 0.0, "stamp": TIMES[k]}) for k in range(N)]
    path = json_log(tmp_path / "log.mcap", "acme.Car", reported)
    mapping = FieldMapping.parse("id=.id,x=.x,y=.y,time=.stamp")
    log = read_track_logs(path, mapping=mapping, time_source="header")
    assert (log.losses.dropped[INVALID], log.losses.dropped.total()) == (2, 2)
    np.testing.assert_allclose(log.tracks.speed, 10.0)


@pytest.mark.parametrize("text", ["48", "a,b", "91,0", "48,11,3", "nan,0"])
def test_what_is_no_origin_is_refused(text):
    with pytest.raises(ValueError, match="origin: expected latitude,longitude"):
        Origin.parse(text)


def private(k):
    x, y = PLACE[k]
    course = np.degrees(ANGLE[k]) + 90
    return {
        "when": k * 0.1, "frame": "map",
        "list": [
            {"name": 4, "at": [x, y], "course": course, "v": 36.0, "box": {"l": 4.25}},
            {"name": 5, "at": [0, 1], "course": 0, "v": 0},
        ],
    }  # fmt: skip


def test_fields_of_a_private_schema_are_found_by_their_paths(tmp_path):
    path = json_log(tmp_path / "log.mcap", "acme.Objects", [(TIMES[k], private(k)) for k in range(N)])
    with pytest.raises(NoTracksError, match=r"/objects \(acme.Objects\)"):
        read_tracks(path)
    mapping = FieldMapping.parse(
        "id=.list[].name, x=.list[].at[0],y=.list[].at[1],direction_deg=.list[].course,speed_kmh=.list[].v,"
        "time_s=.when,frame=.frame,length=.list[].box.l"
    )
    tracks = read_tracks(path, mapping=mapping, time_source="header")
    car = tracks[tracks.track_id == 4]
    np.testing.assert_allclose(car.speed, 10.0)
    np.testing.assert_allclose(np.cos(car.direction - ANGLE - np.pi / 2), 1.0)
    check_circle(car, [k * STEP_NS for k in range(N)])
    np.testing.assert_array_equal(car.size, [[4.25, np.nan, np.nan]] * N)
    assert FieldMapping.parse(str(mapping)) == mapping


@pytest.mark.parametrize("encoding", ["json", "protobuf"])
def test_info_says_that_paths_lead_nowhere(tmp_path, capsys, encoding):
    """JSON has no schema that would say so: every message lacks them."""
    path = json_log(tmp_path / "log.mcap", "acme.Objects", [(TIMES[k], private(k)) for k in range(N)])
    if encoding == "protobuf":
        path = write_protobuf_log(tmp_path / "log.mcap", [("/objects", 0, scene([("a", 0.0, 0.0)]))])
    assert run(["info", str(path), "--set", "fields=id=.lost[].id,x=.lost[].x,y=.lost[].y"]) == 0
    said = capsys.readouterr()
    assert "tracks in" not in said.out
    assert "expected objects at id=.lost[].id,x=.lost[].x,y=.lost[].y, got none" in said.err


def test_a_path_that_a_definition_lacks_is_named(tmp_path):
    path = write_protobuf_log(tmp_path / "log.mcap", [("/ego", TIMES[0], PoseInFrame(frame_id="map"))])
    with pytest.raises(NoTracksError, match=r"fields x=.pose.lost,y=.pose.position.y.*lacks"):
        read_tracks(path, mapping=FieldMapping({"x": ".pose.lost", "y": ".pose.position.y"}))


def test_columns_beside_each_other_are_read_and_unlike_lengths_fail(tmp_path):
    messages = [(TIMES[k], {"x": [PLACE[k][0], 1.0], "y": [PLACE[k][1], 2.0], "id": ["a", "b"]}) for k in range(N)]
    messages[4][1]["y"].append(3.0)
    path = json_log(tmp_path / "log.mcap", "acme.Columns", messages)
    log = read_track_logs(path, mapping=FieldMapping.parse("x=.x[],y=.y[],id=.id[]"), time_source="publish")
    assert log.losses.dropped[UNDECODABLE] == 1
    assert ".y[]: expected as many as of .x[]" in str(log.losses)
    car = log.tracks[log.tracks.track_id == "a"]
    np.testing.assert_array_equal(car.position, np.delete(PLACE, 4, axis=0))


@pytest.mark.parametrize(
    "text",
    ["x=.a", "x=.a,y=b", "x=.a,y=.b,z", "x=.a,y=.b,x=.c", "x=.a,y=.b,colour=.c", "x=.a,y=.b,vx=.c", "",
     "x=.a,y=.b,speed=.c,speed_kmh=.d"],
)  # fmt: skip
def test_what_is_no_mapping_is_refused(text):
    with pytest.raises(ValueError, match="field"):
        FieldMapping.parse(text)
