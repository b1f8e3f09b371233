"""Does the map help on real sensors? Roadside detections of cars, radar and lidar of boats, raw GPS of buses.

    python tests/benchmarks/real_sensors.py [mcity|autoferry|buses] --json [--seeds 3]

A drive, a scenario or a fold of trips is left out in turn; its sensor and map are known from the others alone. Fitted
rivals have the parameters under which the truth of the others is likeliest, on a grid without bounds. Differences are
paired, at the rows that both methods have, with 95 % intervals over drives, scenarios or trips: with four drives or
five scenarios, each counted alike, they are wide. All is scored against the truth interpolated between its rows.
Nothing of the product was tuned to these data.

Mcity, why not: the sensor's error lasts for seconds (.995 of its variance), so every filter stays near the detections
less bias and latency, whatever its motion. A map of some 35 vehicles leaves 15 to 43 % of the true way outside
its cells.

autoferry, why not: boats go where they like; 60 % of a held-out scenario is outside the map of the other four, which
gives its motion no more density than no map does. What is wrong is the sensor: offsets of 2 to 10 m that last from turn
to turn, on which a filter of white noise is sure of itself.

Buses: the density gains much, forecasts are a quarter to two fifths nearer than constant velocity; remembered trips are
nearer still.
"""

from __future__ import annotations

import argparse
import json
import logging
import math
import sys
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import autoferry_scenarios as ferry
import bus_trips as buses
import mcity_drives as mcity
import numpy as np
from paired_errors import Figures, RowErrors, less_error, true_rows

from dirprim_filter.arrays import IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.evaluation.intervals import (
    Interval,
    clustered,
    difference_of_means,
    interval,
    mean,
    paired,
    reduction_of_mean,
)
from dirprim_filter.evaluation.metrics.clear_mot import clear_mot
from dirprim_filter.evaluation.metrics.comparison import Comparison
from dirprim_filter.evaluation.metrics.hota import hota
from dirprim_filter.evaluation.tracked_rows import TrackedRows

WITH, WITHOUT, STRAIGHT = "with the map", "without the map", "constant velocity"
FEWEST = 20
"""True rows without a detection, of drives whose coasting is judged."""


@dataclass(slots=True)
class Table:
    """Of each method its figures, and of pairs of methods by how much the first is better."""

    title: str
    rows: dict[str, dict[str, float]] = field(default_factory=dict)
    gains: dict[str, Interval] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """Plain values; what is not known is null."""

        def plain(values: Mapping[str, float]) -> dict[str, float | None]:
            return {key: round(float(of), 5) if math.isfinite(of) else None for key, of in values.items()}

        gains = {name: plain(of._asdict()) for name, of in self.gains.items()}
        return {"rows": {name: plain(of) for name, of in self.rows.items()}, "gains": gains}


def of_mcity(n_seeds: int) -> list[Table]:
    """Drives, left out in turn."""
    runs: dict[str, dict[int, list[RowErrors]]] = {}
    scale: dict[int, float] = {}
    seen: dict[int, Any] = {}
    coasting: dict[int, Any] = {}
    for drive in mcity.WITH_TRUTH:
        detections, truth = Detections.of(mcity.detected(drive)), mcity.true(drive)
        raw = RowErrors.of(detections, truth, gate_m=mcity.GATE_M)
        scale[drive], seen[drive] = float(np.sqrt(raw.squared.mean())), raw.key
        hidden = np.setdiff1d(true_rows(truth, detections.time_ns)[1], raw.key)
        if hidden.size >= FEWEST:
            coasting[drive] = hidden
        runs.setdefault("raw", {})[drive] = [raw]
        runs.setdefault("raw less bias and latency", {})[drive] = [mcity.corrected(drive)]
        for name, method in mcity.methods(drive):
            n_runs = 1 if name == STRAIGHT else n_seeds
            found = [RowErrors.of(method(seed), truth, gate_m=mcity.GATE_M) for seed in range(n_runs)]
            runs.setdefault(name, {})[drive] = found
    tables = []
    for where, keys in (("in sight", seen), (f"coasting, drives {', '.join(map(str, coasting))}", coasting)):
        table = Table(f"Mcity, {where}: RMSE over raw, means over {len(keys)} drives of {n_seeds} seeds")
        for name, of in runs.items():
            total = Figures.of(of, scale, keys)
            each = {f"drive {d}": Figures.of(of, scale, {d: keys[d]}).rmse for d in keys}
            others = {"nees": total.nees, "in 90 %": total.coverage_90, "reported": total.reported}
            table.rows[name] = {"rmse": total.rmse, **each, **others}
        for rival in (WITHOUT, STRAIGHT):
            table.gains[f"{WITH} against {rival}, less error"] = less_error(runs[WITH], runs[rival], keys)
        tables.append(table)
    return tables


def of_autoferry(n_seeds: int) -> list[Table]:
    """Scenarios, left out in turn, with each choice of sensors."""
    return [_of_sensors(name, sensors, n_seeds) for name, sensors in ferry.SENSORS.items()]


def points_of(found: Estimates, scenario: int, instants: IntArray) -> tuple[float, float]:
    """HOTA and identity switches of a scenario."""
    truth = true_rows(ferry.true(scenario), instants)[0]
    beside = Comparison.of(truth, TrackedRows.of(found, group=scenario), similarity_m=ferry.SIMILARITY_M)
    return hota(beside).hota, clear_mot(beside).switches


def _of_sensors(what: str, sensors: tuple[str, ...], n_seeds: int) -> Table:
    runs: dict[str, dict[int, list[RowErrors]]] = {}
    tracks: dict[str, dict[int, list[float]]] = {}
    keys: dict[int, Any] = {}
    for scenario in ferry.SCENARIOS:
        scene = ferry.Scenario.of(scenario, sensors)
        keys[scenario] = true_rows(ferry.true(scenario), scene.instants)[1]
        raw = RowErrors.of(scene.seen, ferry.true(scenario), gate_m=ferry.GATE_M)
        runs.setdefault("raw", {})[scenario] = [raw]
        for name, run in ferry.methods(scenario, sensors):
            for seed in range(1 if name == STRAIGHT else n_seeds):
                found = ferry.nearby(run(seed), scenario)
                errors = RowErrors.of(found, ferry.true(scenario), gate_m=ferry.SIMILARITY_M)
                runs.setdefault(name, {}).setdefault(scenario, []).append(errors)
                scores = points_of(found, scenario, scene.instants)
                tracks.setdefault(name, {}).setdefault(scenario, []).append(scores)
    table = Table(
        f"autoferry, {what}: {n_seeds} seeds, HOTA with similarity 0 from {ferry.SIMILARITY_M:g} m, RMSE in metres"
    )
    one = dict.fromkeys(ferry.SCENARIOS, 1.0)
    points = {name: np.array([np.mean(of[s], axis=0) for s in ferry.SCENARIOS]) for name, of in tracks.items()}
    for name, of in runs.items():
        figures = Figures.of(of, one, keys)
        score, switches = points[name].mean(axis=0) if name in points else (np.nan, np.nan)
        table.rows[name] = {
            "hota": score, "rmse": figures.rmse, "nees": figures.nees, "in 90 %": figures.coverage_90,
            "switches": switches, "reported": figures.reported,
        }  # fmt: skip
    for rival in (WITHOUT, STRAIGHT):
        table.gains[f"{WITH} against {rival}, less error"] = less_error(runs[WITH], runs[rival], keys)
        more = np.column_stack([points[WITH][:, 0], np.ones(len(keys)), points[rival][:, 0], np.ones(len(keys))])
        table.gains[f"{WITH} against {rival}, more HOTA"] = interval(more, difference_of_means)
    return table


def of_buses(_: int) -> list[Table]:
    """Trips, in two folds."""
    trip, log_p = buses.densities()
    density = Table(f"Buses: held-out log density of course and speed, {trip.size} rows, two folds")
    for name, values in log_p.items():
        of = interval(clustered(trip, [values, np.ones(trip.size)]), mean)
        density.rows[name] = {"log density": of.value, "low": of.low, "high": of.high}
        density.gains[f"{WITH} against {name}, nat a row"] = paired(trip, log_p[WITH], values, difference_of_means)
    trip, energy = buses.forecasts()
    ahead = Table("Buses: energy score in metres of forecasts, starts that see only the past")
    ahead.rows = {name: {} for name in energy}
    for h, horizon in enumerate(buses.HORIZONS_S):
        for name, values in energy.items():
            known = np.isfinite(values[:, h])
            of = interval(clustered(trip[known], [values[known, h], np.ones(known.sum())]), mean)
            ahead.rows[name] |= {f"{horizon:g} s": of.value, f"{horizon:g} s +-": of.half_width}
            less = paired(trip, energy[WITH][:, h], values[:, h], reduction_of_mean)
            ahead.gains[f"{horizon:g} s, {WITH} against {name}, less"] = less
    return [density, ahead]


SETS: dict[str, tuple[Path, Callable[[int], Iterable[Table]]]] = {
    "mcity": (mcity.DATA, of_mcity),
    "autoferry": (ferry.DATA, of_autoferry),
    "buses": (buses.DATA, of_buses),
}


def main() -> None:
    """Print the tables of one set, or of all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set", nargs="?", choices=list(SETS))
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--seeds", type=int, default=3)
    given = parser.parse_args()
    logging.disable(logging.WARNING)
    for expected in ("overflow encountered in exp", "Mean of empty slice"):
        warnings.filterwarnings("ignore", expected)
    made: dict[str, Any] = {}
    for name in [given.set] if given.set else SETS:
        data, tables = SETS[name]
        if not data.exists():
            print(f"{name}: skipped, {data} is absent", file=sys.stderr)
            continue
        for table in tables(given.seeds):
            made[table.title] = table.as_json()
    print(json.dumps(made, indent=None if given.json else 1))


if __name__ == "__main__":
    main()
