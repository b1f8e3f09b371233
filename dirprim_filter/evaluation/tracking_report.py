"""All figures of one tracker's output against the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.evaluation.metrics.clear_mot import clear_mot
from dirprim_filter.evaluation.metrics.comparison import Comparison
from dirprim_filter.evaluation.metrics.error_kinds import error_kinds
from dirprim_filter.evaluation.metrics.gospa import gospa
from dirprim_filter.evaluation.metrics.hota import hota
from dirprim_filter.evaluation.metrics.identity import identity_f1
from dirprim_filter.evaluation.tracked_rows import TrackedRows, names_in_group
from dirprim_filter.evaluation.tracking import coverage, matches, normalised_squared
from dirprim_filter.tracks import Tracks

SETTLED_S = 1.0
"""Seconds after a vehicle came into sight before its estimate counts as settled, past the initial transient."""
GAP_FROM_S = 0.5
"""Where only the tracker says when a vehicle was measured: unseen for longer is a gap, for less a missed frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scales:
    """The lengths that metrics of points need.

    Attributes:
        cutoff_m: metres, farther than which an estimate is not of a vehicle, in GOSPA.
        similarity_m: metres, from which similarity is 0: max(0, 1 - distance / similarity_m).
    """

    cutoff_m: float = 5.0
    similarity_m: float = 5.0

    def comparison(self, rows: TrackedRows, truth: Tracks) -> Comparison:
        """The rows beside the truth, for all metrics.

        Raises:
            ValueError: a length is not positive.
        """
        for name in ("cutoff_m", "similarity_m"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected a positive distance in metres, got {getattr(self, name)}")
        return Comparison.of(
            truth, track_id=rows.track_id, time_ns=rows.time_ns, position=rows.position, group=rows.group,
            reach_m=max(self.cutoff_m, self.similarity_m),
        )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingReport:
    """One tracker's figures in one run; NaN where undefined.

    Attributes:
        rmse: metres, of all estimates of vehicles.
        seen_rmse: metres, of vehicles in sight.
        settled_rmse: metres, of vehicles that have been in sight for a second, since they appeared or were found again.
        hidden_rmse: metres, inside gaps.
        seen_nees: mean normalised squared error; 2 where the covariances are right.
        hidden_nees: inside gaps.
        coverage_50: share of the true positions in the ellipses that should hold half of them, seen and hidden.
        coverage_90: likewise, nine tenths.
        hidden_coverage_90: inside gaps.
        reported: share of the truth's rows that have an estimate.
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
        gap_rmse: (g,) metres, inside the gap of each vehicle that has one; NaN where it has no estimate there.
    """

    rmse: float
    seen_rmse: float
    settled_rmse: float
    hidden_rmse: float
    seen_nees: float
    hidden_nees: float
    coverage_50: float
    coverage_90: float
    hidden_coverage_90: float
    reported: float
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
    gap_rmse: tuple[float, ...]

    @classmethod
    def of(
        cls, rows: TrackedRows, truth: Tracks, *, is_hidden: BoolArray | None, with_ids: bool, scales: Scales
    ) -> TrackingReport:
        """Compare what a tracker says with the truth, of which each group is a world.

        Args:
            rows: at instants of the truth.
            truth: where vehicles were.
            is_hidden: (n,) rows of the truth that the sensor did not see; None: as `unseen_s` of the rows says.
            with_ids: assign estimates to vehicles by id; else by GOSPA's assignment
                to.
            scales: of the metrics.

        Raises:
            ValueError: the truth has no row, or a length is not positive.
        """
        if len(truth) == 0:
            raise ValueError("truth: expected at least one row, got none")
        comparison = scales.comparison(rows, truth)
        points, clear = (
            hota(comparison, similarity_m=scales.similarity_m),
            clear_mot(comparison, similarity_m=scales.similarity_m),
        )
        sets = gospa(comparison, cutoff_m=scales.cutoff_m)
        row, column = _by_name(rows, truth) if with_ids else (sets.pairs.row, sets.pairs.column)
        errors = _Errors.of(rows, truth, row, column)
        if is_hidden is None:
            seen, hidden, settled = (of[column] for of in _as_said(rows, comparison.track))
        else:
            seen, hidden = ~is_hidden[row], is_hidden[row]
            settled = seen & (_in_sight_s(comparison.vehicle, truth.time_ns, is_hidden)[row] >= SETTLED_S)
        per_row = 1.0 / len(truth)
        return cls(
            rmse=errors.rmse(), seen_rmse=errors.rmse(seen), settled_rmse=errors.rmse(settled),
            hidden_rmse=errors.rmse(hidden), seen_nees=errors.nees(seen), hidden_nees=errors.nees(hidden),
            coverage_50=errors.coverage(0.5), coverage_90=errors.coverage(0.9),
            hidden_coverage_90=errors.coverage(0.9, hidden), reported=row.size * per_row, hota=points.hota,
            deta=points.deta, assa=points.assa, loca=points.loca,
            idf1=identity_f1(comparison, similarity_m=scales.similarity_m), mota=clear.mota, switches=clear.switches,
            **error_kinds(comparison, clear)._asdict(), gospa=sets.distance * np.sqrt(per_row),
            localisation=sets.localisation * per_row,
            missed=sets.missed * per_row, false=sets.false * per_row,
            gap_rmse=() if is_hidden is None else _gap_rmse(errors, comparison.vehicle, row, is_hidden),
        )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class _Errors:
    """Of estimates of vehicles: (p,) square metres, and (p,) in units of the covariance, NaN where it is unknown."""

    squared: FloatArray
    normalised: FloatArray

    @classmethod
    def of(cls, rows: TrackedRows, truth: Tracks, row: IntArray, column: IntArray) -> _Errors:
        error = rows.position[column] - truth.position[row]
        covariance = rows.covariance[column]
        known = np.isfinite(covariance).all(axis=(1, 2))
        normalised = np.full(row.size, np.nan)
        normalised[known] = normalised_squared(error[known], covariance[known])
        return cls(squared=(error**2).sum(axis=1), normalised=normalised)

    def rmse(self, which: BoolArray | slice = slice(None)) -> float:
        return float(np.sqrt(_mean(self.squared[which])))

    def nees(self, which: BoolArray) -> float:
        return _mean(_known(self.normalised[which]))

    def coverage(self, share: float, which: BoolArray | slice = slice(None)) -> float:
        return coverage(_known(self.normalised[which]), share)


def assigned(rows: TrackedRows, truth: Tracks, *, with_ids: bool, scales: Scales) -> tuple[IntArray, IntArray]:
    """(m,) rows of the truth, and (m,) the estimate of each: by id, or by GOSPA's assignment."""
    if with_ids:
        return _by_name(rows, truth)
    pairs = gospa(scales.comparison(rows, truth), cutoff_m=scales.cutoff_m).pairs
    return pairs.row, pairs.column


def _mean(values: FloatArray) -> float:
    return float(values.mean()) if values.size else float("nan")


def _known(values: FloatArray) -> FloatArray:
    return values[~np.isnan(values)]


def _by_name(rows: TrackedRows, truth: Tracks) -> tuple[IntArray, IntArray]:
    """Rows of the truth and of the estimates that bear the same id in the same group at the same time."""
    ids, true_ids = (
        np.char.add(np.char.add(of.group.astype(np.str_), "/"), names_in_group(of.track_id, of.group))
        for of in (rows, truth)
    )
    column, row = matches((ids, rows.time_ns), (true_ids, truth.time_ns))
    return row, column


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


def _gap_rmse(errors: _Errors, vehicle: IntArray, row: IntArray, is_hidden: BoolArray) -> tuple[float, ...]:
    """Of each vehicle that has a gap, in order of its number."""
    hidden = is_hidden[row]
    n_vehicles = int(vehicle.max(initial=-1)) + 1
    n = np.bincount(vehicle[row[hidden]], minlength=n_vehicles)
    total = np.bincount(vehicle[row[hidden]], errors.squared[hidden], minlength=n_vehicles)
    mean = np.divide(total, n, out=np.full(n_vehicles, np.nan), where=n > 0)
    return tuple(np.sqrt(mean[np.unique(vehicle[is_hidden])]).tolist())
