"""All figures of one tracker's output against the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.distributions.angles import difference
from dirprim_filter.evaluation.metrics.clear_mot import clear_mot
from dirprim_filter.evaluation.metrics.comparison import Comparison
from dirprim_filter.evaluation.metrics.error_kinds import error_kinds
from dirprim_filter.evaluation.metrics.gospa import gospa
from dirprim_filter.evaluation.metrics.hota import hota
from dirprim_filter.evaluation.metrics.identity import identity_f1
from dirprim_filter.evaluation.tracked_rows import TrackedRows, names_in_group
from dirprim_filter.track_ids import vehicle_numbers
from dirprim_filter.tracks import Tracks

SETTLED_S = 1.0
"""Seconds after a vehicle came into sight before its estimate counts as settled, past the initial transient."""
MOVING_FROM = 0.5
"""m/s; below it a vehicle has no course to be wrong about."""
GAP_FROM_S = 0.5
"""Where only the tracker says when a vehicle was measured: unseen for longer is a gap, for less a missed frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scales:
    """The lengths that metrics of points need.

    Attributes:
        cutoff_m: metres, farther than which an estimate is not of a vehicle, in GOSPA.
        similarity_m: metres, from which similarity is 0: max(0, 1 - distance / similarity_m).

    Raises:
        ValueError: a length is not positive.
    """

    cutoff_m: float = 5.0
    similarity_m: float = 5.0

    def __post_init__(self) -> None:
        for name in ("cutoff_m", "similarity_m"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected a positive distance in metres, got {getattr(self, name)}")

    def comparison(self, rows: TrackedRows, truth: Tracks) -> Comparison:
        """The rows beside the truth, for all metrics."""
        return Comparison.of(truth, rows, reach_m=max(self.cutoff_m, self.similarity_m))


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingReport:
    """One tracker's figures in one run; NaN where undefined.

    Attributes:
        rmse: metres, of all estimates of vehicles.
        seen_rmse: metres, of vehicles in sight.
        settled_rmse: metres, of vehicles that have been in sight for a second, since they appeared or were found again.
        hidden_rmse: metres, inside gaps.
        direction_rmse: radians, of vehicles that move at 0.5 m/s or faster.
        speed_rmse: m/s.
        nees: mean normalised squared error of the position; 2 where the covariances are right.
        seen_nees: of vehicles in sight.
        hidden_nees: inside gaps.
        coverage_50: share of the true positions in the ellipses that should hold half of them, seen and hidden.
        coverage_90: likewise, nine tenths.
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
        late_start: of these misses, false estimates and switches the kinds, see `ErrorKinds`.
        early_end: likewise, as are the next six.
        merged: likewise.
        overlooked: likewise.
        duplicate: likewise.
        ghost: likewise.
        swaps: likewise.
        breaks: likewise.
        gospa: metres; its square, like its parts, is per row of the truth: a vehicle at an instant.
        localisation: square metres per row of the truth, the part of `gospa` squared that is distance.
        missed: likewise, vehicles without an estimate.
        false: likewise, estimates without a vehicle.
    """

    rmse: float
    seen_rmse: float
    settled_rmse: float
    hidden_rmse: float
    direction_rmse: float
    speed_rmse: float
    nees: float
    seen_nees: float
    hidden_nees: float
    coverage_50: float
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
    late_start: float
    early_end: float
    merged: float
    overlooked: float
    duplicate: float
    ghost: float
    swaps: float
    breaks: float
    gospa: float
    localisation: float
    missed: float
    false: float

    @classmethod
    def of(
        cls,
        rows: TrackedRows,
        truth: Tracks,
        *,
        is_hidden: BoolArray | None,
        with_ids: bool,
        scales: Scales,
        interpolated: float = 0.0,
    ) -> TrackingReport:
        """Compare what a tracker says with the truth, of which each group is a world, row by row.

        Args:
            rows: at instants of the truth.
            truth: where vehicles were at all instants that are judged, see `judged_truth`.
            is_hidden: (n,) rows of the truth that the sensor did not see; None: as `unseen_s` of the rows says.
            with_ids: assign estimates to vehicles by id; else by GOSPA's assignment.
            scales: of the metrics.
            interpolated: share of the truth's rows that are.

        Raises:
            ValueError: the truth has no row.
        """
        if len(truth) == 0:
            raise ValueError("truth: expected at least one row, got none")
        comparison = scales.comparison(rows, truth)
        points = hota(comparison, similarity_m=scales.similarity_m)
        clear = clear_mot(comparison, similarity_m=scales.similarity_m)
        sets = gospa(comparison, cutoff_m=scales.cutoff_m)
        row, column = _by_name(rows, truth, comparison) if with_ids else sets.pairs[:2]
        errors = _Errors.of(rows, truth, row, column)
        if is_hidden is None:
            seen, hidden, settled = (of[column] for of in _as_said(rows, comparison.track))
        else:
            seen, hidden = ~is_hidden[row], is_hidden[row]
            settled = seen & (_in_sight_s(comparison.vehicle, truth.time_ns, is_hidden)[row] >= SETTLED_S)
        per_row = 1.0 / len(truth)
        return cls(
            rmse=errors.rmse(), seen_rmse=errors.rmse(seen), settled_rmse=errors.rmse(settled),
            hidden_rmse=errors.rmse(hidden), direction_rmse=_root_mean_square(errors.turn),
            speed_rmse=_root_mean_square(errors.pace), nees=errors.nees(), seen_nees=errors.nees(seen),
            hidden_nees=errors.nees(hidden), coverage_50=errors.coverage(0.5), coverage_90=errors.coverage(0.9),
            hidden_coverage_90=errors.coverage(0.9, hidden), reported=row.size * per_row, interpolated=interpolated,
            hota=points.hota, deta=points.deta, assa=points.assa, loca=points.loca,
            idf1=identity_f1(comparison, similarity_m=scales.similarity_m), mota=clear.mota, switches=clear.switches,
            **error_kinds(comparison, clear)._asdict(), gospa=sets.distance * np.sqrt(per_row),
            localisation=sets.localisation * per_row,
            missed=sets.missed * per_row, false=sets.false * per_row,
        )  # fmt: skip


def errors_by_row(rows: TrackedRows, truth: Tracks, *, with_ids: bool, scales: Scales) -> FloatArray:
    """(2, n) for each row of the truth: squared error, square metres, and in units of the covariance; NaN if unknown.

    Args:
        rows: at instants of the truth.
        truth: where vehicles were at all instants that are judged.
        with_ids: assign estimates to vehicles by id; else by GOSPA's assignment.
        scales: of the metrics.
    """
    comparison = scales.comparison(rows, truth)
    if with_ids:
        row, column = _by_name(rows, truth, comparison)
    else:
        row, column, _ = gospa(comparison, cutoff_m=scales.cutoff_m).pairs
    errors, found = _Errors.of(rows, truth, row, column), np.full((2, len(truth)), np.nan)
    found[:, row] = errors.squared, errors.normalised
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class _Errors:
    """Of estimates of vehicles, NaN where unknown.

    Attributes:
        squared: (p,) square metres.
        normalised: (p,) the same in units of the covariance.
        turn: (p,) radians of direction; of standing vehicles unknown.
        pace: (p,) m/s of speed.
    """

    squared: FloatArray
    normalised: FloatArray
    turn: FloatArray
    pace: FloatArray

    @classmethod
    def of(cls, rows: TrackedRows, truth: Tracks, row: IntArray, column: IntArray) -> _Errors:
        error = rows.position[column] - truth.position[row]
        covariance = rows.covariance[column]
        known = np.isfinite(covariance).all(axis=(1, 2))
        normalised = np.full(row.size, np.nan)
        normalised[known] = normalised_squared(error[known], covariance[known])
        turn = difference(rows.direction[column], truth.direction[row])
        return cls(
            squared=(error**2).sum(axis=1), normalised=normalised, pace=rows.speed[column] - truth.speed[row],
            turn=np.where(truth.speed[row] >= MOVING_FROM, turn, np.nan),
        )  # fmt: skip

    def rmse(self, which: BoolArray | slice = slice(None)) -> float:
        return float(np.sqrt(_mean(self.squared[which])))

    def nees(self, which: BoolArray | slice = slice(None)) -> float:
        return _mean(_known(self.normalised[which]))

    def coverage(self, share: float, which: BoolArray | slice = slice(None)) -> float:
        return coverage(_known(self.normalised[which]), share)


def normalised_squared(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """(n,) squared errors (n, 2) in units of the covariances (n, 2, 2): NEES, chi squared of two degrees of freedom."""
    covariance = covariance + 1e-12 * np.eye(2)
    return np.asarray(np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0]))


def coverage(squared: FloatArray, share: float) -> float:
    """Share of normalised squared errors (n,) in the ellipse that should hold `share` of them; NaN of none."""
    return float((squared <= -2.0 * np.log(1.0 - share)).mean()) if squared.size else float("nan")


def _root_mean_square(values: FloatArray) -> float:
    return float(np.sqrt(_mean(_known(values) ** 2)))


def _mean(values: FloatArray) -> float:
    return float(values.mean()) if values.size else float("nan")


def _known(values: FloatArray) -> FloatArray:
    return values[~np.isnan(values)]


def _by_name(rows: TrackedRows, truth: Tracks, comparison: Comparison) -> tuple[IntArray, IntArray]:
    """Rows of the truth and of the estimates that have the same id in the same group at the same time."""
    names = np.concatenate([names_in_group(of.track_id, of.group) for of in (truth, rows)])
    vehicle = vehicle_numbers(names, np.r_[truth.group, rows.group])
    instant = np.concatenate([comparison.row_instant, comparison.column_instant])
    key = vehicle * (instant.max(initial=0) + 1) + instant
    _, row, column = np.intersect1d(key[: len(truth)], key[len(truth) :], assume_unique=True, return_indices=True)
    order = np.argsort(column)
    return row[order], column[order]


def _as_said(rows: TrackedRows, track: IntArray) -> tuple[AnyArray, AnyArray, AnyArray]:
    """(m,) estimates in sight, in gaps, and settled, by the tracker's `unseen_s`; none without it."""
    hidden = rows.unseen_s > GAP_FROM_S
    seen = rows.unseen_s <= GAP_FROM_S
    return seen, hidden, seen & (_in_sight_s(track, rows.time_ns, hidden) >= SETTLED_S)


def _in_sight_s(identity: IntArray, time_ns: IntArray, is_hidden: BoolArray) -> FloatArray:
    """(n,) seconds since the vehicle of a row in sight appeared, or was found again."""
    order = np.lexsort((time_ns, identity))
    of, hidden = identity[order], is_hidden[order]
    begins = np.ones(order.size, np.bool_)
    begins[1:] = (of[1:] != of[:-1]) | (hidden[:-1] & ~hidden[1:])
    first = np.maximum.accumulate(np.where(begins, np.arange(order.size), 0))
    since = np.empty(order.size)
    since[order] = (time_ns[order] - time_ns[order][first]) * 1e-9
    return since
