"""Autoferry's radar and lidar of two boats in a harbour, with GNSS truth: five scenarios, and what tracks them.

One scenario is left out in turn: noise, detection probability and clutter are measured on the others, and the map is
learned from their true tracks. Detections have no ids.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from paired_errors import true_rows

from dirprim_filter import PrimitiveMap, Tracks, learn_primitives
from dirprim_filter.arrays import IntArray
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.evaluation.calibration.pairing import Scene, frames_of
from dirprim_filter.evaluation.metrics.comparison import Comparison
from dirprim_filter.evaluation.metrics.hota import hota
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.filtering import BayesFilter, Tracker

DATA = Path(__file__).parents[2] / "../shared/data/autoferry"
SCENARIOS = (2, 3, 4, 5, 6)
GATE_M = 15.0
"""From a boat to its detection."""
SIMILARITY_M = 20.0
"""Of HOTA: from here on nothing is similar; the noise is up to 5 m an axis."""
BESIDE_M = 50.0
"""Beyond the boats' bounding box by so much it is not known what is there: estimates are not judged."""
MAX_GAP_S = 10.0
"""Six turns of the radar."""


class Measured(NamedTuple):
    """A sensor on some scenarios: metres an axis, share of boats found, false detections per m2 and frame."""

    noise_m: float
    detection_probability: float
    clutter_density: float
    boat_density: float


@cache
def _columns(name: str) -> np.ndarray:
    return np.genfromtxt(DATA / name, delimiter=",", names=True, dtype=None, encoding="utf-8")


@cache
def true(scenario: int) -> Tracks:
    """Where both boats were."""
    rows = _columns("truth.csv")
    rows = rows[rows["group"] == scenario]
    return Tracks.from_positions(
        track_id=rows["track_id"], time_ns=np.round(rows["time_s"] * 1e9).astype(np.int64),
        position=np.column_stack([rows["x_m"], rows["y_m"]]), group=rows["group"],
    )  # fmt: skip


@cache
def detected(scenario: int, sensor: str) -> Detections:
    """What one sensor reported."""
    rows = _columns("detections.csv")
    rows = rows[(rows["group"] == scenario) & (rows["sensor"] == sensor)]
    return Detections(
        track_id=np.full(rows.size, NO_ID), time_ns=np.round(rows["time_s"] * 1e9).astype(np.int64),
        position=np.column_stack([rows["x_m"], rows["y_m"]]), group=rows["group"],
    )  # fmt: skip


@cache
def measured(sensor: str, without: int) -> Measured:
    """On all scenarios but one."""
    squared, n_true, n_hit, n_stray, exposure = [], 0, 0, 0, 0.0
    for scenario in SCENARIOS:
        if scenario == without:
            continue
        seen, scene = detected(scenario, sensor), Scene(detected(scenario, sensor), true(scenario))
        rows = scene.truth_at(0.0)
        row, column = scene.matched(rows, gate_m=GATE_M)
        squared.append(((seen.position[column] - rows.position[row]) ** 2).sum(axis=1))
        n_true, n_hit = n_true + rows.frame.size, n_hit + row.size
        low, high = rows.position.min(axis=0) - GATE_M, rows.position.max(axis=0) + GATE_M
        stray = np.setdiff1d(np.arange(len(seen)), column)
        n_stray += int(((seen.position[stray] > low) & (seen.position[stray] < high)).all(axis=1).sum())
        exposure += float(np.prod(high - low)) * scene.frame_s.size
    return Measured(
        noise_m=float(np.sqrt(np.concatenate(squared).mean() / 2.0)), detection_probability=n_hit / n_true,
        clutter_density=(n_stray + 0.5) / exposure, boat_density=n_true / exposure,
    )  # fmt: skip


class Scenario(NamedTuple):
    """One scenario as a choice of sensors shows it, with what the others say of these."""

    seen: Detections
    instants: IntArray
    config: FilterConfig
    tracking: TrackingConfig

    @classmethod
    def of(cls, scenario: int, sensors: Sequence[str]) -> Scenario:
        """With a covariance at each detection: its own sensor's."""
        known = [measured(sensor, scenario) for sensor in sensors]
        seen = [detected(scenario, sensor) for sensor in sensors]
        frames = [frames_of(part)[:, 1] for part in seen]
        share = np.array([part.size for part in frames]) / sum(part.size for part in frames)
        spread = [of.noise_m for of in known]
        covariance = np.concatenate(
            [np.tile(s**2 * np.eye(2), (len(part), 1, 1)) for part, s in zip(seen, spread, strict=True)]
        )
        boats = float(np.mean([of.boat_density for of in known]))
        return cls(
            seen=replace(Detections.concatenate(seen), covariance=covariance),
            instants=np.unique(np.concatenate(frames)),
            config=FilterConfig(noise_m=max(spread), max_gap_s=MAX_GAP_S),
            tracking=TrackingConfig(
                detection_probability=float(share @ [of.detection_probability for of in known]),
                clutter_density=float(share @ [of.clutter_density for of in known]), vehicle_density=boats,
            ),
        )  # fmt: skip

    def tracked(self, model: PrimitiveMap | BayesFilter, seed: int) -> Estimates:
        """All estimates, at frames in which nothing was seen as well."""
        tracker = Tracker(model, config=self.config, tracking=self.tracking, rng=np.random.default_rng(seed))
        frames = {int(frame.time_ns[0]): frame for frame in self.seen.frames()}
        return Estimates.concatenate([
            tracker.step(frames.get(time_ns, Detections.none()), time_ns=time_ns) for time_ns in self.instants.tolist()
        ])  # fmt: skip


def nearby(estimates: Estimates, scenario: int) -> Estimates:
    """Those that are where the truth says what is there."""
    place = true(scenario).position
    low, high = place.min(axis=0) - BESIDE_M, place.max(axis=0) + BESIDE_M
    return estimates[((estimates.position > low) & (estimates.position < high)).all(axis=1)]


def hota_of(found: Estimates, scenario: int, instants: IntArray) -> float:
    """HOTA of a scenario."""
    truth = true_rows(true(scenario), instants)[0]
    return hota(Comparison.of(truth, TrackedRows.of(found, group=scenario), similarity_m=SIMILARITY_M)).hota


@cache
def learned(scenario: int, seed: int) -> PrimitiveMap:
    """A map of the other scenarios' true tracks."""
    others = Tracks.concatenate([true(other) for other in SCENARIOS if other != scenario])
    return learn_primitives(others, rng=np.random.default_rng(seed))
