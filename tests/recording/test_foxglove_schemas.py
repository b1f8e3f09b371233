"""Foxglove's schemas in protobuf, JSON and ROS 2, by independent writers; fields of any schema by their paths."""

import numpy as np
import pytest
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.LocationFixes_pb2 import LocationFixes
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from mcap_files import json_log, scene, write_protobuf_log
from ros_messages import header, write_ros2_log

from dirprim_filter.cli.main import run
from dirprim_filter.origin import Origin, _topocentric
from dirprim_filter.recording.errors import MissingExtraError, NoTracksError
from dirprim_filter.recording.losses import INVALID, UNDECODABLE
from dirprim_filter.recording.reader import read_track_logs, read_tracks
from dirprim_filter.recording.schemas.family import FieldMapping

START_NS = 1_700_000_000_000_000_000
STEP_NS = 100_000_000
N = 20
ANGLE = 0.05 * np.arange(N)
PLACE = np.column_stack([20 * np.cos(ANGLE), 20 * np.sin(ANGLE)])
TIMES = (START_NS + STEP_NS * np.arange(N)).tolist()


def check_circle(tracks, times=TIMES):
    assert tracks.time_ns.tolist() == times
    np.testing.assert_array_equal(tracks.position, PLACE)
    tangent = ANGLE + np.pi / 2
    np.testing.assert_allclose(np.cos(tracks.direction - tangent)[5:-5], 1.0, atol=1e-6)
    np.testing.assert_allclose(tracks.speed[5:-5], 10.0, rtol=5e-3)


def stamped(message, k):
    message.timestamp.FromNanoseconds(TIMES[k])
    message.frame_id = "map"
    return message


def fix(k, kind=LocationFix):
    """On a circle of 20 m about a place in Munich, by the radii of curvature there: an independent formula."""
    latitude, a, e2 = np.radians(48.137), 6378137.0, 6.69437999014e-3
    w = np.sqrt(1 - e2 * np.sin(latitude) ** 2)
    one = kind()
    one.latitude = 48.137 + np.degrees(PLACE[k, 1] / (a * (1 - e2) / w**3))
    one.longitude = 11.575 + np.degrees(PLACE[k, 0] / (a / w * np.cos(latitude)))
    return one


def test_satellite_fixes_come_on_a_local_plane(tmp_path, caplog, monkeypatch):
    pytest.importorskip("pyproj", reason="the extra geo is not installed")
    fixes, several = [], []
    for k in range(N):
        one = stamped(fix(k), k)
        fixes.append(("/gps", TIMES[k], one))
        several.append(("/gps", TIMES[k], LocationFixes(fixes=[one])))
    ros = [
        ("/gps", TIMES[k], "sensor_msgs/msg/NavSatFix", {
            "header": header(TIMES[k], "gps"), "status": {"status": 0 if k else -1, "service": 1},
            "latitude": fix(k).latitude, "longitude": fix(k).longitude, "altitude": 0.0,
            "position_covariance": [0.0] * 9, "position_covariance_type": 0,
        })
        for k in range(N)
    ]  # fmt: skip
    origin = Origin.parse("48.137,11.575")
    path = write_protobuf_log(tmp_path / "log.mcap", fixes)
    for log in (path, write_protobuf_log(tmp_path / "several.mcap", several)):
        tracks = read_tracks(log, origin=origin, time_source="header")
        np.testing.assert_allclose(tracks.position, PLACE, atol=1e-3)
        assert set(tracks.track_id) == {"/gps"}
    assert caplog.text == ""
    started = read_tracks(path)
    np.testing.assert_allclose(started.position - started.position[0], PLACE - PLACE[0], atol=1e-3)
    assert f"--set origin={started.origin}" in caplog.text
    np.testing.assert_allclose(origin.to_plane(np.array([started.origin])), np.sort(PLACE, axis=0)[[9]], atol=1e-3)
    log = read_track_logs(write_ros2_log(tmp_path / "ros.mcap", ros), origin=origin)
    np.testing.assert_allclose(log.tracks.position, PLACE[1:], atol=1e-3)
    assert log.losses.dropped[INVALID] == 1
    monkeypatch.setitem(__import__("sys").modules, "pyproj", None)
    _topocentric.cache_clear()
    with pytest.raises(MissingExtraError, match=r"pip install 'dirprim-filter\[geo\]'"):
        read_tracks(path)


@pytest.mark.parametrize(
    ("latitude", "longitude", "altitude"),
    [(95.0, 11.5, 0.0), (0.0, 0.0, 0.0), (48.0, 1e300, 0.0), (float("inf"), 11.5, 0.0), (48.0, 11.5, 1e308)],
)
@pytest.mark.parametrize("at", [0, 7])
def test_what_is_no_fix_is_left_out_before_it_can_become_the_origin(tmp_path, at, latitude, longitude, altitude):
    pytest.importorskip("pyproj", reason="the extra geo is not installed")
    bad = stamped(LocationFix(latitude=latitude, longitude=longitude, altitude=altitude), at)
    fixes = [("/gps", TIMES[k], stamped(fix(k), k)) for k in range(N)]
    fixes[at] = ("/gps", TIMES[at], bad)
    log = read_track_logs(write_protobuf_log(tmp_path / "log.mcap", fixes), time_source="header")
    assert (log.losses.dropped[INVALID], log.losses.dropped.total(), len(log.tracks)) == (1, 1, N - 1)
    if altitude == 0.0:
        good = np.delete(PLACE, at, axis=0)
        np.testing.assert_allclose(log.tracks.position, good - np.sort(good, axis=0)[9], atol=1e-3)


@pytest.mark.parametrize("x", [1e308, -1e308, 1e9, float("nan")])
def test_a_position_off_the_earth_costs_its_row(tmp_path, x):
    def message(k, x):
        return {"id": 4, "x": x, "y": 0.0, "stamp": TIMES[k]}

    reported = [(TIMES[k], message(k, x * (-1) ** k if k in (3, 4) else float(k))) for k in range(N)]
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
    x, y = PLACE[k].tolist()
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
    path = write_protobuf_log(tmp_path / "log.mcap", [("/ego", TIMES[0], stamped(PoseInFrame(), 0))])
    with pytest.raises(NoTracksError, match=r"fields x=.pose.lost,y=.pose.position.y.*lacks"):
        read_tracks(path, mapping=FieldMapping({"x": ".pose.lost", "y": ".pose.position.y"}))


def test_columns_beside_each_other_are_read_and_unlike_lengths_fail(tmp_path):
    messages = [(TIMES[k], {"x": [PLACE[k, 0], 1.0], "y": [PLACE[k, 1], 2.0], "id": ["a", "b"]}) for k in range(N)]
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
