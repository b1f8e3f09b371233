"""The command line: results on stdout, one line for an error, exit codes that say how it ended."""

import json
import logging
import re
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

import dirprim_filter
from cli.commands import DONE, GRID, dirprim
from dirprim_filter import load_map, read_estimates, read_tracks, save_map, write_tracks
from dirprim_filter.cli.main import COMMANDS
from dirprim_filter.recording.scan import scan

GROUPS = {
    "evaluate": ["density", "cues", "forecast", "tracking"],
    "store": ["add", "learn", "update", "info", "forget", "merge", "keep"],
}
NAMES = [name for commands in COMMANDS.values() for name in commands]
LEAVES = [*(name for name in NAMES if name not in GROUPS), *(f"{g} {name}" for g, of in GROUPS.items() for name in of)]
MOST_OPTIONS, OF_ALL = {"track": 24, "evaluate tracking": 22, "learn": 16}, {"--verbose", "--quiet", "--help"}


@pytest.mark.parametrize("command", LEAVES)
def test_the_help_of_a_command_has_a_first_screen_and_an_example(command, said):
    """What it does, how it is called and an example stand above the options; lines fit a terminal."""
    shown = said(f"{command} --help").out
    head, _, options = shown.partition("\nOptions:")
    assert f"Example: dirprim {command} " in " ".join(head.split()) or command == "doctor"
    listed = re.findall(r"^  (?:-\w, )?(--[a-z-]+)", options, flags=re.MULTILINE)
    assert {*listed} >= OF_ALL
    assert len({*listed} - OF_ALL) <= MOST_OPTIONS.get(command, 22)
    assert max(map(len, shown.splitlines())) <= 80


@pytest.mark.parametrize("group", ["", *GROUPS])
def test_every_summary_fits_its_line(said, group):
    shown = said(f"{group} --help").out
    assert not re.findall(r"^  \w+ .*\.\.\.$", shown, flags=re.MULTILINE)
    assert all(f"  {name} " in shown for name in GROUPS.get(group, NAMES))


def test_an_installation_is_described(said):
    assert said("--version").out == f"dirprim {version('dirprim-filter')}\n"
    assert dirprim_filter.__version__ == version("dirprim-filter")
    python, packages, cache = said("doctor").out.splitlines()
    assert python.startswith("python 3")
    assert re.match(r"dirprim-filter \S+, numpy \S+, ", packages)
    assert re.search(r": \d+ kernels are compiled$", cache)


@pytest.mark.parametrize("before", [True, False], ids=["before", "behind"])
def test_options_of_verbosity_stand_before_a_command_or_behind_it(before, here, said):
    Path("late.csv").write_text("time_s,track_id,x_m,y_m\n1,a,0,0\n0,a,1,0\n")
    command = "{0} convert late.csv -o o.mcap --force" if before else "convert late.csv -o o.mcap --force {0}"
    levels = []
    for option in ("-q", "", "--verbose"):
        assert ("sorted" in said(command.format(option)).err) == (option != "-q")
        levels.append(logging.getLogger().level)
    assert levels == [logging.ERROR, logging.WARNING, logging.INFO]


@pytest.mark.parametrize(
    ("at", "warning"), [("20 -900", "(20, -900) is outside of every cell of the map, 8"), ("20 0", "")]
)
def test_a_state_is_forecast_and_off_the_map_that_is_said(at, warning, here, said):
    command = f"forecast --map map.mcap --at {at} --direction-deg 90 --speed 8 --samples 50"
    printed = said(f"{command} -o f.png")
    assert printed.err.startswith(warning)
    assert printed.err.count("\n") == bool(warning)
    assert len(printed.out.splitlines()) == 11
    assert Path("f.png").read_bytes().startswith(b"\x89PNG")
    assert np.shape(json.loads(said(f"{command} --json").out)["paths"]) == (50, 10, 2)


def test_info_names_the_topics_that_carry_tracks(here, few, said):
    assert "tracks in: /objects\n" in said("info log.mcap").out
    reported = json.loads(said("info log.mcap --json").out)
    topics = {topic["name"]: topic for topic in reported["topics"]}
    assert topics["/objects"].keys() > {"name", "schema", "encoding", "messages", "tracks", "detections"}
    assert topics["/objects"]["tracks"] == few.n_tracks
    assert (reported["start_ns"], reported["end_ns"], reported["damage"]) == (few.time_ns.min(), few.time_ns.max(), [])
    assert (reported["is_checked"], reported["messages"], reported["faults"]) == (True, 50, [])
    assert set(reported) >= {"labels", "groups", "metadata"}


def test_faults_of_tracks_are_reported_by_whoever_reads_them(few, here, said):
    write_tracks(replace(few, speed=3.6 * few.speed), "fast.mcap")
    line = "are they in km/h in place of m/s?"
    assert line in said("info fast.mcap").out
    assert line in said(f"learn fast.mcap -o m.mcap {GRID}").err


def test_forecasts_without_the_map_go_on_by_what_particles_were_moved_by(here):
    """As a map without cells does, by which the same is asked otherwise."""
    save_map(load_map("map.mcap").without_places(), "free.mcap")
    found = []
    for name, given in (("by", "map.mcap --set without_map=true"), ("of", "free.mcap"), ("cells", "map.mcap")):
        command = f"track log.mcap --map {given} --noise 0.5 --particles 30 --forecast 2 -o {name}.out"
        assert dirprim(command) == DONE
        with scan(f"{name}.out") as messages:
            found.append([message.data for message in messages if message.topic == "/dirprim/forecast"])
    assert len(found[0]) > 1
    assert found[0] == found[1] != found[2]


def test_options_reach_the_library(here):
    for name, options in (
        ("m", "--cell-size 9 --modes dbscan --seed 3"), ("n", "--cell-size 9 --end 2"), ("o", "--cells 12"),
    ):  # fmt: skip
        assert dirprim(f"learn log.mcap -o {name} --tessellation grid {options}") == DONE
    assert load_map("m").tessellation.cell_size == 9.0
    assert load_map("n").n_rows[-1] < load_map("m").n_rows[-1]
    assert load_map("o").tessellation.n_cells == pytest.approx(12, abs=3)


def test_a_run_can_be_had_again_from_its_log_and_settings_from_a_file(here):
    Path("own.toml").write_text("[filter]\nn_particles = 30\nnoise_m = 0.8\n[tracking]\ngate = 9.0\n")
    made = {}
    for name, options in (
        ("first", "--config own.toml"), ("again", "--config first"), ("options", "--particles 30 --noise 0.8"),
        ("more", "--config own.toml --particles 40"), ("seed", "--config own.toml --seed 5"),
    ):  # fmt: skip
        assert dirprim(f"track log.mcap --map map.mcap {options} -o {name}") == DONE
        made[name] = Path(name).read_bytes()
    assert made["again"] == made["first"]
    assert made["first"] not in (made["more"], made["seed"])
    np.testing.assert_array_equal(read_estimates("options").position, read_estimates("first").position)


def test_a_bug_keeps_its_traceback(monkeypatch, here):
    def broken(*_):
        raise TypeError("a bug")

    monkeypatch.setattr("dirprim_filter.recording.inspection.inspect", broken)
    with pytest.raises(TypeError, match="a bug"):
        dirprim("info log.mcap")


def test_simulate_writes_what_the_demo_reads(here):
    pytest.importorskip("sumo", reason="the extra `sim` (eclipse-sumo) is not installed")
    for name in ("s", "again"):
        assert dirprim(f"simulate intersection -o {name} --duration 20 --seed 1") == DONE
    assert read_tracks("s").n_tracks > 0
    assert Path("again").read_bytes() == Path("s").read_bytes()
