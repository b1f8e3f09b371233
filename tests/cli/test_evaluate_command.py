"""`dirprim evaluate`: tables for people, one object for machines."""

import json

import pytest

from dirprim_filter import write_tracks
from dirprim_filter.cli.main import run

DONE, FAILED, USAGE = 0, 1, 2


@pytest.fixture(scope="module")
def log(ring, tmp_path_factory):
    path = tmp_path_factory.mktemp("evaluate") / "few.mcap"
    write_tracks(ring[ring.track_id < 8], path)
    return path


def evaluate(*arguments):
    return run(["evaluate", *map(str, arguments)])


def test_density_tells_people_and_machines_the_same(log, capsys):
    options = ("density", log, "--folds", 2, "--every", 1.0)
    assert evaluate(*options) == DONE
    text = capsys.readouterr().out
    assert evaluate(*options, "--json") == DONE
    table = json.loads(capsys.readouterr().out)
    assert table["split_by"] == "vehicle"
    assert table["n_held_out"] == table["n_rows"] == 80
    assert text.startswith("80 rows held out of 80, 8 vehicles, by vehicle, 2 folds")
    for row in table["methods"]:
        line = next(line for line in text.splitlines() if line.startswith(f"{row['name']}  "))
        assert line.split()[-5:] == [f"{row['direction'][f]:.3f}" for f in row["direction"]]
    grid_map = next(row for row in table["methods"] if row["name"] == "DGM")
    assert grid_map["speed"] is None
    assert f"DGM: {grid_map['setting']}" in text


def test_one_fold_has_no_deviation_of_folds(log, capsys):
    assert evaluate("density", log, "--split", "random", "--folds", 1, "--every", 1.0, "--json") == DONE
    table = json.loads(capsys.readouterr().out)
    assert table["n_held_out"] == 8
    assert table["methods"][0]["direction"]["fold_std"] is None


def test_cues_tells_people_and_machines_the_same(log, capsys):
    assert evaluate("cues", log, "--folds", 2) == DONE
    text = capsys.readouterr().out
    assert evaluate("cues", log, "--folds", 2, "--json") == DONE
    told = json.loads(capsys.readouterr().out)
    assert set(told) == {"table", "turn_signal"}
    assert f"{told['table']['n_steps']} steps from cell to cell, 8 vehicles, held out by vehicle, 2 folds" in text
    for name in ("cell_before", "own_course"):
        line = next(line for line in text.splitlines() if line.startswith(name.replace("_", " ")))
        score = told["table"][name]
        assert line.split()[2:] == [
            f"{told['table']['prior']:.3f}", f"{score['observation']:.3f}", f"{score['posterior']:.3f}",
            f"{score['gain']:+.1%}", f"{score['log_gain']:+.3f}",
        ]  # fmt: skip


def test_what_cannot_be_held_out_is_one_line(log, capsys):
    assert evaluate("density", log, "--split", "group") == FAILED
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "at least two to split by group, got 1" in error
    assert evaluate("cues", log, "--split", "random") == USAGE
    assert evaluate("density", log, "--folds", 0) == USAGE
