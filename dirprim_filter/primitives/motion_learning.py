"""Learning how vehicles go on: visits are grouped into manoeuvres, and motion follows from their sums.

How finely they are grouped, how much the place-free manoeuvres count, and how far vehicles stray is chosen by forecasts
of vehicles that were held out: by the energy score (Gneiting and Raftery 2007, Eq. 22), which is proper, and for the
spread by the Dawid-Sebastiani score, which asks that errors are as large as they are said to be.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.distributions.angles import difference
from dirprim_filter.primitives import _clustering, _motion
from dirprim_filter.primitives.motion import CREEP, Motion, joined, place_free_manoeuvres
from dirprim_filter.primitives.motion_sums import MotionSums, Regression, _of_pace
from dirprim_filter.primitives.motion_table import MotionKnobs, motion_table
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.primitives.visits import STEP_S, Visits, _filled_in
from tessellation.arrays import FloatArray, IntArray

logger = logging.getLogger(__name__)

DETAILS = (0.3, 1.0, 3.0)
"""Squared distances, in units of what is alike, from which on a visit is of another manoeuvre."""
STRENGTHS = (1.0, 5.0, 30.0, 200.0)
SPREADS = (1.0, 1.4, 2.0, 2.8)
MOST_MANOEUVRES = 32
"""Of a mode."""
MOST_ROWS = 300_000
"""Of vehicles drawn at random: of so many rows every manoeuvre has been seen often."""
LAGS_S = np.array([1.0, 2.0, 3.0, 5.0])
WORTH = 0.01
"""By so much of a share held-out forecasts must be better for other knobs than the first: less is luck."""
MOST_STARTS = 800
FEWEST_STARTS = 20
AT_ONCE = 50
"""On one thread."""
N_SAMPLES = 32
FEWEST_GROUPS = 4
PLACE_FREE_LEVELS = 3
STRAIGHT_SHARE = 0.15
"""Of the place-free manoeuvres those straight on have at least so much: in the log of a roundabout nobody does."""
LEAST_PUSH, LEAST_TURNING = 0.3, 0.03
"""m/s^2, and radians in the square root of a second, of a level that one vehicle showed."""
TURNS_FROM = 0.15
"""Radians in a second, and in the next: noise does not turn the same way twice."""
PUSHED_SHARE = 0.85
"""Of the variance of a vehicle's own acceleration, what its mean over a second has at `PUSH_RATE`."""

# Ridges in visits, of a field's value at the centre and of its slope (1 / m^2): what a manoeuvre leans on its mode by.
COURSE_RIDGE = np.array([0.3, 3.0, 3.0])
PACE_RIDGE = np.array([0.3, 3.0, 3.0])
PATH_RIDGE = np.array([1e-6, 0.1, 1.0])
ACCELERATION_RIDGE = np.array([0.3, 0.3, 0.3, 6.0])
STRETCH_RIDGE = np.array([0.5])
ANY_COURSE = 2.0
"""Radians, spread of the course of those that stand: of no meaning."""
SPREAD_VISITS = 3.0
"""With which a manoeuvre's spreads lean on those of all."""
LEAST_REVERSION, MOST_REVERSION = 0.02, 1.0
"""1/s, of the speed to the mean."""


class Labels(NamedTuple):
    """Which manoeuvre each visit is of, and of which cell and mode manoeuvres are."""

    label: IntArray  # (v,) -1 for none
    cell: IntArray  # (z,)
    mode: IntArray  # (z,)


def learn_motion(primitives: PrimitiveMap, rows: TrackRows, *, rng: np.random.Generator) -> Motion:
    """The motion of a map's vehicles, with the knobs that forecast held-out vehicles best.

    Args:
        primitives: the map; its own motion is not looked at.
        rows: observations sorted by vehicle and time.
        rng: draws the held-out vehicles and the order of grouping.
    """
    rows = rows.some(MOST_ROWS, rng=rng)
    visits = Visits.of(rows, primitives.tessellation)
    if len(visits) == 0:
        return primitives.motion
    groups = np.unique(rows.group)
    detail, strength, spread = DETAILS[0], STRENGTHS[0], SPREADS[1]
    if groups.size >= FEWEST_GROUPS:
        held_out = np.isin(rows.group, rng.permutation(groups)[: groups.size // 3])
        cases = _cases(rows[held_out], rng)
        if cases is not None:
            seen = Visits.of(rows[~held_out], primitives.tessellation)
            detail, strength, spread = _choose(primitives, seen, cases, rng)
    return fit_motion(primitives, visits, detail=detail, strength=strength, spread=spread, rng=rng)


def fit_motion(
    primitives: PrimitiveMap, visits: Visits, *, detail: float, strength: float, spread: float,
    rng: np.random.Generator,
) -> Motion:  # fmt: skip
    """The motion of visits, with knobs that are given."""
    labels = label_visits(primitives, visits, detail=detail, rng=rng)
    sums = MotionSums.of(visits, *labels, primitives)
    return motion_of(sums, labels.cell, labels.mode, primitives, _place_free(visits), strength=strength, spread=spread)


def label_visits(primitives: PrimitiveMap, visits: Visits, *, detail: float, rng: np.random.Generator) -> Labels:
    """Group the visits of each mode of each cell."""
    inside = np.flatnonzero(visits.cell >= 0)
    feature = visits.features(primitives.centers)
    mode = _modes_of(primitives, visits)
    n_modes = primitives.direction.weight.shape[1]
    key = visits.cell[inside] * n_modes + mode[inside]
    order = np.argsort(key, kind="stable")
    bounds = np.append(np.flatnonzero(np.diff(key[order], prepend=-1)), order.size)
    label = np.full(len(visits), -1, np.int64)
    of_group: list[int] = []
    for a, b in pairwise(bounds.tolist()):
        members = inside[order[a:b]]
        found = np.empty(members.size, np.int64)
        _clustering.dp_means(feature[members], rng.permutation(members.size), detail, MOST_MANOEUVRES, found)
        used, found = np.unique(found, return_inverse=True)
        label[members] = len(of_group) + found
        of_group += [int(key[order[a]])] * used.size
    cell, mode_of = np.divmod(np.array(of_group, dtype=np.int64), n_modes)
    return Labels(label, cell, mode_of)


def _modes_of(primitives: PrimitiveMap, visits: Visits) -> IntArray:
    """(v,) the mode of each visit: the likeliest of all its instants together; of who stands the last of its cell's."""
    n_own = primitives.direction.weight.shape[1] - primitives.n_place_free_modes
    direction, speed = primitives.primitive_at(visits.position)
    log_p = direction.mode_log_density(visits.course) + speed.log_density(np.maximum(visits.speed, 1e-2)[:, None])
    of_instant = visits.of_instant
    moving = max(n_own - 1, 1)  # the last is for standing
    total = [np.bincount(of_instant, np.maximum(log_p[:, m], -30.0), minlength=len(visits)) for m in range(moving)]
    return np.asarray(np.where(visits.stands, n_own - 1, np.argmax(total, axis=0)), np.int64)


def motion_of(
    sums: MotionSums, cell: IntArray, mode: IntArray, primitives: PrimitiveMap, free: dict[str, FloatArray], *,
    strength: float, spread: float,
) -> Motion:  # fmt: skip
    """Motion from sums over visits.

    Args:
        sums: of z manoeuvres.
        cell: (z,) ascending.
        mode: (z,)
        primitives: what the sums deviate from.
        free: the columns of the place-free manoeuvres.
        strength: how much these count against those of a cell, in visits.
        spread: by how much vehicles stray further than those that a manoeuvre was fitted to.
    """
    n = sums.visits
    course, pace = sums.course.solved(COURSE_RIDGE), sums.log_pace.solved(PACE_RIDGE)
    path, stretch = sums.path.solved(PATH_RIDGE), sums.stretch.solved(STRETCH_RIDGE)[:, 0]
    toward = np.zeros((n.size, 4))
    toward[:, 3] = -_reversion(sums.acceleration)
    acceleration = sums.acceleration.solved(ACCELERATION_RIDGE, toward)
    pushed = sums.pushed.mean_square(sums.pushed.solved(ACCELERATION_RIDGE, toward)) / PUSHED_SHARE
    acceleration[:, 3] = np.clip(acceleration[:, 3], -2.0 * MOST_REVERSION, 0.0)
    mean_speed = primitives.speed.mean[cell, mode]
    acceleration[:, 0] -= acceleration[:, 3] * mean_speed
    direction = primitives.direction.mean_direction[cell, mode]
    stands = mode == primitives.direction.weight.shape[1] - primitives.n_place_free_modes - 1
    placed = {
        "cell": cell, "mode": mode, "visits": n, "seconds": sums.seconds,
        "course": direction + course[:, 0], "bend": primitives.bend[cell, mode] + course[:, 1:],
        "course_spread": np.where(stands, ANY_COURSE, spread * _spread(sums.course.mean_square(course), n)),
        "log_pace": np.log(mean_speed + CREEP) + pace[:, 0], "gain": _of_pace(primitives, cell, mode) + pace[:, 1:],
        "log_pace_spread": _spread(sums.log_pace.mean_square(pace), n),
        "path": path, "path_spread": _spread(sums.path.mean_square(path), n), "path_direction": direction,
        "acceleration": acceleration, "push": spread * _spread(pushed, n), "stretch": stretch,
        "start_rate": np.where(stands, (sums.left + 0.1) / (sums.seconds + 1.0), 0.0),
        "turn_ahead": sums.turned / np.maximum(sums.turns, 1e-9), "curvature": np.zeros(n.size),
    }  # fmt: skip
    transition = csr_array(sums.transition)
    transition.sum_duplicates()
    first = np.concatenate([transition.indptr, np.full(len(free["cell"]), transition.indptr[-1])])
    return Motion(
        **joined(placed, free), first=first.astype(np.int64), following=transition.indices.astype(np.int64),
        count=transition.data.astype(np.float64), strength=strength,
    )  # fmt: skip


def _spread(mean_square: FloatArray, n: FloatArray) -> FloatArray:
    """(z,) standard deviations that lean on the usual one, by `SPREAD_VISITS`; who was seen once says little."""
    often = n >= 5 if (n >= 5).any() else n > 0
    usual = float(np.median(mean_square[often])) if often.any() else 1.0
    freedom = np.maximum(n - 1.5, 0.0)
    variance = (n * mean_square + SPREAD_VISITS * usual) / (freedom + SPREAD_VISITS)
    return np.asarray(np.sqrt(np.maximum(variance, 1e-8)))


def _reversion(acceleration: Regression) -> float:
    """1/s, how fast the speeds of all manoeuvres come back to their mean, the place accounted for."""
    rest = acceleration.xx[:, :3, :3] + np.diag(ACCELERATION_RIDGE[:3])
    by = np.linalg.solve(rest, acceleration.xx[:, :3, 3:])[..., 0]
    own = acceleration.xx[:, 3, 3] - (acceleration.xx[:, :3, 3] * by).sum(axis=-1)
    gained = acceleration.xy[:, 3] - (acceleration.xy[:, :3] * by).sum(axis=-1)
    return float(np.clip(-gained.sum() / max(own.sum(), 1e-9), LEAST_REVERSION, MOST_REVERSION))


def _place_free(visits: Visits) -> dict[str, FloatArray]:
    """Manoeuvres of no place: vehicles that turn left or right, the others by how lively they are, and who stands."""
    second, third, stands = visits.later(1.0), visits.later(2.0), visits.stands[visits.of_instant]
    moves = np.flatnonzero((third >= 0) & ~stands)
    gained = (visits.speed[second[moves]] - visits.speed[moves]) / np.sqrt(PUSHED_SHARE)
    turned = difference(visits.course[second[moves]], visits.course[moves])
    later = difference(visits.course[third[moves]], visits.course[second[moves]])
    way = 0.5 * (visits.speed[second[moves]] + visits.speed[moves])
    side = np.where(np.minimum(turned, later) > TURNS_FROM, 1, np.where(np.maximum(turned, later) < -TURNS_FROM, -1, 0))
    usual = np.sqrt([np.mean(gained**2) + 1e-6, np.mean(turned**2) + 1e-6]) if moves.size else np.ones(2)
    lively = np.where(side == 0, np.abs(gained) / usual[0] + np.abs(turned) / usual[1], np.inf)
    straight = int((side == 0).sum())
    level = np.minimum(np.argsort(np.argsort(lively)) * PLACE_FREE_LEVELS // max(straight, 1), PLACE_FREE_LEVELS - 1)
    level = np.where(side == 0, level, PLACE_FREE_LEVELS + (side > 0)).astype(np.int64)
    n = np.bincount(level, minlength=PLACE_FREE_LEVELS + 2)

    def total(column: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(level, column, minlength=n.size), np.float64)

    curvature = np.where(np.arange(n.size) < PLACE_FREE_LEVELS, 0.0, total(turned) / np.maximum(total(way), 1.0))
    straight_on = np.where(np.arange(n.size) < PLACE_FREE_LEVELS, 1.0 / PLACE_FREE_LEVELS, 0.0)
    share = (1.0 - STRAIGHT_SHARE) * n / max(n.sum(), 1) + STRAIGHT_SHARE * straight_on
    strayed = turned - curvature[level] * way
    standing = visits.seconds[visits.stands].sum()
    left, seconds = float(visits.follows()[visits.stands].sum()), visits.seconds.sum()
    return place_free_manoeuvres(
        share=share * (1.0 - standing / seconds),
        push=np.sqrt((total(gained**2) + LEAST_PUSH**2) / (n + 1.0)),
        turning=np.sqrt((total(strayed**2) + LEAST_TURNING**2) / (n + 1.0)),
        curvature=curvature, standing=float(standing / seconds), start_rate=(left + 0.1) / (standing + 1.0),
    )  # fmt: skip


# What held-out vehicles like best ------------------------------------------------------------------------------------


class Cases(NamedTuple):
    """States to forecast from, and where the vehicles were later."""

    start: FloatArray  # (n, 4) place, direction, speed
    later: FloatArray  # (n, n_lags, 2) metres, NaN where not seen
    key: UIntArray  # (n,) of the random numbers


def _cases(rows: TrackRows, rng: np.random.Generator) -> Cases | None:
    """Instants of held-out vehicles; None where too few are seen for a second."""
    _, segment, position, course, speed = _filled_in(rows)
    lag = np.round(LAGS_S / STEP_S).astype(np.int64)
    n = segment.size
    there = np.minimum(np.arange(n)[:, None] + lag, max(n - 1, 0))
    known = (np.arange(n)[:, None] + lag < n) & (segment[there] == segment[:, None]) if n else np.empty((0, lag.size))
    possible = np.flatnonzero(known[:, 0]) if n else np.empty(0, np.int64)
    if possible.size < FEWEST_STARTS:
        return None
    at = np.sort(rng.choice(possible, min(MOST_STARTS, possible.size), replace=False))
    later = np.where(known[at][..., None], position[there[at]], np.nan)
    key = rng.integers(2**63, size=at.size, dtype=np.uint64)
    return Cases(np.column_stack([position[at], course[at], speed[at]]), later, key)


def _choose(
    primitives: PrimitiveMap, seen: Visits, cases: Cases, rng: np.random.Generator
) -> tuple[float, float, float]:
    """Detail, strength and spread, one after the other."""
    seed = int(rng.integers(2**63))
    free = _place_free(seen)
    grouped: dict[float, tuple[Labels, MotionSums]] = {}

    def forecast(detail: float, strength: float, spread: float) -> FloatArray:
        if detail not in grouped:
            labels = label_visits(primitives, seen, detail=detail, rng=np.random.default_rng(seed))
            grouped[detail] = labels, MotionSums.of(seen, *labels, primitives)
        labels, sums = grouped[detail]
        motion = motion_of(sums, labels.cell, labels.mode, primitives, free, strength=strength, spread=spread)
        path = np.empty((len(cases.start), N_SAMPLES, LAGS_S.size, 2))
        table = motion_table(replace(primitives, motion=motion), MotionKnobs())
        dt_s = np.diff(LAGS_S, prepend=0.0)

        def roll(part: slice) -> None:
            _motion.rollout(table, cases.start[part], dt_s, cases.key[part], path[part])

        with ThreadPoolExecutor() as threads:
            list(threads.map(roll, [slice(i, i + AT_ONCE) for i in range(0, len(path), AT_ONCE)]))
        return path

    detail, strength, spread = DETAILS[0], STRENGTHS[0], SPREADS[1]
    detail = _best(DETAILS, lambda d: _energy(forecast(d, strength, spread), cases.later))
    strength = _best(STRENGTHS, lambda s: _energy(forecast(detail, s, spread), cases.later))
    spread = min(SPREADS, key=lambda s: _surprise(forecast(detail, strength, s), cases.later))
    logger.info("motion: %d manoeuvres at detail %g, strength %g, spread %g",
                grouped[detail][0].cell.size, detail, strength, spread)  # fmt: skip
    return detail, strength, spread


def _best(values: tuple[float, ...], score: Callable[[float], float]) -> float:
    """The value of the least score, or the first if it is hardly worse."""
    scores = {value: score(value) - (WORTH if value == values[0] else 0.0) for value in values}
    return min(scores, key=lambda value: scores[value])


def _energy(path: FloatArray, later: FloatArray) -> float:
    """Energy score of samples, as the mean over lags of its logarithm. (n, p, lags, 2), (n, lags, 2)."""
    off = np.linalg.norm(path - later[:, None], axis=-1).mean(axis=1)
    n = path.shape[1]
    apart = sum(np.linalg.norm(path - np.roll(path, i, axis=1), axis=-1).mean(axis=1) for i in range(1, n))
    score = off - 0.5 * apart / (n - 1)
    known = np.isfinite(score).sum(axis=0) >= FEWEST_STARTS // 2
    return float(np.log(np.nanmean(score[:, known], axis=0)).mean())


def _surprise(path: FloatArray, later: FloatArray) -> float:
    """Dawid-Sebastiani score over the lags up to two seconds: log det of the covariance, and squared error by it."""
    path, later = path[:, :, :2], later[:, :2]
    off = later - path.mean(axis=1)
    away = path - path.mean(axis=1, keepdims=True)
    covariance = np.einsum("npti,nptj->ntij", away, away) / (path.shape[1] - 1) + 1e-4 * np.eye(2)
    squared = np.einsum("nti,nti->nt", off, np.linalg.solve(covariance, off[..., None])[..., 0])
    return float(np.nanmean(np.log(np.linalg.det(covariance)) + np.minimum(squared, 30.0)))
