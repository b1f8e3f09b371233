"""Whatever reads a log has the options of reading, and they reach the library."""

import json

import pytest
from mcap.writer import Writer

from dirprim_filter import save_map, write_tracks
from dirprim_filter.cli.main import run
from dirprim_filter.cli.options import time_ns
from dirprim_filter.recording.objects.options import FromStart


def private_json(path):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/car", "json", writer.register_schema("acme.Car", "jsonschema", b"{}"))
        for k in range(80):
            writer.add_message(channel, k, json.dumps({"car": {"e": k, "n": 0}}).encode(), k)
        writer.finish()


READERS = (
    ["info"], ["learn"], ["track"], ["view"],
    ["evaluate", "density"], ["evaluate", "cues"], ["evaluate", "tracking"], ["evaluate", "forecast"],
)  # fmt: skip
GRID = ["--tessellation", "grid", "--cell-size", "8"]
OUTPUTS = {"learn": ["-o", "out.mcap"], "view": ["--rate", "inf", "--save", "out.rrd"]}
NEED_A_MAP = (["track"],)


@pytest.mark.parametrize("command", READERS, ids=" ".join)
def test_whatever_reads_a_log_has_the_options_of_reading(capsys, command):
    assert run([*command, "--help"]) == 0
    reported = capsys.readouterr().out
    for option in ("topics", "time-source", "start", "end", "strict", "set"):
        assert f"--{option} " in reported
    assert "frame, fields, origin, labels, group" in " ".join(reported.split())


@pytest.mark.parametrize("command", [command for command in READERS if command not in NEED_A_MAP], ids=" ".join)
@pytest.mark.parametrize("option", [("--set", "fields=nonsense"), ("--set", "origin=north"), ("--start", "soon")])
def test_the_options_of_reading_reach_the_library(tmp_path, capsys, monkeypatch, command, option):
    monkeypatch.chdir(tmp_path)
    private_json(tmp_path / "log.mcap")
    assert run([*command, "log.mcap", *OUTPUTS.get(command[-1], []), *option]) == 1
    assert option[1].rpartition("=")[2] in capsys.readouterr().err


ON_DAMAGE = {
    "learn": ["log.mcap", *GRID, "-o"],
    "track": ["log.mcap", "--map", "map.mcap", "--particles", "20", "-o"],
    "view": ["log.mcap", "--rate", "inf", "--save"],
}


@pytest.mark.parametrize("command", NEED_A_MAP, ids=" ".join)
def test_asking_for_what_a_log_does_not_hold_is_an_error_and_leaves_no_file(
    tmp_path, ring_map, ring, capsys, monkeypatch, *, command
):
    monkeypatch.chdir(tmp_path)
    write_tracks(ring[ring.track_id < 2], tmp_path / "log.mcap")
    save_map(ring_map, tmp_path / "map.mcap")
    before = set(tmp_path.iterdir())
    for option in (["--set", "group=99"], ["--set", "labels=bus"], ["--start", "9000000000000000ns"]):
        assert run([*command, *ON_DAMAGE[command[0]], "out.mcap", *option]) == 1
        reported = capsys.readouterr().err
        assert f"log.mcap: expected moving objects {' '.join(option).removeprefix('--set ')}, got none" in reported
        assert set(tmp_path.iterdir()) == before


def test_a_damaged_log_ends_in_3_and_in_an_error_where_strict(tmp_path, ring, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_tracks(ring[ring.track_id < 8], tmp_path / "whole.mcap")
    assert run(["learn", "whole.mcap", "-o", "map.mcap", *GRID]) == 0
    (tmp_path / "log.mcap").write_bytes((tmp_path / "whole.mcap").read_bytes()[:-30])
    for command, arguments in ON_DAMAGE.items():
        assert run([command, *arguments, f"{command}.out"]) == 3
        capsys.readouterr()
        assert run([command, *arguments, "strict", "--strict"]) == 1
        assert "expected an undamaged log" in capsys.readouterr().err
        assert not (tmp_path / "strict").exists()


@pytest.mark.parametrize("option", [("--start", "9999999999999999ns"), ("--set", "labels=bus")])
def test_nothing_left_of_a_log_is_said_with_what_was_asked(tmp_path, ring, capsys, monkeypatch, option):
    monkeypatch.chdir(tmp_path)
    write_tracks(ring[ring.track_id < 8], tmp_path / "log.mcap")
    assert run(["learn", "log.mcap", "-o", "map.mcap", *option]) == 1
    assert (
        f"log.mcap: expected moving objects {' '.join(option).removeprefix('--set ')}, got none"
        in capsys.readouterr().err
    )
    assert not (tmp_path / "map.mcap").exists()


def test_an_unknown_schema_is_named_with_the_way_out(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    private_json(tmp_path / "log.mcap")
    assert run(["info", "log.mcap"]) == 0
    assert "no topic carries tracks; --set fields=... says where" in capsys.readouterr().out
    assert run(["learn", "log.mcap", "-o", "map.mcap"]) == 1
    reported = capsys.readouterr().err
    for part in ("expected a topic with moving objects", "the log has /car (acme.Car)", "say by --set fields="):
        assert part in reported
    assert "osi3.GroundTruth" not in reported  # nor the forty others that are known: the README lists them
    assert reported.count("\n") == 1


def test_standard_output_is_no_place_for_what_is_renamed_when_whole(tmp_path, ring, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_tracks(ring[ring.track_id < 8], tmp_path / "log.mcap")
    for command in ("recover", "learn"):
        assert run([command, "log.mcap", "-o", "-"]) == 2
        assert "expected the name of a file, got -" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["log.mcap"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (None, None), ("5ns", 5), ("-5ns", -5), ("5.5s", FromStart(5_500_000_000)), ("5", FromStart(5 * 10**9)),
        ("1700000000.000000001", FromStart(1_700_000_000_000_000_001)),
        ("1970-01-01T00:00:01Z", 10**9), ("1970-01-01T01:00:01+01:00", 10**9),
    ],
)  # fmt: skip
def test_times_are_nanoseconds_seconds_from_the_start_or_dates(text, expected):
    assert time_ns(text) == expected
    assert type(time_ns(text)) is type(expected)


@pytest.mark.parametrize("text", ["soon", "s", "nans", "infs", "5 h", ""])
def test_what_is_no_time_is_one_line(text):
    with pytest.raises(ValueError, match=r"expected seconds from the start such as 12\.5, nanos") as error:
        time_ns(text)
    assert "\n" not in str(error.value)
