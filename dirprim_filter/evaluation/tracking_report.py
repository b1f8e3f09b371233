"""All figures of one tracker's output against the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.course import MOVING_FROM
from dirprim_filter.distributions import gaussian
from dirprim_filter.distributions.angles import difference
from dirprim_filter.evaluation.metrics.clear_mot import clear_mot, identity_f1
from dirprim_filter.evaluation.metrics.comparison import SIMILARITY_M, Comparison
from dirprim_filter.evaluation.metrics.gospa import gospa
from dirprim_filter.evaluation.metrics.hota import hota
from dirprim_filter.evaluation.tracked_rows import TrackedRows, names_in_group
from dirprim_filter.track_ids import vehicle_numbers
from dirprim_filter.tracks import Tracks

GAP_FROM_S = 0.5
"""Where only the tracker says when a vehicle was measured: unseen for longer is a gap, for less a missed frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingReport:
    """One tracker's figures in one run; NaN where undefined.

    Attributes:
        rmse: metres, of all estimates of vehicles.
        seen_rmse: metres, of vehicles in sight.
        hidden_rmse: metres, inside gaps.
        direction_rmse: radians, of vehicles that move at 0.5 m/s or faster.
        speed_rmse: m/s.
        nees: mean normalised squared error of the position; 2 where the covariances are right.
        seen_nees: of vehicles in sight.
        hidden_nees: inside gaps.
        coverage_90: share of the true positions in the ellipses that should hold nine tenths of them, seen and hidden.
        hidden_coverage_90: inside gaps.
        reported: share of the truth's rows that have an estimate.
        interpolated: share of the truth's rows that are interpolated.
        hota: higher order tracking accuracy, of detection and association alike.
        deta: its detection accuracy.
        assa: its association accuracy.
        loca: its localisation accuracy.
        idf1: share of the time for which one track stands for one vehicle.
        mota: CLEAR MOT's accuracy.
        switches: of identity, by CLEAR MOT's rule.
        gospa: metres; its square, like its parts, is per row of the truth: a vehicle at an instant.
        localisation: square metres per row of the truth, the part of `gospa` squared that is distance.
        missed: likewise, vehicles without an estimate.
        false: likewise, estimates without a vehicle.
    """

    rmse: float
    seen_rmse: float
    hidden_rmse: float
    direction_rmse: float
    speed_rmse: float
    nees: float
    seen_nees: float
    hidden_nees: float
    coverage_90: float
    hidden_coverage_90: float
    reported: float
    interpolated: float
    hota: float
    deta: float
    assa: float
    loca: float
    idf1: float
    mota: float
    switches: float
    gospa: float
    localisation: float
    missed: float
    false: float


class Judged(NamedTuple):
    """A report, and the errors that it is of.

    Attributes:
        report: the figures.
        errors: (2, n) of each row of the truth: squared error, m2, and in units of the covariance; or NaN.
        late_s: seconds by which the estimates were later, if errors along the way came of that; earlier below 0.
        late_share: how much of the squared error such a delay explains, a share.
    """

    report: TrackingReport
    errors: FloatArray
    late_s: float
    late_share: float


def report_of(
    rows: TrackedRows, truth: Tracks, *, is_hidden: BoolArray | None = None, with_ids: bool,
    similarity_m: float = SIMILARITY_M, interpolated: float = 0.0,
) -> Judged:  # fmt: skip
    """Compare what a tracker says with the truth, of which each group is a scene, row by row.

    Args:
        rows: at instants of the truth.
        truth: where vehicles were at all instants that are judged, see `judged_truth`.
        is_hidden: (n,) rows of the truth that the sensor did not see; None: as `unseen_s` of the rows says.
        with_ids: assign estimates to vehicles by id; else by GOSPA's assignment.
        similarity_m: metres, the length of all metrics.
        interpolated: share of the truth's rows that are.

    Raises:
        ValueError: the truth has no row.
    """
    if len(truth) == 0:
        raise ValueError("truth: expected at least one row, got none")
    comparison = Comparison.of(truth, rows, similarity_m=similarity_m)
    points, clear, sets = hota(comparison), clear_mot(comparison), gospa(comparison)
    row, column = _by_name(rows, truth, comparison) if with_ids else sets.pairs[:2]
    squared, normalised, turn, pace = errors = _errors(rows, truth, row, column)
    if is_hidden is None:  # as the tracker says; neither seen nor hidden without that
        seen, hidden = rows.unseen_s[column] <= GAP_FROM_S, rows.unseen_s[column] > GAP_FROM_S
    else:
        seen, hidden = ~is_hidden[row], is_hidden[row]
    per_row = 1.0 / len(truth)
    by_row = np.full((2, len(truth)), np.nan)
    by_row[:, row] = errors[:2]
    report = TrackingReport(
        rmse=_root(squared), seen_rmse=_root(squared[seen]), hidden_rmse=_root(squared[hidden]),
        direction_rmse=_root(turn**2), speed_rmse=_root(pace**2), nees=_mean(normalised),
        seen_nees=_mean(normalised[seen]), hidden_nees=_mean(normalised[hidden]),
        coverage_90=coverage(normalised, 0.9), hidden_coverage_90=coverage(normalised[hidden], 0.9),
        reported=row.size * per_row, interpolated=interpolated, **points._asdict(),
        idf1=identity_f1(comparison), mota=clear.mota, switches=clear.switches,
        gospa=sets.distance * np.sqrt(per_row), localisation=sets.localisation * per_row,
        missed=sets.missed * per_row, false=sets.false * per_row,
    )  # fmt: skip
    velocity = truth.speed[row, None] * np.column_stack([np.cos(truth.direction[row]), np.sin(truth.direction[row])])
    behind = float(((truth.position[row] - rows.position[column]) * velocity).sum())
    late_s = behind / max(float((velocity**2).sum()), 1e-300)
    return Judged(report, by_row, late_s, late_s * behind / max(float(squared.sum()), 1e-300))


def _errors(rows: TrackedRows, truth: Tracks, row: IntArray, column: IntArray) -> FloatArray:
    """(4, p) of pairs: squared error, the same by the covariance, radians of course, m/s of speed; NaN if unknown."""
    error, covariance = rows.position[column] - truth.position[row], rows.covariance[column]
    known = np.isfinite(covariance).all(axis=(1, 2))
    normalised = np.full(row.size, np.nan)
    normalised[known] = normalised_squared(error[known], covariance[known])
    turn = difference(rows.direction[column], truth.direction[row])
    turn = np.where(truth.speed[row] >= MOVING_FROM, turn, np.nan)  # standing vehicles have no course
    return np.stack([(error**2).sum(axis=1), normalised, turn, rows.speed[column] - truth.speed[row]])


def normalised_squared(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """(n,) squared errors (n, 2) in units of the covariances (n, 2, 2): NEES, chi squared of two degrees of freedom."""
    return gaussian.squared_distance(error, covariance + 1e-12 * np.eye(2))


def coverage(squared: FloatArray, share: float) -> float:
    """How many of the normalised squared errors (n,) in the ellipse that should hold `share` of them; NaN of none."""
    known = squared[~np.isnan(squared)]
    return float((known <= -2.0 * np.log(1.0 - share)).mean()) if known.size else float("nan")


def _root(squared: FloatArray) -> float:
    return float(np.sqrt(_mean(squared)))


def _mean(values: FloatArray) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else float("nan")


def _by_name(rows: TrackedRows, truth: Tracks, comparison: Comparison) -> tuple[IntArray, IntArray]:
    """Rows of the truth and of the estimates that have the same id in the same group at the same time."""
    names = np.concatenate([names_in_group(of.track_id, of.group) for of in (truth, rows)])
    vehicle = vehicle_numbers(names, np.r_[truth.group, rows.group])
    instant = np.concatenate([comparison.row_instant, comparison.column_instant])
    key = vehicle * (instant.max(initial=0) + 1) + instant
    _, row, column = np.intersect1d(key[: len(truth)], key[len(truth) :], assume_unique=True, return_indices=True)
    order = np.argsort(column)
    return row[order], column[order]
