"""Which knobs of learning motion forecast best the vehicles that were held out.

By the energy score (Gneiting and Raftery 2007, Eq. 22), which is proper.
"""

from __future__ import annotations

import logging
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.primitives import _motion
from dirprim_filter.primitives.motion import Motion
from dirprim_filter.primitives.motion_learning import (
    LearningKnobs,
    fit_motion,
    label_visits,
    motion_of,
)
from dirprim_filter.primitives.motion_sums import MotionSums
from dirprim_filter.primitives.motion_table import MotionKnobs, motion_table
from dirprim_filter.primitives.place_free_motion import learn_place_free
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.primitives.visits import STEP_S, Visits, filled_in

logger = logging.getLogger(__name__)

STRENGTHS = (30.0, 5.0, 200.0, 1000.0)
"""Chosen by the energy score; the first unless another is better by `WORTH`."""
MOST_ROWS = 300_000
"""Of vehicles drawn at random: of so many rows every manoeuvre has been seen often."""
LAGS_S = np.array([1.0, 2.0, 3.0, 5.0])
WORTH = 0.01
"""By so much of a share held-out forecasts must be better for other knobs than the first: less is luck."""
MOST_STARTS = 600
FEWEST_STARTS = 20
AT_ONCE = 50
"""On one thread."""
N_SAMPLES = 32
FEWEST_GROUPS = 4
N_FOLDS = 3


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
    return fit_motion(primitives, visits, choose_knobs(primitives, rows, rng=rng), rng=rng)


def choose_knobs(primitives: PrimitiveMap, rows: TrackRows, *, rng: np.random.Generator) -> LearningKnobs:
    """The knobs that forecast best, each fold of the vehicles from the others."""
    groups = rng.permutation(np.unique(rows.group))
    if groups.size < FEWEST_GROUPS:
        return LearningKnobs()
    folds = []
    for part in np.array_split(groups, N_FOLDS):
        held_out = np.isin(rows.group, part)
        cases = _cases(rows[held_out], rng)
        if cases is not None:
            folds.append(_Fold(primitives, Visits.of(rows[~held_out], primitives.tessellation), cases, rng))
    if not folds:
        return LearningKnobs()

    later = np.concatenate([fold.cases.later for fold in folds])
    trials = [LearningKnobs(strength=strength) for strength in STRENGTHS]
    scores = [_energy(np.concatenate([fold.forecast(trial) for fold in folds]), later) for trial in trials]
    best = int(np.argmin(scores))
    knobs = trials[best if scores[best] < scores[0] - WORTH else 0]
    logger.info("motion: %s", knobs)
    return knobs


class _Fold:
    """Some vehicles to learn from, and others to forecast."""

    def __init__(self, primitives: PrimitiveMap, seen: Visits, cases: Cases, rng: np.random.Generator) -> None:
        self._primitives, self.cases = primitives, cases
        self._labels = label_visits(primitives, seen, rng=rng)
        self._sums = MotionSums.of(seen, *self._labels, primitives)
        self._place_free = learn_place_free(seen, rng=rng)

    def forecast(self, knobs: LearningKnobs) -> FloatArray:
        """(n, N_SAMPLES, lags, 2) metres, where the cases' vehicles may be."""
        motion = motion_of(self._sums, self._labels, self._primitives, self._place_free, knobs)
        table = motion_table(replace(self._primitives, motion=motion), MotionKnobs())
        path = np.empty((len(self.cases.start), N_SAMPLES, LAGS_S.size, 2))
        dt_s = np.diff(LAGS_S, prepend=0.0)

        def roll(part: slice) -> None:
            _motion.rollout(table, self.cases.start[part], dt_s, self.cases.key[part], path[part])

        with ThreadPoolExecutor() as threads:
            list(threads.map(roll, [slice(i, i + AT_ONCE) for i in range(0, len(path), AT_ONCE)]))
        return path


class Cases(NamedTuple):
    """States to forecast from, and where the vehicles were later."""

    start: FloatArray  # (n, 4) place, direction, speed
    later: FloatArray  # (n, n_lags, 2) metres, NaN where not seen
    key: UIntArray  # (n,) of the random numbers


def _cases(rows: TrackRows, rng: np.random.Generator) -> Cases | None:
    """Instants of held-out vehicles; None where too few are seen for a second."""
    _, segment, position, course, speed = filled_in(rows)
    lag = np.round(LAGS_S / STEP_S).astype(np.int64)
    n = segment.size
    there = np.minimum(np.arange(n)[:, None] + lag, max(n - 1, 0))
    known = (np.arange(n)[:, None] + lag < n) & (segment[there] == segment[:, None]) if n else np.empty((0, lag.size))
    possible = np.flatnonzero(known[:, 0]) if n else np.empty(0, np.int64)
    if possible.size < FEWEST_STARTS:
        return None
    at = np.sort(rng.choice(possible, min(MOST_STARTS // N_FOLDS, possible.size), replace=False))
    later = np.where(known[at][..., None], position[there[at]], np.nan)
    key = rng.integers(2**63, size=at.size, dtype=np.uint64)
    return Cases(np.column_stack([position[at], course[at], speed[at]]), later, key)


def _energy(path: FloatArray, later: FloatArray) -> float:
    """Energy score of samples, as the mean over lags of its logarithm. (n, p, lags, 2), (n, lags, 2)."""
    east, north = np.moveaxis(path, (3, 1), (0, 1)).copy()
    off = np.hypot(east - later[..., 0], north - later[..., 1]).mean(axis=0)
    n = len(east)
    pairs = sum(np.sqrt((east[i:] - east[:-i]) ** 2 + (north[i:] - north[:-i]) ** 2).sum(axis=0) for i in range(1, n))
    score = off - pairs / (n * (n - 1))
    known = np.isfinite(score).sum(axis=0) >= FEWEST_STARTS // 2
    return float(np.log(np.nanmean(score[:, known], axis=0)).mean())
