"""What a newcomer does with a log of his own, on real data that ship: from a table to a map, tracks and scores."""

from pathlib import Path

import numpy as np
import pytest

from dirprim_filter import learn_primitives, read_estimates, read_tracks
from dirprim_filter.cli.main import run as dirprim
from dirprim_filter.evaluation.forecast_cases import SCORES, Cases, score_cases
from dirprim_filter.evaluation.forecasting import by_constant_velocity, rollouts_of

DATA = Path(__file__).parent / "data"
HORIZONS_S = (1.0, 3.0)
GATE_M = 15.0
"""From a boat to its detection: three deviations of the worst sensor."""


@pytest.fixture(scope="module")
def junction():
    """Recordings that share no vehicle: three to learn from, one to judge by."""
    tracks = read_tracks(DATA / "junction.csv")
    is_held_out = tracks.group == np.unique(tracks.group)[-1]
    return tracks[~is_held_out], tracks[is_held_out]


@pytest.fixture(scope="module")
def junction_map(junction):
    return learn_primitives(junction[0], tessellation="grid", rng=np.random.default_rng(0))


def test_where_traffic_goes_is_known_from_other_recordings(junction, junction_map):
    """Held-out vehicles, one value each: the map is ahead of itself without places beyond three standard errors."""
    rows = junction[1][junction[1].speed > 0.5]
    seen = (rows.position, rows.direction, rows.speed)
    gain = junction_map.log_density(*seen) - junction_map.without_places().log_density(*seen)
    _, vehicle = np.unique(rows.track_id, return_inverse=True)
    of_vehicle = np.bincount(vehicle, gain) / np.bincount(vehicle)
    assert of_vehicle.mean() > 3.0 * of_vehicle.std() / np.sqrt(len(of_vehicle)) > 0.0


def test_forecasts_are_nearer_than_constant_velocity(junction, junction_map):
    train, held_out = junction
    rng = np.random.default_rng(0)
    cases = Cases.of(held_out, horizons_s=HORIZONS_S)
    straight = by_constant_velocity(train, HORIZONS_S, rng)["constant velocity"].sample
    of_map, of_velocity = (
        score_cases(sample(cases, 50, rng), cases.later)[..., SCORES.index("energy")]
        for sample in (rollouts_of(junction_map, HORIZONS_S), straight)
    )
    assert (np.nanmean(of_map, axis=0) < np.nanmean(of_velocity, axis=0)).all()


def nearest(position, time_s, truth):
    """Distance of each row to the nearest vehicle of the truth, interpolated to its time, metres."""
    distance = np.full(len(time_s), np.inf)
    for name in np.unique(truth["track_id"]):
        own = truth[truth["track_id"] == name]
        there = np.column_stack([np.interp(time_s, own["time_s"], own[axis]) for axis in ("x_m", "y_m")])
        distance = np.minimum(distance, np.hypot(*(position - there).T))
    return distance


def rows_of(name, group):
    rows = np.genfromtxt(DATA / name, delimiter=",", names=True, dtype=None, encoding="utf-8")
    return rows[rows["group"] == group]


@pytest.mark.slow
def test_detections_without_ids_become_tracks_of_both_boats(tmp_path):
    """A map of another scenario; tracks are nearer to the boats than the detections that are of boats."""
    arguments = ["learn", DATA / "boats_truth.csv", "-o", tmp_path / "map.mcap", "--set", "group=4"]
    assert dirprim([*map(str, arguments), "--tessellation", "grid"]) == 0
    arguments = ["track", DATA / "boats_detections.csv", "--map", tmp_path / "map.mcap", "-o", tmp_path / "out.mcap"]
    assert dirprim([*map(str, arguments), "--set", "group=2", "--no-ids", "--noise", "3"]) in {0, 3}
    truth, detected = rows_of("boats_truth.csv", 2), rows_of("boats_detections.csv", 2)
    raw = nearest(np.column_stack([detected["x_m"], detected["y_m"]]), detected["time_s"], truth)
    estimates = read_estimates(tmp_path / "out.mcap")
    tracked = nearest(estimates.position, estimates.time_ns * 1e-9, truth)
    assert (tracked < GATE_M).sum() > 200
    assert np.sqrt((tracked[tracked < GATE_M] ** 2).mean()) < np.sqrt((raw[raw < GATE_M] ** 2).mean())
