"""The command line: results on stdout, one line for an error, exit codes that tell."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from shutil import copy

import numpy as np
import pytest

from dirprim_filter import Tracks, load_map, read_estimates, read_tracks, save_map, write_tracks
from dirprim_filter.cli.main import run
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.evaluation.tracking_report import Scales, TrackingReport
from dirprim_filter.recording.scan import scan

DONE, FAILED, USAGE, INPUT_LOST = 0, 1, 2, 3

NEVER_ERRS = ("--set", "clutter_density=1e-9")
"""A vehicle is reported from its first detection on."""
GRID = ("--tessellation", "grid")
"""Learned in a moment: where any map will do."""


def dirprim(*arguments):
    return run([str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def few(ring):
    return ring[ring.track_id < 6]


@pytest.fixture(scope="module")
def files(few, tmp_path_factory):
    """A folder of a log and of the map that is learned from it."""
    folder = tmp_path_factory.mktemp("files")
    write_tracks(few, folder / "few.mcap")
    assert dirprim("learn", folder / "few.mcap", "-o", folder / "map.mcap", *GRID, "--cell-size", 6) == DONE
    return folder


@pytest.fixture
def log(files, tmp_path):
    return Path(copy(files / "few.mcap", tmp_path))


@pytest.fixture
def learned(files, tmp_path):
    return Path(copy(files / "map.mcap", tmp_path))


def report(estimates, truth):
    """Errors by id; a csv of tracks knows no groups."""
    truth = replace(truth, group=np.zeros(len(truth), np.int64))
    return TrackingReport.of(TrackedRows.of(estimates), truth, is_hidden=None, with_ids=True, scales=Scales())


def csv_of(tracks, path, *, noise_m=0.0, rng=None):
    position = tracks.position + (noise_m * rng.standard_normal(tracks.position.shape) if rng else 0.0)
    rows = np.column_stack([tracks.time_ns * 1e-9, tracks.track_id, position])
    np.savetxt(
        path, rows, delimiter=",", header="time_s,track_id,x_m,y_m", comments="", fmt=["%.1f", "%d", "%.4f", "%.4f"]
    )
    return path


def test_help_of_every_command_has_an_example(capsys):
    assert dirprim("--help") == DONE
    listed = capsys.readouterr().out.split("See what is there:")[1].split("First steps")[0]
    commands = [line.split()[0] for line in listed.splitlines() if line.strip() and not line.endswith(":")]
    assert {"info", "convert", "simulate", "learn", "track", "forecast", "plot", "view", "demo"} <= set(commands)
    for command in commands:
        assert dirprim(command, "--help") == DONE
        assert f"Example: dirprim {command} " in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("group", [(), ("evaluate",), ("store",)])
def test_every_summary_fits_its_line(capsys, group):
    assert dirprim(*group, "--help") == DONE
    assert not re.findall(r"^  \w+ .*\.\.\.$", capsys.readouterr().out, flags=re.MULTILINE)


def test_the_version(capsys):
    assert dirprim("--version") == DONE
    assert capsys.readouterr().out == f"dirprim {version('dirprim-filter')}\n"


@pytest.mark.parametrize(
    ("at", "reported"),
    [
        (["--at", "900", "0"], "(900, 0) is outside of every cell of the map, 8"),
        (["--at", "20", "-900"], "(20, -900) is outside of every cell of the map, 8"),
        (["--at", "20", "0"], ""),
    ],
)
def test_of_a_place_off_the_map_that_is_said(at, reported, ring_map, tmp_path, capsys):
    save_map(ring_map, tmp_path / "map.mcap")
    state = ("--direction-deg", 90, "--speed", 8, "--samples", 5, "--horizon", 0.5)
    assert dirprim("forecast", "--map", tmp_path / "map.mcap", *at, *state) == DONE
    said = capsys.readouterr()
    assert said.err.startswith(reported)
    assert said.err.count("\n") == bool(reported)
    assert len(said.out.splitlines()) == 2


def test_info_names_the_topics_that_carry_tracks(log, few, capsys):
    assert dirprim("info", log) == DONE
    assert "tracks in: /objects, /objects/scene" in capsys.readouterr().out
    assert dirprim("info", log, "--json") == DONE
    reported = json.loads(capsys.readouterr().out)
    assert set(reported) >= {"topics", "messages", "start_ns", "end_ns", "damage"}
    assert reported["is_checked"]
    topics = {topic["name"]: topic for topic in reported["topics"]}
    assert set(topics["/objects"]) == {"name", "schema", "encoding", "messages", "tracks"}
    assert topics["/objects"]["tracks"] == few.n_tracks
    assert (reported["start_ns"], reported["end_ns"], reported["damage"]) == (few.time_ns.min(), few.time_ns.max(), [])


def test_faults_of_tracks_are_reported_by_whoever_reads_them(few, log, tmp_path, capsys):
    assert dirprim("info", log, "--json") == DONE
    nothing = {"backwards": [], "jumps": [], "copies": [], "units": []}
    assert json.loads(capsys.readouterr().out)["faults"] == nothing
    own = few[few.track_id == 3]
    twice = tmp_path / "twice.mcap"
    write_tracks(Tracks.concatenate([few, replace(own, track_id=np.full(len(own), 99))]), twice)
    line = "vehicles that are copies of others at the same instants (1): 99 of 3"
    assert dirprim("info", twice) == DONE
    assert f"  faults: {line}\n" in capsys.readouterr().out
    assert dirprim("info", twice, "--json") == DONE
    (copy,) = json.loads(capsys.readouterr().out)["faults"]["copies"]
    assert copy[:2] == ["99", "3"]
    for command in (
        ("learn", twice, "-o", tmp_path / "m.mcap", *GRID, "--cell-size", 6),
        ("evaluate", "tracking", twice, "--seeds", 1, "--particles", 20, "--method", "constant velocity"),
    ):
        assert dirprim(*command) == DONE
        assert line in capsys.readouterr().err


def test_the_way_from_a_table_to_tracked_vehicles(few, tmp_path, capsys):
    table = csv_of(few, tmp_path / "few.csv", noise_m=0.5, rng=np.random.default_rng(0))
    write_tracks(few, tmp_path / "truth.mcap")
    assert dirprim("convert", table, "-o", tmp_path / "noisy.mcap") == DONE
    assert dirprim("learn", tmp_path / "truth.mcap", "-o", tmp_path / "map.mcap", *GRID) == DONE
    assert (
        dirprim(
            "track", tmp_path / "noisy.mcap", "--map", tmp_path / "map.mcap", "-o", tmp_path / "out.mcap", *NEVER_ERRS
        )
        == DONE
    )
    estimates = read_estimates(tmp_path / "out.mcap")
    assert set(estimates.track_id) == set(few.track_id)
    assert len(estimates) == len(few)
    assert report(estimates, few).rmse < 0.5 * np.sqrt(2)  # better than what was measured
    assert capsys.readouterr().err == ""


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(log, learned, tmp_path):
    for name, seed in (("a", 4), ("b", 4), ("c", 5)):
        assert dirprim("track", log, "--map", learned, "-o", tmp_path / name, "--seed", seed) == DONE
    a, b, c = ((tmp_path / name).read_bytes() for name in "abc")
    assert a == b
    assert a != c


def test_place_free_forecasts_go_on_by_the_map_that_particles_were_moved_by(log, learned, tmp_path):
    """As a map without cells does, by which the same is asked otherwise."""
    save_map(load_map(learned).without_places(), tmp_path / "free.mcap")
    found = []
    for name, given in (
        ("by", (learned, "--set", "without_map=true")),
        ("of", (tmp_path / "free.mcap",)),
        ("cells", (learned,)),
    ):
        out = tmp_path / f"{name}.mcap"
        options = ("--noise", 0.5, "--particles", 30, "--forecast", 2.0, "-o", out)
        assert dirprim("track", log, "--map", *given, *options) == DONE
        with scan(out) as messages:
            found.append([message.data for message in messages if message.topic == "/dirprim/forecast"])
    assert len(found[0]) > 1
    assert found[0] == found[1] != found[2]


def test_a_layout_is_of_a_map_and_does_not_overwrite_one(tmp_path, learned, log):
    options = ("view", learned, "--layout", tmp_path / "layout.json")
    assert dirprim(*options) == DONE
    layout = json.loads((tmp_path / "layout.json").read_text())
    assert layout["configById"]["3D!map"]["topics"]["/dirprim/tracks/scene"]["visible"]
    assert dirprim(*options) == FAILED
    assert dirprim(*options, "--force") == DONE
    assert dirprim("view", log, "--layout", tmp_path / "other.json") == USAGE


def test_a_vehicles_estimates_do_not_change_when_others_are_removed(few, log, learned, tmp_path):
    write_tracks(few[few.track_id == 3], tmp_path / "one.mcap")
    for name in ("few", "one"):
        assert dirprim("track", tmp_path / f"{name}.mcap", "--map", learned, "-o", tmp_path / f"{name}.out") == DONE
    among, alone = read_estimates(tmp_path / "few.out"), read_estimates(tmp_path / "one.out")
    rows = among.track_id == 3
    assert rows.sum() == len(alone) > 0
    for field in ("time_ns", "position", "covariance", "direction", "speed", "log_evidence"):
        np.testing.assert_array_equal(getattr(among, field)[rows], getattr(alone, field))


def test_groups_of_a_log_are_tracked_each_by_itself(few, learned, tmp_path, capsys):
    groups = {2: few[few.track_id % 2 == 0], 7: few[few.track_id % 2 == 0], 0: few[few.track_id % 2 == 1]}
    parts = [replace(own, group=np.full(len(own), group)) for group, own in groups.items()]
    log, out = tmp_path / "groups.mcap", tmp_path / "tracked.mcap"
    write_tracks(Tracks.concatenate(parts), log)
    options = ("--map", learned, "--particles", 30)
    for ids in ((), ("--no-ids",)):
        assert dirprim("track", log, *options, *ids, "-o", out, "--force") == DONE
        assert "3 groups, each by itself" in capsys.readouterr().out
        together = read_estimates(out)
        for group in (2, 7):
            of_group = together[np.char.startswith(together.track_id, f"{group}/")]
            alone = tmp_path / f"{group}.mcap"
            assert dirprim("track", log, *options, *ids, "--set", f"group={group}", "-o", alone, "--force") == DONE
            found = read_estimates(alone)
            assert [f"{group}/{name}" for name in found.track_id] == of_group.track_id.tolist()
            np.testing.assert_array_equal(found.position, of_group.position)
            assert np.unique(found.track_id).size == groups[group].n_tracks
    read = read_tracks(log)  # an id of several groups is several vehicles
    assert read.n_tracks == sum(own.n_tracks for own in groups.values())
    assert len(read) == sum(map(len, parts))


def test_options_reach_the_library(log, tmp_path):
    square = (*GRID, "--cell-size", 9)
    assert dirprim("learn", log, "-o", tmp_path / "m", *square, "--modes", "dbscan", "--seed", 3) == DONE
    assert load_map(tmp_path / "m").tessellation.cell_size == 9.0
    assert dirprim("learn", log, "-o", tmp_path / "n", *square, "--end", "2") == DONE
    assert load_map(tmp_path / "n").n_rows[-1] < load_map(tmp_path / "m").n_rows[-1]
    assert dirprim("learn", log, "-o", tmp_path / "m", "--force", *GRID, "--cells", 12) == DONE
    assert load_map(tmp_path / "m").tessellation.n_cells == pytest.approx(12, abs=3)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["frobnicate"], "No such command"),
        (["learn"], "Missing argument"),
        (["learn", "absent.mcap", "-o", "x"], "absent.mcap"),
        (["learn", __file__, "-o", "x", "--tessellation", "hexagons"], "hexagons"),
    ],
)
def test_usage(arguments, said, capsys):
    assert run(arguments) == USAGE
    assert said in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("command", "content", "said"),
    [
        ("convert wrong.csv -o out", b"time_s,track_id,x_m\n0,1,2\n", "wrong.csv.*y_m"),
        ("convert wrong.csv -o out", b"time_s,track_id,x_m,y_m,speed_kmh\n0,1,2,3,50\n", "wrong.csv.*speed_kmh"),
        ("convert wrong.csv -o out", b"time_s,track_id,x_m,y_m\n0,1,two,3\n", "wrong.csv.*two"),
        ("info wrong.mcap", b"", "wrong.mcap"),
        ("info wrong.mcap", b"hello, this is no log\n" * 9, "wrong.mcap"),
        ("track few.mcap --map few.mcap -o out", None, "few.mcap: .*dirprim learn"),
        ("learn map.mcap -o out", None, "map.mcap: .*/dirprim/map"),
    ],
)
def test_a_wrong_file_is_one_line(command, content, said, *, files, tmp_path, monkeypatch, capsys):
    for name in ("few.mcap", "map.mcap"):
        copy(files / name, tmp_path)
    monkeypatch.chdir(tmp_path)
    if content is not None:
        (tmp_path / command.split()[1]).write_bytes(content)
    assert dirprim(*command.split()) == FAILED
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert re.search(said, error)
    assert not (tmp_path / "out").exists()


def test_dropped_rows_are_counted_and_the_rest_is_kept(few, tmp_path, capsys):
    table = csv_of(few, tmp_path / "t.csv")
    with table.open("a") as file:
        file.write("1.0,0,nan,2\n0.0,0,3,3\n")
    assert dirprim("convert", table, "-o", tmp_path / "t.mcap") == INPUT_LOST
    assert capsys.readouterr().err.count("dropped 1 row:") == 2
    assert len(read_tracks(tmp_path / "t.mcap")) == len(few)


def test_a_damaged_log_is_read_as_far_as_it_is_whole(few, tmp_path, capsys):
    write_tracks(few, tmp_path / "whole.mcap")
    data = (tmp_path / "whole.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) * 9 // 10])
    assert dirprim("info", tmp_path / "cut.mcap") == INPUT_LOST
    assert "damage" in capsys.readouterr().out
    assert dirprim("learn", tmp_path / "cut.mcap", "-o", tmp_path / "m", "--strict") == FAILED
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "m").exists()


def test_forecast_of_a_state(learned, capsys, tmp_path):
    state = ["--at", 20, 0, "--direction-deg", 90, "--speed", 8, "--samples", 50]
    assert dirprim("forecast", "--map", learned, *state, "--json") == DONE
    paths = np.array(json.loads(capsys.readouterr().out)["paths"])
    assert paths.shape == (50, 10, 2)
    assert dirprim("forecast", "--map", learned, *state, "-o", tmp_path / "f.png") == DONE
    assert (tmp_path / "f.png").read_bytes().startswith(b"\x89PNG")
    assert len(capsys.readouterr().out.splitlines()) == 11


@pytest.mark.parametrize("options", [[], ["--at", 1, 2]])
def test_forecast_asks_for_a_state(learned, options):
    assert dirprim("forecast", "--map", learned, *options) == USAGE


def test_a_run_can_be_had_again_from_its_log_and_knobs_from_a_file(log, learned, tmp_path, capsys):
    first, again, other = (tmp_path / f"{name}.mcap" for name in ("first", "again", "other"))
    config = tmp_path / "knobs.toml"
    config.write_text("[filter]\nn_particles = 30\nnoise_m = 0.8\n[tracking]\ngate = 9.0\n")
    options = ("track", log, "--map", learned)
    assert dirprim(*options, "--config", config, "-o", first) == DONE
    assert dirprim(*options, "--config", first, "-o", again) == DONE
    assert again.read_bytes() == first.read_bytes()
    assert dirprim(*options, "--config", config, "--particles", 40, "-o", other) == DONE
    assert other.read_bytes() != first.read_bytes()
    by_options = tmp_path / "options.mcap"
    assert dirprim(*options, "--particles", 30, "--noise", 0.8, "-o", by_options) == DONE
    np.testing.assert_array_equal(read_estimates(by_options).position, read_estimates(first).position)
    capsys.readouterr()
    for text, said in (
        ("[filter]\nnoise = 1.0", "filter: noise: expected one of"),
        ("noise_m = 1.0", "noise_m: expected"),
    ):
        config.write_text(text)
        assert dirprim(*options, "--config", config, "-o", tmp_path / "no.mcap") == FAILED
        assert said in capsys.readouterr().err
        assert not (tmp_path / "no.mcap").exists()


def test_a_bug_keeps_its_traceback(monkeypatch, log):
    def broken(*_):
        raise TypeError("a bug")

    monkeypatch.setattr("dirprim_filter.recording.inspection.inspect", broken)
    with pytest.raises(TypeError, match="a bug"):
        dirprim("info", log)


def test_a_closed_pipe_is_no_error(log):
    command = f"{sys.executable} -m dirprim_filter.cli info {log} {log} {log} | head -n 1"
    result = subprocess.run(["bash", "-o", "pipefail", "-c", command], capture_output=True, text=True, check=False)
    assert result.stderr == ""
    assert result.stdout.startswith(str(log))


def test_simulate_writes_what_the_demo_reads(tmp_path):
    pytest.importorskip("sumo", reason="the extra `sim` (eclipse-sumo) is not installed")
    assert dirprim("simulate", "intersection", "-o", tmp_path / "s.mcap", "--duration", 20, "--seed", 1) == DONE
    assert read_tracks(tmp_path / "s.mcap").n_tracks > 0
    again = tmp_path / "again.mcap"
    assert dirprim("simulate", "intersection", "-o", again, "--duration", 20, "--seed", 1) == DONE
    assert again.read_bytes() == (tmp_path / "s.mcap").read_bytes()


def test_ids_that_are_no_numbers_stay_as_they_are(few, tmp_path):
    named = Tracks(
        track_id=np.char.add("car-", few.track_id.astype(str)),
        time_ns=few.time_ns,
        position=few.position,
        direction=few.direction,
        speed=few.speed,
    )
    write_tracks(named, tmp_path / "named.mcap")
    assert dirprim("learn", tmp_path / "named.mcap", "-o", tmp_path / "m", *GRID) == DONE
    assert dirprim("track", tmp_path / "named.mcap", "--map", tmp_path / "m", "-o", tmp_path / "o") == DONE
    assert set(read_estimates(tmp_path / "o").track_id) == set(named.track_id)


def test_a_real_junction_from_table_to_estimates(tmp_path):
    truth_table = Path(__file__).parents[1] / "data" / "junction.csv"
    assert dirprim("convert", truth_table, "-o", tmp_path / "truth.mcap") == DONE
    truth = read_tracks(tmp_path / "truth.mcap")
    some = np.isin(truth.track_id, np.unique(truth.track_id)[::20])
    noisy = csv_of(truth[some], tmp_path / "noisy.csv", noise_m=0.5, rng=np.random.default_rng(1))
    assert dirprim("convert", noisy, "-o", tmp_path / "noisy.mcap") == DONE
    assert dirprim("learn", tmp_path / "truth.mcap", "-o", tmp_path / "map.mcap", "--set", "group=15", *GRID) == DONE
    assert (
        dirprim(
            "track", tmp_path / "noisy.mcap", "--map", tmp_path / "map.mcap", "-o", tmp_path / "out.mcap", *NEVER_ERRS
        )
        == DONE
    )
    result = report(read_estimates(tmp_path / "out.mcap"), truth[some])
    assert result.reported == 1.0  # every vehicle, at every time
    assert result.rmse < 0.5 * np.sqrt(2)


@pytest.mark.parametrize(
    "name",
    [
        "MovingHostWith3DModel", "MovingHostWithStopLine", "disappearingVehicle", "testBrakeAndIndicatorLights",
        "omega_prime/osi_centerline_example",
    ],
)  # fmt: skip
def test_logs_of_asam_osi_straight_away(name, real_data, tmp_path, capsys):
    log = real_data / "mcap_osi" / f"{name}.mcap"
    assert dirprim("info", log) == DONE
    assert "tracks in: " in capsys.readouterr().out
    assert dirprim("learn", log, "-o", tmp_path / "map.mcap", *GRID) == DONE
    assert dirprim("track", log, "--map", tmp_path / "map.mcap", "-o", tmp_path / "out.mcap") == DONE
    truth = read_tracks(log)
    assert set(read_estimates(tmp_path / "out.mcap").track_id) == set(truth.track_id)


def test_the_demo(tmp_path, short_recordings, monkeypatch, capsys):
    monkeypatch.setattr("dirprim_filter.cli.demo.recordings_folder", lambda: short_recordings)
    folder = tmp_path / "demo"
    assert dirprim("demo", "-o", folder) == DONE
    table = capsys.readouterr().out
    for line in ("with the map", "without the map", "constant velocity", "next: open"):
        assert line in table
    assert {path.name for path in folder.iterdir()} == {
        "map.mcap", "tracks.mcap", "layout.json", "tracks.rrd", "demo.png",
    }  # fmt: skip
    _opens_everywhere(folder)
    assert dirprim("demo", "-o", folder) == FAILED  # nothing is overwritten


def _opens_everywhere(folder):
    """The stock reader with CRC validation, rerun's importer, and rerun's own check."""
    from mcap.reader import make_reader

    rerun = Path(sys.executable).with_name("rerun")
    for name in ("map", "tracks"):
        with (folder / f"{name}.mcap").open("rb") as file:
            assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) > 0
        converted = folder / f"{name}_converted.rrd"
        subprocess.run(
            [rerun, "mcap", "convert", folder / f"{name}.mcap", "-o", converted], check=True, capture_output=True
        )
        subprocess.run([rerun, "rrd", "verify", converted], check=True, capture_output=True)
    subprocess.run([rerun, "rrd", "verify", folder / "tracks.rrd"], check=True, capture_output=True)
