"""What motion is learned from: sums over visits, in which every visit counts once."""

from __future__ import annotations

from functools import reduce
from operator import add
from typing import Any, NamedTuple, Self

import numpy as np
from scipy.sparse import csr_array

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions.angles import difference
from dirprim_filter.primitives.motion import CREEP
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.visits import Visits

AHEAD_S = 4.0
"""By when a vehicle that signals has turned: drivers signal some three seconds before, and a turn takes two."""
NEXT_S = 0.2
"""Seconds, from an instant on, over which it is measured how far a vehicle goes and what its speed gains: motion takes
such steps. A difference around the instant knows what came before, and forecasts by it are 1 to 2 % worse; shorter ones
are noise, longer ones smear where braking begins."""
PUSHED_OVER_S = 1.0
"""Seconds, over which a vehicle's own acceleration shows in its speed."""
STRETCHED_FROM_M = 0.15
MOST_STRETCH = 0.5
AT_ONCE = 200_000
"""Instants that are summed."""
SLOWEST_COURSE = 0.02
"""Weight of the course of a vehicle that stands; of one that drives 1 m/s or more it is 1."""


class Regression(NamedTuple):
    """Sums of a linear regression for each manoeuvre."""

    xx: FloatArray  # (z, p, p)
    xy: FloatArray  # (z, p)
    yy: FloatArray  # (z,)
    weight: FloatArray  # (z,)

    @classmethod
    def of(cls, x: FloatArray, y: FloatArray, weight: FloatArray, label: IntArray, n: int) -> Self:
        """(i, p), (i,), (i,), (i,) labels; rows whose `y` is NaN, or whose label is negative, count nothing."""
        known = np.isfinite(y) & (label >= 0)
        x, y, weight, label = x[known], y[known], weight[known], label[known]
        p = x.shape[1]
        xx = np.empty((n, p, p))
        for i in range(p):
            for j in range(i, p):
                xx[:, i, j] = xx[:, j, i] = _totals(label, weight * x[:, i] * x[:, j], n)
        xy = np.stack([_totals(label, weight * x[:, i] * y, n) for i in range(p)], axis=-1)
        return cls(xx, xy, _totals(label, weight * y * y, n), _totals(label, weight, n))

    def __add__(self, other: Regression) -> Regression:  # type: ignore[override]
        return Regression(*(a + b for a, b in zip(self, other, strict=True)))

    def __sub__(self, other: Regression) -> Regression:
        return Regression(*(a - b for a, b in zip(self, other, strict=True)))

    def solved(self, prior: FloatArray) -> FloatArray:
        """(z, p) coefficients with a ridge of `prior` visits, (p,) or (z, p)."""
        ridge = np.broadcast_to(prior, self.xy.shape)
        leaning = self.xx + ridge[..., None] * np.eye(ridge.shape[1])
        return np.asarray(np.linalg.solve(leaning, self.xy[..., None])[..., 0])

    def mean_square(self, beta: FloatArray) -> FloatArray:
        """(z,) of the residuals."""
        explained = 2.0 * (self.xy * beta).sum(axis=-1) - np.einsum("zi,zij,zj->z", beta, self.xx, beta)
        return np.asarray(np.maximum(self.yy - explained, 0.0) / np.maximum(self.weight, 1e-9))


class Labels(NamedTuple):
    """Which manoeuvre each visit is of, and of which cell and mode manoeuvres are."""

    label: IntArray  # (v,) -1 for none
    cell: IntArray  # (z,)
    mode: IntArray  # (z,)


class MotionSums(NamedTuple):
    """Of each manoeuvre, and of each transition between two."""

    visits: FloatArray  # (z,)
    seconds: FloatArray  # (z,)
    left: FloatArray  # (z,) visits whose end was seen
    turn: Regression  # by 1: radians in `AHEAD_S`
    course: Regression  # by 1, east, north: off the mode's own field
    log_pace: Regression  # by 1, east, north: off the mode's own field
    path: Regression  # by 1, u, u^2
    acceleration: Regression  # by 1, east, north, speed off the mode's mean
    pushed: Regression  # the same, of what is gained in `PUSHED_OVER_S`
    stretch: Regression  # by 1
    transition: csr_array  # (z, z) how often one followed the other

    @classmethod
    def of(cls, visits: Visits, labels: Labels, primitives: PrimitiveMap) -> Self:
        """The sums of some vehicles' visits, in what motion deviates from the modes of the primitives."""
        label, n, of_instant, known = labels.label, labels.cell.size, visits.of_instant, labels.label >= 0
        rows = np.flatnonzero(known[of_instant])
        changes = _changes(visits)
        parts = [
            _of_instants(visits, labels, primitives, at=at, of=of_instant[at], changes=changes[:, at])
            for at in (rows[a : a + AT_ONCE] for a in range(0, max(rows.size, 1), AT_ONCE))
        ]
        sums = [reduce(add, of) for of in zip(*parts, strict=True)]
        follows = visits.follows() & known & np.append(known[1:], np.zeros(min(len(visits), 1), np.bool_))
        pair = label[:-1][follows[:-1]], label[1:][follows[:-1]]

        def total(column: FloatArray) -> FloatArray:
            return _totals(label[known], (visits.weight * column)[known], n)

        transition = csr_array((visits.weight[:-1][follows[:-1]], pair), shape=(n, n))
        once, left = np.ones(len(visits)), visits.follows().astype(np.float64)
        columns: list[Any] = [total(once), total(visits.seconds), total(left), *sums, transition]
        return cls(*columns)


def _changes(visits: Visits) -> FloatArray:
    """(4, n) what changes from each instant on; NaN where that is not seen.

    How far vehicles turn in `AHEAD_S`, what the speed gains next, and over `PUSHED_OVER_S`, m/s^2, and the stretch.
    """
    return np.stack([
        _change(visits, visits.course, AHEAD_S, is_angle=True),
        _change(visits, visits.speed, NEXT_S) / visits.lag_s(NEXT_S),
        _change(visits, visits.speed, PUSHED_OVER_S) / visits.lag_s(PUSHED_OVER_S), _stretch(visits),
    ])  # fmt: skip


def _of_instants(
    visits: Visits, labels: Labels, primitives: PrimitiveMap, *, at: IntArray, of: IntArray, changes: FloatArray
) -> tuple[Any, ...]:  # fmt: skip
    """Sums of the instants `at` (i,) of visits `of`, `MotionSums` from `turn` to `stretch`; see `_changes`."""
    share, z = (visits.weight / (visits.end - visits.begin))[of], labels.label[of]
    n, speed, there = labels.cell.size, visits.speed[at], (labels.cell[z], labels.mode[z])
    driven = share * np.clip(speed, SLOWEST_COURSE, 1.0)
    mean_direction = primitives.modes.mean_direction[there]
    mean_speed = primitives.speed.mean[there]
    offset = visits.position[at] - primitives.centers[there[0]]
    one = np.ones(z.size)
    place, off_course = np.column_stack([one, offset]), deviation(visits, primitives, at=at, there=there)
    gained = np.column_stack([np.log(mean_speed + CREEP), pace_field(primitives, *there)])
    off_pace = np.log(speed + CREEP) - (place * gained).sum(axis=1)
    cosine, sine = np.cos(mean_direction), np.sin(mean_direction)
    along = cosine * offset[:, 0] + sine * offset[:, 1]
    across = cosine * offset[:, 1] - sine * offset[:, 0]
    state = np.column_stack([place, speed - mean_speed])
    turn, acceleration, pushed, stretch = changes
    return (
        Regression.of(one[:, None], turn, driven, z, n),
        Regression.of(place, off_course, driven, z, n), Regression.of(place, off_pace, share, z, n),
        Regression.of(np.column_stack([one, along, along**2]), across, driven, z, n),
        Regression.of(state, acceleration, share, z, n), Regression.of(state, pushed, share, z, n),
        Regression.of(one[:, None], stretch, share, z, n),
    )  # fmt: skip


def deviation(
    visits: Visits, primitives: PrimitiveMap, *, at: IntArray, there: tuple[IntArray, IntArray]
) -> FloatArray:  # fmt: skip
    """(i,) radians by which the course at instants `at` is off that of the cells and modes `there`."""
    bent = primitives.modes.bend[there] * (visits.position[at] - primitives.centers[there[0]])
    return difference(visits.course[at], primitives.modes.mean_direction[there] + bent.sum(axis=1))


def _totals(label: IntArray, column: FloatArray, n: int) -> FloatArray:
    """(n,) the sum of a column over the rows of each label."""
    return np.asarray(np.bincount(label, column, minlength=n), np.float64)


def pace_field(primitives: PrimitiveMap, cell: IntArray, mode: IntArray) -> FloatArray:
    """(z, 2) 1/m, the field of log(speed + 0.3) that a mode's gain of log speed is."""
    mean = primitives.speed.mean[cell, mode]
    return np.asarray(primitives.modes.gain[cell, mode] * (mean / (mean + CREEP))[:, None])


def _change(visits: Visits, column: FloatArray, seconds: float, *, is_angle: bool = False) -> FloatArray:
    """(n,) how much a column changes in so many seconds; NaN where that is not seen. Turns add up step by step."""
    later = visits.later(seconds)
    if is_angle:
        steps = difference(column[1:], column[:-1])
        column = np.concatenate([[0.0], np.cumsum(steps)])[: column.size]
    return np.where(later >= 0, column[np.maximum(later, 0)] - column, np.nan)


def _stretch(visits: Visits) -> FloatArray:
    """(n,) by how much longer the way from an instant on is than its speeds say."""
    step = visits.scale.step_s * 0.5 * (visits.speed[1:] + visits.speed[:-1])
    said = _change(visits, np.concatenate([[0.0], np.cumsum(step)])[: visits.speed.size], NEXT_S)
    way = np.hypot(*(visits.position[np.maximum(visits.later(NEXT_S), 0)] - visits.position).T)
    longer = np.where(said > STRETCHED_FROM_M, way / np.maximum(said, STRETCHED_FROM_M) - 1.0, np.nan)
    return np.asarray(np.clip(longer, -MOST_STRETCH, MOST_STRETCH))
