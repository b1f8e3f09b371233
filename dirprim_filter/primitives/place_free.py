"""The place-free primitive: how vehicles move wherever nothing is known of the place."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives._modes import Modes
from dirprim_filter.primitives.fitting import MIN_SPREAD, MIN_STANDING_MEAN, bounds_of, fit_all
from dirprim_filter.primitives.mode_table import ModeTable
from dirprim_filter.primitives.rows import CellRows, TrackRows

STRENGTH = 0.1
"""Pseudo-vehicles in each place-free mode, which has all vehicles of the log to speak for it."""


class PlaceFree(NamedTuple):
    """Modes of all tracks together; of the last two one has a uniform direction and one is for standing."""

    weight: FloatArray
    mean: FloatArray
    concentration: FloatArray
    shape: FloatArray
    rate: FloatArray
    speed_spread: float  # log(mean) - mean(log) of all moving speeds

    def log_density(self, rows: TrackRows, speed: FloatArray) -> FloatArray:
        """(n,) of the rows' directions and of speeds (n,)."""
        modes = Modes(*(column[None] for column in self[:5]), *np.zeros((4, 1, self.weight.size)))
        nowhere = np.zeros(len(rows), np.int64)
        return ModeTable.of(modes, np.zeros((1, 2))).log_density(nowhere, rows.position, rows.direction, speed)


def fit_place_free(rows: TrackRows, config: LearningConfig) -> PlaceFree:
    """Fit the place-free primitive to all rows.

    It always holds a uniform direction and a standing mode, so that its density is positive and finite everywhere.
    """
    weight = rows.weight * (rows.weight.sum() / (rows.weight**2).sum())
    is_moving = rows.speed >= config.standing_speed
    moving, weighed = rows[is_moving], weight[is_moving]
    n_standing = float(weight[~is_moving].sum())
    found = Modes(*np.empty((len(Modes._fields), 0)))
    spread, mean_speed = 1.0, 1.0
    if len(moving):
        mean_speed = float(np.average(moving.speed, weights=weighed))
        log_mean = float(np.average(np.log(moving.speed), weights=weighed))
        spread = max(float(np.log(mean_speed)) - log_mean, MIN_SPREAD)
        k = config.max_place_free_modes
        bounds = bounds_of(config, prior_strength=STRENGTH, max_modes=k, speed_spread=spread)
        unplaced = CellRows.one(moving.direction, moving.speed, weight=weighed, n_vehicles=moving.n_vehicles)
        found = Modes(*(column[0] for column in fit_all(unplaced, bounds, at_once=True)))
    standing = (n_standing + 1) / (float(weight.sum()) + 2)
    anywhere = 1.0 / (moving.n_vehicles + 1)  # the next vehicle may do what none has done
    used = np.flatnonzero(found.weight)
    share = np.concatenate([(1 - anywhere) * found.weight[used], [anywhere if used.size else 1.0]])
    return PlaceFree(
        weight=np.append((1 - standing) * share, standing),
        mean=np.concatenate([found.mean[used], [0.0, 0.0]]),
        concentration=np.concatenate([found.concentration[used], [0.0, 0.0]]),
        shape=np.concatenate([found.shape[used], [1.0, 1.0]]),
        rate=np.concatenate([found.rate[used], [1.0 / mean_speed, 1.0 / _standing_mean(rows, config)]]),
        speed_spread=spread,
    )


def _standing_mean(rows: TrackRows, config: LearningConfig) -> float:
    standing = rows.speed[rows.speed < config.standing_speed]
    return max(float(standing.mean()) if standing.size else 0.0, MIN_STANDING_MEAN)
