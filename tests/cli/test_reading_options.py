"""Whatever reads a log has the options of reading, and they reach the library; a log is read once."""

from pathlib import Path

import pytest

from cli.commands import FAILED, GRID, INPUT_LOST, USAGE, dirprim
from dirprim_filter.cli.options import time_ns
from dirprim_filter.recording.objects.options import FromStart
from recording.mcap_files import json_log

COMMANDS = {
    "info": "info log.mcap",
    "learn": f"learn log.mcap {GRID} -o out",
    "track": "track log.mcap --map map.mcap --particles 20 -o out",
    "view": "view log.mcap --save out",
    **{f"evaluate {what}": f"evaluate {what} log.mcap" for what in ("density", "cues", "tracking", "forecast")},
}
PRIVATE = "acme.Car", [(k, {"car": {"e": k, "n": 0}}) for k in range(80)]
"""Messages of a schema that nobody knows."""


@pytest.mark.parametrize("command", COMMANDS)
def test_whatever_reads_a_log_has_the_options_of_reading_and_they_reach_the_library(command, here, said):
    shown = said(f"{command} --help").out
    assert all(f"--{option} " in shown for option in ("topics", "time-source", "start", "end", "strict", "set"))
    assert "frame, fields, origin, labels, group, format" in " ".join(shown.split())
    json_log(here / "log.mcap", *PRIVATE)
    for option, wrong in (("--set fields=", "nonsense"), ("--set origin=", "north"), ("--start ", "soon")):
        assert wrong in said(f"{COMMANDS[command]} {option}{wrong}", code=FAILED).err


WRONG = [
    ("--topics ''", USAGE, "topics: expected a value, got ''"), ("--time-source now", USAGE, "'--time-source'"),
    ("--set frame=a --set frame=b", USAGE, "frame: expected it once, got it twice"),
    ("--set frame=", USAGE, "expected NAME=VALUE, got 'frame='"), ("--set nonsense=1", USAGE, "nonsense: expected one"),
]  # fmt: skip
WRONG_OF_PARTS = [
    ("--start nan", FAILED, "--start: expected seconds"), ("--end ''", USAGE, "end: expected a value, got ''"),
    ("--start 5 --end 5", FAILED, "--end: expected a time after --start 5, got 5"),
    ("--set format=csv", USAGE, "--set format=...: acts on nothing in these files"),
]  # fmt: skip


@pytest.mark.parametrize(
    "command",
    [
        *COMMANDS.values(), "plot map.mcap -o out.png --log log.mcap", "score map.mcap --truth log.mcap",
        "calibrate log.mcap --truth log.mcap -o out", "smooth log.mcap --map map.mcap -o out",
        "store add fleet log.mcap",
    ],
)  # fmt: skip
def test_a_wrong_option_of_reading_is_one_line_wherever_it_is_given(command, here, refused):
    of_parts = [] if command.startswith("store") else WRONG_OF_PARTS
    before = set(here.iterdir())
    for option, code, text in [*WRONG, *of_parts]:
        refused(f"{command} {option}", text, code=code)
    assert set(here.iterdir()) == before


@pytest.mark.parametrize("command", ["learn", "track"])
@pytest.mark.parametrize("option", ["--set group=99", "--set labels=bus", "--start 9000000000000000ns"])
def test_asking_for_what_a_log_does_not_hold_is_an_error_and_leaves_no_file(here, refused, command, option):
    asked = option.removeprefix("--set ")
    refused(f"{COMMANDS[command]} {option}", f"log.mcap: expected moving objects {asked}, got none")
    assert not Path("out").exists()


@pytest.mark.parametrize("command", ["learn", "track", "view"])
def test_a_damaged_log_ends_in_3_and_in_an_error_where_strict(here, said, refused, command):
    Path("log.mcap").write_bytes(Path("log.mcap").read_bytes()[:-30])
    shown = said(COMMANDS[command], code=INPUT_LOST)
    assert shown.err.count("damaged, the rest is read") == 1
    Path("out").unlink()
    refused(f"{COMMANDS[command]} --strict", "expected an undamaged log")
    assert not Path("out").exists()
    assert "damage" in said("info log.mcap", code=INPUT_LOST).out


@pytest.mark.parametrize(
    "command",
    [
        "plot map.mcap -o out.png --log log.mcap", "plot map.mcap -o out.png --estimates tracks.mcap",
        "export tracks.mcap -o out.csv", "score tracks.mcap --truth whole.mcap", "view log.mcap --save out.rrd",
        "view tracks.mcap --save out.rrd",
        "view whole.mcap --truth log.mcap --save out.rrd", "calibrate whole.mcap --truth log.mcap -o out.toml",
        "track whole.mcap --map map.mcap -o out --particles 20 --save out.rrd --set truth=log.mcap",
        "smooth whole.mcap --map map.mcap -o out --particles 20 --truth log.mcap",
    ],
)  # fmt: skip
def test_whatever_was_lost_of_whichever_input_ends_in_3(here, tracked, command):
    Path("whole.mcap").write_bytes(whole := Path("log.mcap").read_bytes())
    Path("log.mcap").write_bytes(whole[:-30])
    Path("tracks.mcap").write_bytes(tracked.read_bytes()[:-30])
    assert dirprim(command) == INPUT_LOST


def test_an_unknown_schema_is_named_with_the_way_out(here, said, refused):
    json_log(here / "log.mcap", *PRIVATE)
    expected = "not read: /objects: its schema is not known to hold objects; --set fields=..."
    assert expected in said("info log.mcap").out
    error = refused("learn log.mcap -o out", "expected a topic with moving objects")
    assert error.startswith("error: ")
    assert "the log has /objects (acme.Car)" in error
    assert "say by --set fields=" in error
    assert "osi3.GroundTruth" not in error  # nor the forty others that are known: the README lists them


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (None, None), ("5ns", 5), ("-5ns", -5), ("5.5s", FromStart(5_500_000_000)), ("5", FromStart(5 * 10**9)),
        ("1700000000.000000001", FromStart(1_700_000_000_000_000_001)),
        ("1970-01-01T00:00:01Z", 10**9), ("1970-01-01T01:00:01+01:00", 10**9),
    ],
)  # fmt: skip
def test_times_are_nanoseconds_seconds_from_the_start_or_dates(text, expected):
    assert time_ns(text, "--start") == expected
    assert type(time_ns(text, "--start")) is type(expected)


@pytest.mark.parametrize("text", ["soon", "s", "nans", "infs", "5 h", ""])
def test_what_is_no_time_is_one_line(text):
    with pytest.raises(ValueError, match=r"^--end: expected seconds from the start such as 12\.5, nanos") as error:
        time_ns(text, "--end")
    assert "\n" not in str(error.value)
