"""What `dirprim track` says of a log that it hardly tracks, and of a map of another place."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cli.commands import DONE, FAILED, INPUT_LOST, dirprim
from dirprim_filter import load_map, write_tracks
from dirprim_filter.recording.scan import scan

MAP = "--map map.mcap -o out"
TRACK = f"{MAP} --noise 0.5 --particles 50 --force"


def test_a_map_of_another_place_is_refused_before_the_work(here, few, capsys):
    write_tracks(replace(few, position=few.position + 1e5), "far.mcap")
    assert dirprim(f"track log.mcap {TRACK}") == DONE
    assert ", 0.0% outside the map" in capsys.readouterr().out
    Path("out").unlink()
    for command in (
        f"track far.mcap {TRACK}",
        "evaluate tracking far.mcap --map map.mcap",
        f"smooth far.mcap {MAP}",
    ):
        assert dirprim(command) == FAILED
        said = " ".join(capsys.readouterr().err.split())
        assert "map.mcap: expected a map of the log's place, got one with 100.0% of the rows outside: those of" in said
        assert "far.mcap lie in x 99" in said
        assert not Path("out").exists()
    assert dirprim(f"track far.mcap {TRACK} --set without_map=true") == DONE
    assert ", 100.0% outside the map" in capsys.readouterr().out


@pytest.mark.parametrize("shift", [0.0, 15.0, 35.0])
def test_a_log_mostly_outside_of_the_map_is_asked_about(here, few, capsys, shift):
    """A ring of 20 m, moved: the warning comes with more than half of the rows outside, and only then."""
    cells = load_map("map.mcap").tessellation
    moved = replace(few, position=few.position + np.array([shift, 0.0]))
    write_tracks(moved, "moved.mcap")
    outside = float((cells.cell_of(moved.position) < 0).mean())
    assert outside < 1.0
    assert dirprim(f"track moved.mcap {TRACK}") in (DONE, INPUT_LOST)
    said = [line for line in capsys.readouterr().err.splitlines() if "is it the map of this place" in line]
    assert len(said) == (outside > 0.5)
    begins = f"WARNING: map.mcap: {outside:.1%} of the rows outside: those of moved.mcap"
    assert all(line.startswith(begins) for line in said)


def test_a_log_most_of_whose_rows_have_no_estimate_is_input_lost(here, capsys):
    assert dirprim(f"track log.mcap {TRACK} --no-ids --set clutter_density=10") == INPUT_LOST
    said = capsys.readouterr()
    assert "100.0% of 600 rows without an estimate" in said.out
    assert "most rows have no estimate" in said.err


@pytest.mark.parametrize("form", ["foxglove", "vision_msgs", "autoware"])
def test_estimates_are_written_in_the_messages_that_are_asked_for(here, form):
    assert dirprim(f"track log.mcap {TRACK} --as {form}") == DONE
    with scan("out") as log:
        schemas = {channel.schema.name.split("/")[0] for channel in log.channels()}
    ours = {"foxglove": "foxglove.SceneUpdate", "vision_msgs": "vision_msgs", "autoware": "autoware_perception_msgs"}
    assert schemas & {*ours.values()} == {ours["foxglove"], ours[form]}
