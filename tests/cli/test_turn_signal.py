"""A turn signal of a table moves what `dirprim track` believes of the vehicle: Eq. 4, from column to estimates."""

import numpy as np
import pytest

from dirprim_filter import learn_primitives, read_estimates, save_map
from dirprim_filter.cli.main import run
from dirprim_filter.recording.reader import stream_detections
from situations import junction_traffic

SEEN_S, UNTIL_S = 2.2, 5.6
"""The vehicle is seen until it is some metres before the junction; a second one, far behind, goes on being seen."""


@pytest.fixture(scope="module")
def junction(tmp_path_factory):
    """A folder with the map of a junction whose vehicles turn either way or go straight on."""
    folder = tmp_path_factory.mktemp("junction")
    traffic = junction_traffic(np.random.default_rng(0))
    learned = learn_primitives(traffic, tessellation="grid", cell_size=8.0, rng=np.random.default_rng(0))
    save_map(learned, folder / "map.mcap")
    return folder


def table(path, signal):
    lines = ["time_s,track_id,x_m,y_m,turn_signal"]
    for t in np.arange(0.0, UNTIL_S, 0.1):
        if t <= SEEN_S:
            lines.append(f"{t:.1f},ahead,{10 * t:.3f},0,{signal if t > 1.0 else ''}")
        lines.append(f"{t:.1f},behind,{-30 + 4 * t:.3f},0,none")
    path.write_text("\n".join(lines) + "\n")
    return path


def north_of_the_road(folder, signal, name=None):
    """Metres, the mean place of the unseen vehicle some seconds later."""
    name = name or signal or "no"
    log, out = folder / f"{name}.mcap", folder / f"{name}.out.mcap"
    options = ("--noise", "0.3", "--particles", "2000", "--clutter-density", "1e-9", "--force")
    assert run(["convert", str(table(folder / f"{name}.csv", signal)), "-o", str(log), "--force"]) == 0
    assert run(["track", str(log), "--map", str(folder / "map.mcap"), "-o", str(out), *options]) == 0
    found = read_estimates(out)
    unseen = (found.track_id == "ahead") & (found.unseen_s > 3.2)
    assert unseen.any()
    return found.position[unseen][0, 1]


def test_the_signal_of_a_table_moves_the_vehicle_to_its_side(junction):
    left, none, right = (north_of_the_road(junction, signal) for signal in ("left", "none", "right"))
    assert left > none + 0.8
    assert right < none - 0.8
    assert none == north_of_the_road(junction, "")


def test_signals_are_read_as_they_stand_and_nothing_else_is_one(junction, capsys):
    assert run(["convert", str(table(junction / "a.csv", "LEFT ")), "-o", str(junction / "a.mcap")]) == 0
    seen = list(stream_detections(junction / "a.mcap"))
    signals = {name: {tuple(row) for frame in seen for row in frame.cue[frame.track_id == name] if row[1] > 0}
               for name in ("ahead", "behind")}  # fmt: skip
    assert signals == {"ahead": {(np.pi / 2, 2.5)}, "behind": set()}
    capsys.readouterr()
    assert run(["convert", str(table(junction / "b.csv", "lft")), "-o", str(junction / "b.mcap")]) == 1
    assert "b.csv, line 24: expected left, right, none as turn_signal, got 'lft'" in capsys.readouterr().err
