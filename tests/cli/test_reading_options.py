"""Whatever reads a log has the options of reading, and they reach the library."""

import json

import pytest
from mcap.writer import Writer

from dirprim_filter.cli.main import run


def private_json(path):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/car", "json", writer.register_schema("acme.Car", "jsonschema", b"{}"))
        for k in range(80):
            writer.add_message(channel, k, json.dumps({"car": {"e": k, "n": 0}}).encode(), k)
        writer.finish()


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
    for option in ("topics", "time-source", "frame", "fields", "origin", "labels", "start", "end", "strict"):
        assert f"--{option} " in told


@pytest.mark.parametrize("command", [command for command in READERS if command not in NEED_A_MAP], ids=" ".join)
@pytest.mark.parametrize("option", [("--fields", "nonsense"), ("--origin", "north"), ("--start", "soon")])
def test_the_options_of_reading_reach_the_library(tmp_path, capsys, monkeypatch, command, option):
    monkeypatch.chdir(tmp_path)
    private_json(tmp_path / "log.mcap")
    assert run([*command, "log.mcap", *OUTPUTS.get(command[-1], []), *option]) == 1
    assert option[1] in capsys.readouterr().err
