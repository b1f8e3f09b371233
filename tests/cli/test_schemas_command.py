"""`learn` and `track` run on a log of each schema that an independent writer wrote."""

import json

import numpy as np
import pytest
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Odometry_pb2 import Odometry
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set
from mcap_ros2.writer import Writer as Ros2Writer

from dirprim_filter.cli.main import run
from dirprim_filter.recording import read_estimates

N, STEP_NS, START_NS = 80, 100_000_000, 1_700_000_000_000_000_000
TIMES = (START_NS + STEP_NS * np.arange(N)).tolist()
ANGLE = 0.05 * np.arange(N)
PLACE = np.column_stack([20 * np.cos(ANGLE), 20 * np.sin(ANGLE)]).tolist()


def protobuf(path, make):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for k, (x, y) in enumerate(PLACE):
            message = make(x, y)
            if k == 0:
                definition = build_file_descriptor_set(type(message)).SerializeToString()
                schema = writer.register_schema(message.DESCRIPTOR.full_name, "protobuf", definition)
                channel = writer.register_channel("/car", "protobuf", schema)
            message.timestamp.FromNanoseconds(TIMES[k])
            writer.add_message(channel, TIMES[k], message.SerializeToString(), TIMES[k])
        writer.finish()


def pose(x, y):
    message = PoseInFrame(frame_id="map")
    message.pose.position.x, message.pose.position.y = x, y
    return message


def odometry(x, y):
    message = Odometry(frame_id="map", body_frame_id="car")
    message.pose.position.x, message.pose.position.y = x, y
    return message


def fix(x, y):
    return LocationFix(latitude=48.0 + y / 111_200, longitude=11.0 + x / 74_500)


def private_json(path):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/car", "json", writer.register_schema("acme.Car", "jsonschema", b"{}"))
        for k, (x, y) in enumerate(PLACE):
            writer.add_message(channel, TIMES[k], json.dumps({"car": {"e": x, "n": y}}).encode(), TIMES[k])
        writer.finish()


DETECTIONS = """string frame
pkg/Detection[] detections
================================================================================
MSG: pkg/Detection
uint8 kind
float32[2] place
string id"""


def private_ros(path):
    with path.open("wb") as file:
        writer = Ros2Writer(file)
        schema = writer.register_msgdef("pkg/msg/Detections", DETECTIONS)
        for k, place in enumerate(PLACE):
            message = {"frame": "map", "detections": [{"kind": 1, "place": place, "id": "car"}]}
            writer.write_message("/car", schema, message, log_time=TIMES[k], publish_time=TIMES[k])
        writer.finish()


LOGS = {
    "pose": (lambda path: protobuf(path, pose), []),
    "odometry": (lambda path: protobuf(path, odometry), ["--frame", "map"]),
    "fix": (lambda path: protobuf(path, fix), ["--origin", "48,11"]),
    "json": (private_json, ["--fields", "x=.car.e,y=.car.n"]),
    "ros": (private_ros, ["--fields", "id=.detections[].id,x=.detections[].place[0],y=.detections[].place[1]"]),
}


@pytest.mark.parametrize("name", LOGS)
def test_learn_and_track_run(tmp_path, name):
    write, options = LOGS[name]
    log, learned, out = (tmp_path / f"{part}.mcap" for part in ("log", "map", "out"))
    write(log)
    assert (
        run(
            [
                "learn",
                str(log),
                "-o",
                str(learned),
                "--cell-size",
                "10",
                "--modes",
                "dbscan",
                "--primitive",
                "flat",
                *options,
            ]
        )
        == 0
    )
    assert run(["track", str(log), "--map", str(learned), "-o", str(out), "--particles", "50", *options]) == 0
    estimates = read_estimates(out)
    assert len(estimates) == N
    np.testing.assert_allclose(estimates.position, PLACE, atol=2.0)


READERS = (
    ["learn"], ["track"], ["forecast"], ["replay"],
    ["evaluate", "density"], ["evaluate", "cues"], ["evaluate", "tracking"], ["evaluate", "forecast"],
)  # fmt: skip
OUTPUTS = {"learn": ["-o", "out.mcap"], "replay": ["--rate", "inf", "--save", "out.rrd"]}
NEED_A_MAP = (["track"], ["forecast"])


@pytest.mark.parametrize("command", READERS, ids=" ".join)
def test_whatever_reads_a_log_has_the_options_of_reading(capsys, command):
    assert run([*command, "--help"]) == 0
    told = capsys.readouterr().out
    for option in ("topics", "time-source", "frame", "fields", "origin", "start", "end", "strict"):
        assert f"--{option} " in told


@pytest.mark.parametrize("command", [command for command in READERS if command not in NEED_A_MAP], ids=" ".join)
@pytest.mark.parametrize("option", [("--fields", "nonsense"), ("--origin", "north"), ("--start", "soon")])
def test_the_options_of_reading_reach_the_library(tmp_path, capsys, monkeypatch, command, option):
    monkeypatch.chdir(tmp_path)
    private_json(tmp_path / "log.mcap")
    assert run([*command, "log.mcap", *OUTPUTS.get(command[-1], []), *option]) == 1
    assert option[1] in capsys.readouterr().err
