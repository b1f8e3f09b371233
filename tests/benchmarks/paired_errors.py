"""Errors of estimates at rows of a truth, by drive or scenario, so that methods are compared at the same rows."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.evaluation.calibration.pairing import Scene
from dirprim_filter.evaluation.intervals import Interval, interval, mean
from dirprim_filter.evaluation.settings import Axis, choose
from dirprim_filter.evaluation.tracking_report import coverage, normalised_squared
from dirprim_filter.tracks import Tracks

LOG_OUTLIER = float(np.log(1e-3 / 100.0**2))
"""Of a true position that an estimate does not explain, or that has none: as likely as the filters' outliers."""
GAIN = 0.5
"""Nat: a parameter that goes to nothing is followed no farther than it matters."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RowErrors:
    """Of estimates that are near a true position; (n,) rows.

    Attributes:
        key: which vehicle at which time.
        off: (n, 2) metres, east and north.
        course: (n, 2) unit vector along the true vehicle's way.
        covariance: (n, 2, 2) square metres.
        column: which estimate it is.
        n_true: true positions at the estimates' own instants.
    """

    key: IntArray
    off: FloatArray
    course: FloatArray
    covariance: FloatArray
    column: IntArray
    n_true: int

    @classmethod
    def of(cls, estimates: Estimates | Detections, truth: Tracks, *, gate_m: float, lag_s: float = 0.0) -> RowErrors:
        """Estimates of one group beside the truth, interpolated to `lag_s` before their times; nearest together."""
        as_seen = Detections(
            track_id=np.full(len(estimates), NO_ID), time_ns=estimates.time_ns, position=estimates.position,
            group=np.full(len(estimates), truth.group[0]),
        )  # fmt: skip
        scene = Scene(as_seen, truth)
        rows = scene.truth_at(lag_s)
        row, column = scene.matched(rows, gate_m=gate_m)
        time_ns = estimates.time_ns[column]
        vehicle = rows.vehicle[row]
        n_true = int(np.isin(rows.frame, np.unique(scene.frame_of)).sum())
        return cls(
            key=_keys(time_ns, vehicle), off=estimates.position[column] - rows.position[row],
            course=rows.course[row], covariance=estimates.covariance[column], column=column, n_true=n_true,
        )  # fmt: skip

    def __getitem__(self, rows: BoolArray | IntArray) -> RowErrors:
        return RowErrors(
            key=self.key[rows], off=self.off[rows], course=self.course[rows], covariance=self.covariance[rows],
            column=self.column[rows], n_true=self.n_true,
        )  # fmt: skip

    def less(self, along_m: float, across_m: float) -> RowErrors:
        """Without a bias in the true vehicles' axes, forwards and to the left."""
        left = np.column_stack([-self.course[:, 1], self.course[:, 0]])
        return replace(self, off=self.off - along_m * self.course - across_m * left)

    def at(self, key: IntArray) -> RowErrors:
        """The rows of these keys, in the order of keys."""
        order = np.argsort(self.key)
        kept = order[np.isin(self.key[order], key)]
        return self[kept]

    @property
    def squared(self) -> FloatArray:
        """(n,) square metres."""
        return np.asarray((self.off**2).sum(axis=1))

    @property
    def normalised(self) -> FloatArray:
        """(n,) squared, in units of the covariance."""
        return normalised_squared(self.off, self.covariance)

    def log_density(self) -> float:
        """Natural log of the density of all true positions under their estimates, per square metre."""
        log_p = -0.5 * (self.normalised + np.log(np.linalg.det(2.0 * np.pi * self.covariance)))
        return float(np.logaddexp(log_p, LOG_OUTLIER).sum() + LOG_OUTLIER * (self.n_true - log_p.size))


def true_rows(truth: Tracks, time_ns: IntArray) -> tuple[Tracks, IntArray]:
    """A group's truth, interpolated, at instants, and the keys of its rows."""
    instants = np.unique(time_ns)
    nowhere = Detections(
        track_id=np.full(instants.size, NO_ID), time_ns=instants, position=np.zeros((instants.size, 2)),
        group=np.full(instants.size, truth.group[0]),
    )  # fmt: skip
    scene = Scene(nowhere, truth)
    rows = scene.truth_at(0.0)
    is_asked = np.isin(rows.frame, scene.frame_of)  # the scene fills pauses with instants of its own
    rows = type(rows)(*(column[is_asked] for column in rows))
    times = instants[np.searchsorted(scene.frame_of, rows.frame)]
    at = Tracks(
        track_id=scene.names[rows.vehicle], time_ns=times, position=rows.position, speed=rows.speed,
        direction=np.arctan2(rows.course[:, 1], rows.course[:, 0]), group=np.full(times.size, truth.group[0]),
    )  # fmt: skip
    return at, _keys(times, rows.vehicle)


def _keys(time_ns: IntArray, vehicle: IntArray) -> IntArray:
    return np.asarray(time_ns // 1000 * 64 + vehicle)


Runs = Mapping[Any, Sequence[RowErrors]]
"""Of each cluster, a drive or a scenario: the errors in each of its runs, by seed."""


class Figures(NamedTuple):
    """Of rows that are wanted; means over clusters, of each the mean over runs.

    Attributes:
        rmse: metres, or over the scale given for each cluster: the root of the mean of its squares.
        nees: mean normalised squared error; 2 where covariances are right.
        coverage_90: share of the true positions in the 90 % ellipse.
        reported: share of the true positions that have an estimate near.
    """

    rmse: float
    nees: float
    coverage_90: float
    reported: float

    @classmethod
    def of(cls, runs: Runs, scale: Mapping[Any, float], keys: Mapping[Any, IntArray]) -> Figures:
        """Of some keys of each cluster; of clusters that have none, none."""
        found = []
        for name, wanted in keys.items():
            kept = [run.at(wanted) for run in runs[name]]
            squared = [run.squared.mean() / scale[name] ** 2 for run in kept if run.key.size]
            nees = [run.normalised.mean() for run in kept if run.key.size]
            inside = [coverage(run.normalised[np.isfinite(run.normalised)], 0.9) for run in kept]
            reported = [run.key.size / wanted.size for run in kept]
            found.append([np.nanmean(column) if column else np.nan for column in (squared, nees, inside, reported)])
        squared, *others = np.nanmean(found, axis=0) if found else np.full(4, np.nan)
        return cls(float(np.sqrt(squared)), *map(float, others))


def less_error(first: Runs, other: Runs, keys: Mapping[Any, IntArray]) -> Interval:
    """By which share the first's RMSE is below the other's, at the rows that both have: of clusters' geometric mean."""
    sums = []
    for name in keys:
        ratios = [
            float(np.log(a.at(both).squared.mean() / b.at(both).squared.mean()))
            for a, b, both in _side_by_side(first[name], other[name], keys[name])
            if both.size
        ]
        if ratios:
            sums.append([float(np.mean(ratios)), 1.0])
    return interval(np.array(sums).reshape(-1, 2), lambda total: 1.0 - np.exp(0.5 * mean(total)))


def _side_by_side(
    first: Sequence[RowErrors], other: Sequence[RowErrors], keys: IntArray
) -> Iterable[tuple[RowErrors, RowErrors, IntArray]]:
    """Runs with the same seed, the one run of a method without chance beside each; and the rows that both have."""
    for i in range(max(len(first), len(other))):
        a, b = first[i % len(first)], other[i % len(other)]
        yield a, b, np.intersect1d(np.intersect1d(a.key, b.key), keys)


def likeliest(log_likelihood: Callable[[tuple[float, ...]], float], **start: float) -> tuple[float, ...]:
    """The parameters of greatest likelihood, from these on, on a grid that widens until none beside gains `GAIN`."""
    axes = [Axis(name, value) for name, value in start.items()]
    found = choose(axes, log_likelihood, least_gain=GAIN)
    return tuple(of.chosen for of in found)
