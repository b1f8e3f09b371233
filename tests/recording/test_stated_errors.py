"""What schemas state of errors and identities is read, in each of their versions; and what is left is known."""

import json

import numpy as np
import pytest
import zstandard
from mcap_files import detections, json_log, stock, write_log
from ros_messages import DEFINITIONS, ROS, full_definition, header, point, write_ros2_log
from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_msg
from test_ros2_schemas import N_TIMES, NAMES, SCENE, START_NS, STEP_NS, array_log, detection

from dirprim_filter.cli.exit_codes import FAILED, INPUT_LOST
from dirprim_filter.cli.main import run
from dirprim_filter.recording.errors import NoTracksError
from dirprim_filter.recording.reader import FieldMapping, read_track_logs, read_tracks
from dirprim_filter.recording.schemas import decoders
from dirprim_filter.recording.schemas.families import FAMILIES


def log_of(path, schema, make):
    """A log of one topic in JSON."""
    return json_log(path, schema, [(START_NS + k * STEP_NS, make(k)) for k in range(N_TIMES)])


def result(class_id, score, xx, xy=0.0, yy=None):
    covariance = [xx, xy, *[0.0] * 4, xy, xx if yy is None else yy, *[0.0] * 28]
    pose = {"pose": SCENE.pose(0, 0), "covariance": covariance}
    return {"hypothesis": {"class_id": class_id, "score": score}, "pose": pose}


@pytest.mark.parametrize("xx", [-1.0, 0.0])
def test_the_covariance_of_a_detection_is_that_of_its_likeliest_result(tmp_path, xx):
    def items(k, _):
        return [
            detection(k, 0) | {"results": [result("cat", 0.2, 9.0), result("car", 0.8, 0.25, 0.1, 0.5)]},
            detection(k, 1) | {"results": [result("car", 0.5, 0.04)]},
            detection(k, 2) | {"results": [result("car", 0.5, xx)] * (k % 2)},  # unknown, as ROS says it; or no result
        ]

    path = array_log(tmp_path, "vision_msgs/msg/Detection3DArray", items)
    seen = detections(path).covariance.reshape(N_TIMES, 3, 2, 2)
    np.testing.assert_array_equal(seen[:, 0], [[[0.25, 0.1], [0.1, 0.5]]] * N_TIMES)
    np.testing.assert_array_equal(seen[:, 1], [0.04 * np.eye(2)] * N_TIMES)
    assert np.isnan(seen[:, 2]).all()


FLAT = "{} id\nfloat64 score\ngeometry_msgs/PoseWithCovariance pose"
SOURCE = "std_msgs/Header header\nObjectHypothesisWithPose[] results\nvision_msgs/BoundingBox3D bbox\n"
NESTED = "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose"
VERSIONS = {  # definitions by name; of a result; of a detection
    "4": ({}, lambda one: one, lambda name: {"id": name}),
    "3": (
        {"vision_msgs/ObjectHypothesis": "string id\nfloat64 score", "vision_msgs/Detection3D": SOURCE + "string id"},
        lambda one: one | {"hypothesis": {"id": "car", "score": 0.8}}, lambda name: {"id": name},
    ),
    "2": (
        {
            "vision_msgs/ObjectHypothesisWithPose": FLAT.format("string"),
            "vision_msgs/Detection3D": SOURCE + "bool is_tracking\nstring tracking_id",
        },
        lambda one: {"id": "car", "score": 0.8, "pose": one["pose"]},
        lambda name: {"is_tracking": True, "tracking_id": name},
    ),
    "0": (
        {"vision_msgs/ObjectHypothesisWithPose": FLAT.format("int64"), "vision_msgs/Detection3D": SOURCE},
        lambda one: {"id": 7, "score": 0.8, "pose": one["pose"]}, lambda name: {},
    ),
}  # fmt: skip


@pytest.mark.parametrize("version", VERSIONS)
def test_each_version_of_vision_msgs_is_read(tmp_path, version):
    changed, of_result, named = VERSIONS[version]

    def make(k):
        boxes = [detection(k, i) | {"results": [of_result(result("car", 0.8, 0.04))]} for i in range(3)]
        boxes = [{key: box[key] for key in box if key != "id"} | named(NAMES[i]) for i, box in enumerate(boxes)]
        return {"header": header(START_NS + k * STEP_NS), "detections": boxes}

    schema = "vision_msgs/msg/Detection3DArray"
    sent = [("/objects", START_NS + k * STEP_NS, schema, make(k)) for k in range(N_TIMES)]
    paths = log_of(tmp_path / "json.mcap", schema, make), write_ros2_log(tmp_path / "cdr.mcap", sent, changed)
    for path in paths:
        seen = detections(path, labels="7" if version == "0" else "car")
        np.testing.assert_array_equal(seen.covariance[:, 0, 0], [0.04] * 3 * N_TIMES)
        np.testing.assert_array_equal(seen.confidence, [0.8] * 3 * N_TIMES)
        assert set(seen.track_id.tolist()) == ({""} if version == "0" else set(NAMES))
        assert version == "0" or read_tracks(path).n_tracks == 3


@pytest.mark.parametrize("name", ["Detection3D", "BoundingBox3DArray"])
def test_boxes_alone_and_without_classes_are_read(tmp_path, name):
    def make(k):
        box = detection(k, 0)["bbox"]
        one = detection(k, 0) | {"header": header(START_NS + k * STEP_NS), "results": [result("car", 0.8, 0.04)]}
        return one if name == "Detection3D" else {"header": one["header"], "boxes": [box, box]}

    seen = detections(log_of(tmp_path / "log.mcap", f"vision_msgs/msg/{name}", make))
    n = 1 if name == "Detection3D" else 2
    np.testing.assert_allclose(seen.position, np.repeat(SCENE.place[:, 0, :2], n, axis=0))
    np.testing.assert_array_equal(seen.size[0], [4, 2, 1])
    if n == 1:
        assert (seen.track_id[0], seen.covariance[0, 0, 0]) == (NAMES[0], 0.04)


def fix(k, **more):
    """North at 10 m/s, by degrees clockwise from there."""
    stamp = header(START_NS + k * STEP_NS)
    return {
        "header": stamp, "status": {"status": 0}, "latitude": 48 + k / 111_194.9, "longitude": 11.0, "altitude": 0.0,
        "track": 0.0, "speed": 10.0, "position_covariance": [0.25, 0.1, 0, 0.1, 0.5, 0, 0, 0, 4],
        "position_covariance_type": 3, "err_horz": 4.9,
    } | more  # fmt: skip


def test_a_gps_fix_has_a_course_from_north_a_speed_and_errors(tmp_path):
    path = log_of(tmp_path / "log.mcap", "gps_msgs/msg/GPSFix", fix)
    tracks = read_tracks(path)
    np.testing.assert_allclose(tracks.speed, 10.0)
    np.testing.assert_allclose(tracks.direction, np.pi / 2)
    np.testing.assert_allclose(detections(path).covariance, [[[0.25, 0.1], [0.1, 0.5]]] * N_TIMES)
    log_of(path, "gps_msgs/msg/GPSFix", lambda k: fix(k, position_covariance_type=0, track=90.0 + k))
    np.testing.assert_allclose(read_tracks(path).direction, -np.deg2rad(np.arange(N_TIMES)), atol=1e-12)
    seen = detections(path).covariance  # 95 % of the errors are within 4.9 m
    within = np.linalg.norm(np.random.default_rng(0).multivariate_normal([0, 0], seen[0], 100_000), axis=1) < 4.9
    assert abs(within.mean() - 0.95) < 0.004
    log_of(path, "gps_msgs/msg/GPSFix", lambda k: fix(k, status={"status": -1}))
    with pytest.raises(NoTracksError):  # no fix
        detections(path)
    by_name = "latitude=.latitude,longitude=.longitude,time=.header.stamp,course_deg=.track,speed=.speed"
    log_of(path, "acme.Fix", lambda k: fix(k, track=90.0))
    np.testing.assert_allclose(read_tracks(path, mapping=FieldMapping.parse(by_name)).direction, 0.0, atol=1e-12)


def test_radar_tracks_state_the_upper_triangle(tmp_path):
    def make(k):
        one = {
            "uuid": {"uuid": "a"}, "position": point(k, 2, 0), "velocity": point(-9, 0, 0), "size": point(4, 2, 1),
            "classification": 2, "position_covariance": [0.25, 0.1, 0.0, 0.5, 0.0, 1.0],
        }  # fmt: skip
        return {"header": header(START_NS + k * STEP_NS), "tracks": [one]}

    path = log_of(tmp_path / "log.mcap", "radar_msgs/msg/RadarTracks", make)
    np.testing.assert_array_equal(detections(path, labels="dynamic").covariance, [[[0.25, 0.1], [0.1, 0.5]]] * N_TIMES)
    np.testing.assert_allclose(read_tracks(path).speed, 10.0)  # not -9 m/s, which is relative to the radar


ERRORS = ("covariance", "rmse", "err_", "std", "probability", "score", "certainty", "availability", "has_")
KNOWINGLY_NOT = {
    "velocities and what follows": "twist_with_covariance acceleration_with_covariance .twist.covariance "
    "velocity_covariance accel.covariance has_twist_covariance",
    "how sure its class is": "classification_certainty",
}
"""The filter measures positions; a confidence is of existence."""


DEFINED = [name for name in FAMILIES if name in ROS.fielddefs or name.replace("/msg/", "/") in DEFINITIONS]


@pytest.mark.parametrize("name", DEFINED)
def test_what_a_ros_schema_states_of_errors_is_read_or_knowingly_not(name):
    stated = _leaves(get_types_from_msg(full_definition(name), name), name)
    paths = [one.path.replace("[]", "") for one in FAMILIES[name].fields.values()]
    left = " ".join(KNOWINGLY_NOT.values()).split()
    for leaf in stated:
        if any(word in leaf for word in ERRORS):
            assert any(name in leaf for name in left) or any(path.startswith(leaf) for path in paths), leaf


def _leaves(types, name, at=""):
    """Paths of all fields, without brackets."""
    for field, kind in types[name][1]:
        yield (path := f"{at}.{field}")
        node, of = kind[1][0] if kind[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE) else kind
        if node == Nodetype.NAME:
            yield from _leaves(types, of, path)


def test_why_messages_are_not_read_reaches_the_one_line_and_info_ends_with_3(tmp_path, capsys):
    text = b"p/I[] items\n" + b"=" * 80 + b"\nMSG: p/I\nfloat64 x\nfloat64 y"
    sent = [("/objects", k, b"\x00\x0b\x00\x00" + bytes(24)) for k in range(20)] + [("/image", 0, b"")]
    log = write_log(tmp_path / "log.mcap", sent, ("p/msg/M", "ros2msg", text), "cdr")
    fields = ["--set", "fields=x=.items[].x,y=.items[].y", "--topics", "/objects|/image"]
    why = "20 of 20 messages of /objects{}: encapsulation 0x000b (PL_CDR2), which is not read"
    assert run(["info", str(log), *fields]) == INPUT_LOST
    assert why.format("") in capsys.readouterr().out
    for asked in (fields[:2], fields):
        assert run(["learn", str(log), "-o", str(tmp_path / "m"), *asked]) == FAILED
    said = capsys.readouterr().err
    assert why.format(" cannot be decoded") in said
    assert "choose a topic" not in said
    assert run(["info", str(log), "--json", *fields]) == INPUT_LOST
    of = {topic["name"]: topic for topic in json.loads(capsys.readouterr().out)["topics"]}
    assert (of["/objects"]["undecodable"], of["/image"]["undecodable"]) == (20, 1)


NOT_READ = [  # schema, encoding, a message; why, and how often it is reported
    *((("std_msgs/String", "", b""), encoding, b"", f"messages encoded as {encoding or 'nothing'} are not read", 4)
      for encoding in ("flatbuffer", "", "cdr2")),
    (("vision_msgs/msg/Detection2DArray", "", b""), "json", b"{}", "boxes in an image are no places on the ground", 3),
    (("geometry_msgs/msg/PoseStamped", "ros2msg", b"uint8 a"), "cdr", b"\0\1\0\0\0", "definition lacks", 6),
]  # fmt: skip


@pytest.mark.parametrize("case", NOT_READ)
def test_what_is_not_read_says_why_and_no_topic_is_advised(tmp_path, capsys, case):
    schema, encoding, data, why, n = case
    log = write_log(tmp_path / "log.mcap", [(f"/topic_{i}", i, data) for i in range(2)], schema, encoding)
    assert run(["info", str(log)]) == (INPUT_LOST if encoding == "cdr" else 0)
    for more in ([], ["--topics", "/topic_0"], ["--set", "fields=x=.x,y=.y"]):
        assert run(["learn", str(log), "-o", str(tmp_path / "m"), *more]) == FAILED
    said = "".join(capsys.readouterr())
    assert said.count(why) == n
    assert "choose a topic" not in said


def test_a_decimal_fraction_is_no_whole_nanoseconds_and_time_s_is_named(tmp_path, capsys):
    path = log_of(tmp_path / "log.mcap", "acme.Car", lambda k: {"t": 1.7e9 + k / 10 + 0.05, "x": k, "y": 0})
    assert run(["learn", str(path), "-o", str(tmp_path / "m"), "--set", "fields=x=.x,y=.y,time=.t"]) == FAILED
    said = capsys.readouterr().err
    assert "12 of 12 messages of /objects cannot be decoded" in said
    assert "time_s= takes seconds" in said
    assert len(read_tracks(path, mapping=FieldMapping.parse("x=.x,y=.y,time_s=.t"))) == N_TIMES


@pytest.mark.parametrize("is_stated", [True, False])
def test_track_says_which_of_two_stated_errors_counts(tmp_path, capsys, is_stated):
    def items(k, _):
        return [detection(k, i) | {"results": [result("car", 0.5, 0.04 * is_stated)]} for i in range(3)]

    log = array_log(tmp_path, "vision_msgs/msg/Detection3DArray", items)
    assert run(["learn", str(log), "-o", str(tmp_path / "map")]) == 0
    (tmp_path / "s.toml").write_text("[along]\nspread_m = 1.0\n[across]\nspread_m = 1.0\n")
    for given, line in (
        (["--sensor", str(tmp_path / "s.toml")], "its covariances are not used"),
        (["--noise", "1"], "its covariances are used"),
    ):
        command = ["track", str(log), "--map", str(tmp_path / "map"), "-o", str(tmp_path / "out"), "--force"]
        run([*command, *given, "--particles", "50"])
        assert capsys.readouterr().err.count(line) == is_stated


def compressed(data):
    return zstandard.ZstdCompressor().compress(data)


def test_messages_that_rosbag2_compressed_one_by_one_are_read_and_those_that_are_broken_counted(tmp_path, monkeypatch):
    """As `compression_mode: MESSAGE` writes them, transforms too; a bomb is refused before it is unpacked."""
    plain = array_log(tmp_path, "vision_msgs/msg/Detection3DArray")
    sent = stock(plain)
    schema = (sent[0][0].name, "ros2msg", sent[0][0].data)

    def packed(*broken):
        contents = [("/objects", sent[0][2].log_time, data) for data in broken]
        contents += [("/objects", message.log_time, compressed(message.data)) for *_, message in sent]
        return read_track_logs(write_log(tmp_path / "packed.mcap", contents, schema, "cdr"))

    whole = read_tracks(plain)
    assert packed().tracks == whole
    log = packed(compressed(bytes(1 << 28)), compressed(bytes(99))[:-3])
    assert log.tracks == whole
    why = "encapsulation 0x28b5 (zstd that does not decompress, or to far more than it is), which is not read"
    assert log.losses.why == {why: 2}
    monkeypatch.setattr(decoders, "SMALL_BYTES", 1 << 16)
    log = packed(*[compressed(bytes(1 << 15))] * 9)  # each is small, all together are not
    assert log.tracks == whole
    assert next(n for why, n in log.losses.why.items() if "zstd" in why) == 9 - (1 << 16) // (1 << 15)
