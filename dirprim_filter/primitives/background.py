"""The background model: how vehicles move wherever nothing is known of the place.

Its density is of all vehicles together. Its motion groups their instants by speed and by what they do in the next
seconds: cruise, brake, turn left. From second to second a vehicle goes over from one to the next, as often as was seen:
a Markov chain.
"""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
from scipy.cluster.vq import kmeans2, vq
from scipy.sparse import csr_array

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.distributions.angles import difference
from dirprim_filter.primitives._map_kernels import ModeTable
from dirprim_filter.primitives._modes import Modes
from dirprim_filter.primitives.fitting import MIN_SPREAD, MIN_STANDING_MEAN, bounds_of, fit_all
from dirprim_filter.primitives.motion import CREEP, JUMP_S, PUSHED_SHARE, background_manoeuvres, unlearned_background
from dirprim_filter.primitives.rows import CellRows, TrackRows
from dirprim_filter.primitives.visits import Visits
from tessellation import GridTessellation
from tessellation.gates import residents

PRIOR_VEHICLES = 0.1
"""Pseudo-vehicles in each of its modes, which have all vehicles of the log to speak for them."""
MOST_ROWS = 300_000
"""Of vehicles drawn at random: of so many rows every manoeuvre has been seen often."""
MOST_GROUPS = 16
INSTANTS_EACH = 100
"""Instants of moving vehicles, at least so many for each group."""
MOST_INSTANTS = 20_000
LOG_PACE = 0.35
"""A difference of log(v + 1) that counts as much as a typical gain of speed or a typical turn."""
LEAST_WAYS, LEAST_FASTER = 1.0, 10.0
"""m^2, and m^2/s^2: sums of squares above which a curvature, or a reversion of speed, is estimated."""
FARTHEST = 3.0
"""Typical deviations at which gains and turns are clipped."""
LEAST_PUSH, LEAST_TURNING = 0.1, 0.01
"""m/s^2, and radians in the square root of a second."""


class Background(NamedTuple):
    """Modes of all tracks, of which the last two are uniform in direction and for standing; manoeuvres."""

    modes: Modes  # (1, m) each
    speed_spread: float  # log(mean) - mean(log) of all moving speeds
    manoeuvres: dict[str, FloatArray]  # (k,) columns of `Motion`
    following: csr_array  # (k, k) how often one followed the other `JUMP_S` later

    def log_density(self, rows: TrackRows, speed: FloatArray) -> FloatArray:
        """(n,) of the rows' directions and of speeds (n,)."""
        table, nowhere = ModeTable.of(self.modes, np.zeros((1, 2))), np.zeros(len(rows), np.int64)
        return table.log_density(nowhere, rows.position, rows.direction, speed)


def learn_background(rows: TrackRows, config: LearningConfig, *, rng: np.random.Generator) -> Background:
    """The background model of all rows, sorted by vehicle and time.

    It always has a uniform direction and a standing mode, so that its density is positive and finite everywhere.

    Args:
        rows: of all vehicles.
        config: of learning.
        rng: draws rows where there are many, the instants that are grouped, and where groups begin.
    """
    weight = rows.weight * (rows.weight.sum() / (rows.weight**2).sum())
    is_moving = rows.speed >= config.standing_speed
    moving, weighed = rows[is_moving], weight[is_moving]
    n_standing = float(weight[~is_moving].sum())
    found = Modes.flat(*np.empty((5, 1, 0)))
    spread, mean_speed = 1.0, 1.0
    if len(moving):
        mean_speed = float(np.average(moving.speed, weights=weighed))
        log_mean = float(np.average(np.log(moving.speed), weights=weighed))
        spread = max(float(np.log(mean_speed)) - log_mean, MIN_SPREAD)
        k = config.max_background_modes
        bounds = bounds_of(config, prior_strength=PRIOR_VEHICLES, max_modes=k, speed_spread=spread)
        nowhere = residents(np.zeros(len(moving), np.int64), np.zeros((1, 2)))
        unplaced = CellRows.of(moving, nowhere, moving.position, standing_speed=0.0)
        found = Modes.of(fit_all(unplaced, bounds))
        found = found.take((slice(None), found.weight[0] > 0))
    creeping = rows.speed[~is_moving]
    standing_mean = max(float(creeping.mean()) if creeping.size else 0.0, MIN_STANDING_MEAN)
    standing = (n_standing + 1) / (float(weight.sum()) + 2)
    anywhere = 1.0 / (moving.n_vehicles + 1)  # the next vehicle may do what none has done
    free = np.array([[1.0 - standing, standing]])
    free[0, 0] *= anywhere if found.weight.size else 1.0
    rate = np.array([[1.0 / mean_speed, 1.0 / standing_mean]])
    modes = found.times(1 - anywhere).times(1 - standing), Modes.flat(free, 0 * free, 0 * free, np.ones((1, 2)), rate)
    manoeuvres, following = learn_chain(Visits.of(rows.some(MOST_ROWS, rng=rng), GridTessellation.empty()), rng=rng)
    return Background(Modes.beside(modes), spread, manoeuvres, following)


def learn_chain(visits: Visits, *, rng: np.random.Generator) -> tuple[dict[str, FloatArray], csr_array]:
    """Manoeuvres of visits, and how often one followed the other; see `Background`."""
    stands = visits.stands[visits.of_instant]
    later, per_second = visits.later(JUMP_S), 1.0 / visits.lag_s(JUMP_S)
    still_later = np.where(later >= 0, later[later], -1)
    gained = np.where(later >= 0, per_second * (visits.speed[later] - visits.speed), np.nan)
    turned = np.where(later >= 0, per_second * difference(visits.course[later], visits.course), np.nan)
    moves = np.flatnonzero((still_later >= 0) & ~stands)
    label = np.full(visits.speed.size, -1, np.int64)
    label[moves] = _grouped(_features(visits.speed, gained, turned, moves, later[moves]), rng)
    n = int(label.max(initial=-1)) + 1
    standing = visits.seconds[visits.stands].sum()
    left = float(visits.follows()[visits.stands].sum())
    if n == 0:
        anyhow = unlearned_background(share=1.0, standing=1.0, start_rate=(left + 0.1) / (standing + 1.0))
        return anyhow, csr_array((2, 2))
    columns = _of_groups(label[moves], visits.speed[moves], gained[moves], turned[moves])
    label[stands] = n
    known = np.flatnonzero((later >= 0) & (label >= 0))
    known = known[label[later[known]] >= 0]
    follow = csr_array((np.ones(known.size), (label[known], label[later[known]])), shape=(n + 1, n + 1))
    share = standing / max(visits.seconds.sum(), 1e-9)
    columns["share"] = columns["share"] * (1.0 - share)
    return background_manoeuvres(**columns, standing=share, start_rate=(left + 0.1) / (standing + 1.0)), follow


def _features(
    speed: FloatArray, gained: FloatArray, turned: FloatArray, moves: IntArray, later: IntArray
) -> FloatArray:  # fmt: skip
    """(m, 5) speed, and what is gained and turned in this second and the next, by how much is typical."""
    columns = [np.log(speed[moves] + 1.0) / LOG_PACE]
    for change in (gained, turned):
        typical = np.sqrt(np.mean(np.square(change[moves]))) + 1e-6 if moves.size else 1.0
        columns += [np.clip(change[at] / typical, -FARTHEST, FARTHEST) for at in (moves, later)]
    return np.column_stack(columns)


def _grouped(feature: FloatArray, rng: np.random.Generator) -> IntArray:
    """(m,) the group of each row."""
    few = feature[rng.permutation(len(feature))[:MOST_INSTANTS]]
    k = min(MOST_GROUPS, len(feature) // INSTANTS_EACH, len(np.unique(few, axis=0)))
    if k < 2:
        return np.zeros(len(feature), np.int64)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "One of the clusters is empty")  # then there are fewer groups
        center, _ = kmeans2(few, k, minit="++", seed=rng)
    return np.asarray(np.unique(vq(feature, center)[0], return_inverse=True)[1], np.int64)


def _of_groups(label: IntArray, speed: FloatArray, gained: FloatArray, turned: FloatArray) -> dict[str, FloatArray]:
    """What vehicles of each group do."""

    def mean(column: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(label, column) / count)

    count = np.bincount(label)
    log_pace, way = np.log(speed + CREEP), speed + 0.5 * gained
    curvature = np.bincount(label, turned * way) / (np.bincount(label, way**2) + LEAST_WAYS)
    faster = speed - mean(speed)[label]
    reversion = np.bincount(label, faster * gained) / (np.bincount(label, faster**2) + LEAST_FASTER)
    reversion = np.clip(reversion, -1.0, 0.0)
    pushed = gained - mean(gained)[label] - reversion[label] * faster
    strayed = turned - curvature[label] * way
    return {
        "share": count / count.sum(),
        "log_pace": mean(log_pace),
        "log_pace_spread": np.sqrt(mean((log_pace - mean(log_pace)[label]) ** 2)),
        "acceleration": np.column_stack([mean(gained) - reversion * mean(speed), reversion]),
        "push": np.sqrt((mean(pushed**2) + LEAST_PUSH**2 / count) / PUSHED_SHARE),
        "turning": np.sqrt(mean(strayed**2) + LEAST_TURNING**2 / count),
        "curvature": curvature,
    }
