"""How like another a vehicle must move for its journey to tell, learned from the vehicles themselves.

Each vehicle's way ahead is forecast from the journeys of all others. What its forecasts are worth is their energy score
(Gneiting and Raftery 2007, Eq. 22), which is proper: too wide a net, too narrow a one, or too much trust in few
journeys all cost.
"""

from __future__ import annotations

import logging
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from dirprim_filter.primitives import _following, _likening
from dirprim_filter.primitives.journeys import Journeys
from tessellation.arrays import FloatArray, IntArray

logger = logging.getLogger(__name__)

CANDIDATES: dict[str, tuple[float, ...]] = {
    "nearness": (0.35, 0.5, 0.7, 1.0, 1.4),
    "strength": (0.03, 0.1, 0.3, 1.0),
    "speed_rate": (0.1, 0.2, 0.4),
    "direction_rate": (0.5, 1.0, 2.0),
}
"""Of each knob; the others are held while one is chosen."""
LAGS_S = np.array([0.5, 1.0, 2.0, 3.0, 5.0])
MOST_STARTS = 300
FEWEST_STARTS = 20
STARTS_AT_ONCE = 32
"""On one thread."""
N_SAMPLES = 32
STEP_S = 0.25
SPREADS = {
    "direction_spread": 0.05,
    "speed_spread": 0.05,
    "drift": 0.005,
    "forget_rate": 0.1,
    "agility": 0.2,
}
"""As forecasts have them."""


def learn_likeness(journeys: Journeys, *, rng: np.random.Generator) -> Journeys:
    """The journeys with the knobs that forecast each of their vehicles best from the others.

    Args:
        journeys: of at least two vehicles, or nothing is learned.
        rng: chooses the instants to forecast from, and the samples.
    """
    start, later = _cases(journeys, rng)
    if len(start) < FEWEST_STARTS:
        return journeys
    key = rng.integers(2**63, size=len(start), dtype=np.uint64)
    vehicle = journeys.table(**SPREADS).row[start, _likening.VEHICLE]
    state = np.column_stack([journeys.position, journeys.direction, journeys.speed])[start]

    def score(trial: Journeys) -> float:
        table, path = trial.table(**SPREADS), np.empty((len(start), N_SAMPLES, LAGS_S.size, 2))

        def follow(part: slice) -> None:
            _following.hallucinate(table, state[part], vehicle[part], LAGS_S, STEP_S, key[part], path[part])

        with ThreadPoolExecutor() as threads:
            list(threads.map(follow, [slice(i, i + STARTS_AT_ONCE) for i in range(0, len(start), STARTS_AT_ONCE)]))
        return float(np.log(np.nanmean(_energy(path, later), axis=0)).mean())

    best, least = journeys, score(journeys)
    for name, values in CANDIDATES.items():
        for value in values:
            if value != getattr(best, name):
                trial = replace(best, **{name: value})  # type: ignore[arg-type]  # the candidates are all of numbers
                reached = score(trial)
                if reached < least:
                    best, least = trial, reached
    logger.info(
        "%d rows of journeys; alike within %.3g units, as strong as %.3g from anywhere, rates %.3g and %.3g /s",
        len(journeys), best.nearness, best.strength, best.direction_rate, best.speed_rate,
    )  # fmt: skip
    return best


def _cases(journeys: Journeys, rng: np.random.Generator) -> tuple[IntArray, FloatArray]:
    """Rows to forecast from, and where their vehicles were later: (n,), (n, n_lags, 2), NaN where that is not known."""
    ends = np.flatnonzero(journeys.duration == 0)
    begins = np.concatenate([[0], ends[:-1] + 1])
    elapsed = np.concatenate([[0.0], np.cumsum(journeys.duration)[:-1]])
    of = np.repeat(np.arange(ends.size), ends - begins + 1)
    left = elapsed[ends][of] - elapsed
    possible = np.flatnonzero(left >= LAGS_S[1])
    if ends.size < 2 or possible.size == 0:
        return possible[:0], np.empty((0, LAGS_S.size, 2))
    start = np.sort(rng.choice(possible, min(MOST_STARTS, possible.size), replace=False))
    unique = elapsed + of * 1e-6  # the first row of a journey is not at the time of the last before it
    wanted = unique[start][:, None] + LAGS_S
    later = np.stack([np.interp(wanted, unique, journeys.position[:, axis]) for axis in (0, 1)], axis=-1)
    later[left[start][:, None] + 1e-9 < LAGS_S] = np.nan
    enough = np.isfinite(later[..., 0]).sum(axis=0) >= FEWEST_STARTS
    if not enough.all():
        later[:, ~enough] = later[:, :1]  # scored by what is known
    return start, later


def _energy(path: FloatArray, later: FloatArray) -> FloatArray:
    """Energy score of samples, (n, n_samples, n_lags, 2), (n, n_lags, 2) -> (n, n_lags) metres."""
    n = path.shape[1]
    off = np.linalg.norm(path - later[:, None], axis=-1).mean(axis=1)
    apart = sum(np.linalg.norm(path - np.roll(path, i, axis=1), axis=-1).mean(axis=1) for i in range(1, n))
    return np.asarray(off - 0.5 * apart / (n - 1))
