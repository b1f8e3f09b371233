"""How good are estimates of where vehicles are?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.distributions.angles import difference
from dirprim_filter.estimates import Estimates
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks

MOVING_FROM = 0.5
"""m/s; below it a vehicle has no course to be wrong about."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingScore:
    """Errors of estimates against the truth, over the rows that have one.

    Attributes:
        n_rows: estimates that were scored.
        n_vehicles: vehicles that they belong to.
        position_rmse: metres, root mean square distance.
        direction_rmse: radians, of vehicles in motion.
        speed_rmse: m/s.
        nees: mean normalised estimation error squared of the position: 2 where covariances are right, above it
            where they are too small.
        coverage_50: share of the rows whose true position lies in the ellipse that should hold half of them.
        coverage_90: likewise, nine tenths.
    """

    n_rows: int
    n_vehicles: int
    position_rmse: float
    direction_rmse: float
    speed_rmse: float
    nees: float
    coverage_50: float
    coverage_90: float


def score(estimates: Estimates, truth: Tracks) -> TrackingScore:
    """Compare estimates with the truth of the same vehicle and time; rows without a truth do not count.

    Raises:
        ValueError: no estimate has a truth.
    """
    row, true_row = matches((estimates.track_id, estimates.time_ns), (truth.track_id, truth.time_ns))
    if row.size == 0:
        raise ValueError("estimates: expected rows of vehicles and times that the truth holds, got none")
    error = estimates.position[row] - truth.position[true_row]
    squared = normalised_squared(error, estimates.covariance[row])
    turn = difference(estimates.direction[row], truth.direction[true_row])[truth.speed[true_row] >= MOVING_FROM]
    pace = estimates.speed[row] - truth.speed[true_row]
    return TrackingScore(
        n_rows=int(row.size),
        n_vehicles=int(np.unique(truth.track_id[true_row]).size),
        position_rmse=float(np.sqrt((error**2).sum(axis=1).mean())),
        direction_rmse=float(np.sqrt((turn**2).mean())) if turn.size else float("nan"),
        speed_rmse=float(np.sqrt((pace**2).mean())),
        nees=float(squared.mean()),
        coverage_50=coverage(squared, 0.5),
        coverage_90=coverage(squared, 0.9),
    )


def normalised_squared(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """(n,) squared errors (n, 2) in units of the covariances (n, 2, 2): NEES, chi squared of two degrees of freedom."""
    covariance = covariance + 1e-12 * np.eye(2)
    return np.asarray(np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0]))


def coverage(squared: FloatArray, share: float) -> float:
    """Share of normalised squared errors (n,) in the ellipse that should hold `share` of them; NaN of none."""
    return float((squared <= -2.0 * np.log(1.0 - share)).mean()) if squared.size else float("nan")


def matches(estimates: tuple[AnyArray, IntArray], truth: tuple[AnyArray, IntArray]) -> tuple[IntArray, IntArray]:
    """Of ids and times: rows of the estimates, and for each the row of the truth with its id and time."""
    (track_id, time_ns), (true_id, true_time_ns) = estimates, truth
    vehicle, true_vehicle = _common_numbers(as_texts(track_id), as_texts(true_id))
    order = np.lexsort((true_time_ns, true_vehicle))
    key = np.stack([true_vehicle[order], true_time_ns[order]], axis=1)
    wanted = np.stack([vehicle, time_ns], axis=1)
    pairs = np.ascontiguousarray(np.concatenate([key, wanted]))
    _, number = np.unique(pairs, axis=0, return_inverse=True)
    number = number.ravel()
    place = np.full(number.max(initial=-1) + 1, -1, np.int64)
    place[number[: len(key)]] = order
    found = place[number[len(key) :]]
    row = np.flatnonzero(found >= 0)
    return row, found[row]


def _common_numbers(a: AnyArray, b: AnyArray) -> tuple[IntArray, IntArray]:
    """Ids of both as numbers, the same for the same id."""
    _, number = np.unique(np.concatenate([a, b]), return_inverse=True)
    return number[: a.size].astype(np.int64), number[a.size :].astype(np.int64)
