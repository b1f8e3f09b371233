"""A turn signal of a table moves what `dirprim track` believes of the vehicle: Eq. 4, from column to estimates."""

from pathlib import Path

import numpy as np
import pytest

from cli.commands import DONE, dirprim
from dirprim_filter import learn_primitives, read_estimates, save_map
from dirprim_filter.recording.reader import stream_detections
from situations import junction_traffic

SEEN_S, UNTIL_S = 2.2, 5.6
"""The vehicle is seen until it is some metres before the junction; a second one, far behind, goes on being seen."""


@pytest.fixture
def junction(tmp_path, monkeypatch):
    """The working folder, with the map of a junction whose vehicles turn either way or go straight on."""
    monkeypatch.chdir(tmp_path)
    traffic = junction_traffic(np.random.default_rng(0))
    save_map(learn_primitives(traffic, tessellation="grid", cell_size=8.0, rng=np.random.default_rng(0)), "map.mcap")


def write_table(name, signal):
    lines = ["time_s,track_id,x_m,y_m,turn_signal"]
    for t in np.arange(0.0, UNTIL_S, 0.1):
        if t <= SEEN_S:
            lines.append(f"{t:.1f},ahead,{10 * t:.3f},0,{signal if t > 1.0 else ''}")
        lines.append(f"{t:.1f},behind,{-30 + 4 * t:.3f},0,none")
    Path(name).write_text("\n".join(lines) + "\n")


def test_the_signal_of_a_table_moves_the_vehicle_to_its_side(junction):
    north = {}  # metres, the mean place of the unseen vehicle some seconds later
    for signal in ("left", "none", "right", ""):
        write_table("t.csv", signal)
        command = "track t.csv --map map.mcap -o out --noise 0.3 --particles 2000 --set clutter_density=1e-9 --force"
        assert dirprim(command) == DONE
        found = read_estimates("out")
        north[signal] = found.position[(found.track_id == "ahead") & (found.unseen_s > 3.2)][0, 1]
    assert north["left"] > north["none"] + 0.8
    assert north["right"] < north["none"] - 0.8
    assert north["none"] == north[""]


def test_signals_are_read_as_they_stand_and_nothing_else_is_one(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_table("a.csv", "LEFT ")
    assert dirprim("convert a.csv -o a.mcap") == DONE
    seen = list(stream_detections("a.mcap"))
    signals = {name: {tuple(row) for frame in seen for row in frame.cue[frame.track_id == name] if row[1] > 0}
               for name in ("ahead", "behind")}  # fmt: skip
    assert signals == {"ahead": {(np.pi / 2, 2.5)}, "behind": set()}
