"""How vehicles move wherever the place says nothing: place-free manoeuvres, learned from all visits together.

Instants of all vehicles are grouped by their speed and by what they do in the next seconds: cruise, brake, turn left.
From second to second a vehicle goes over from one to the next, as often as was seen: a Markov chain.
"""

from __future__ import annotations

import warnings

import numpy as np
from scipy.cluster.vq import kmeans2, vq
from scipy.sparse import csr_array

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions.angles import difference
from dirprim_filter.primitives.motion import CREEP, JUMP_S, place_free_manoeuvres, unlearned_place_free
from dirprim_filter.primitives.visits import Visits

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
STRAIGHT_SHARE = 0.001
"""Of vehicles of no place, who go straight on at an even speed whatever the log's do: a filter looks for more."""
STRAIGHT_KEPT = 4.0
"""How often who goes straight on does so a second later, against once that it does as the log's vehicles do."""
PUSHED_SHARE = 0.85
"""Of the variance of a vehicle's own acceleration, what its mean over a second has at `PUSH_RATE`."""


def learn_place_free(visits: Visits, *, rng: np.random.Generator) -> tuple[dict[str, FloatArray], csr_array]:
    """Columns of the place-free manoeuvres, and how often one followed the other `JUMP_S` later.

    Args:
        visits: of vehicles.
        rng: draws the instants that are grouped, and where groups begin.
    """
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
        anyhow = unlearned_place_free(share=1.0, standing=1.0, start_rate=(left + 0.1) / (standing + 1.0))
        return anyhow, csr_array((2, 2))
    columns = _of_groups(label[moves], visits.speed[moves], gained[moves], turned[moves])
    _add_straight_on(columns, visits.speed[moves])
    label[stands] = n + 1
    follow = _follow(label, later, columns["share"])
    share = standing / max(visits.seconds.sum(), 1e-9)
    columns["share"] = columns["share"] * (1.0 - share)
    return place_free_manoeuvres(**columns, standing=share, start_rate=(left + 0.1) / (standing + 1.0)), follow


def _add_straight_on(columns: dict[str, FloatArray], speed: FloatArray) -> None:
    """Append a manoeuvre that keeps its direction at any speed: the log of a roundabout may have none."""
    log_pace = np.log(speed + CREEP)
    straight = {
        "share": STRAIGHT_SHARE, "log_pace": log_pace.mean(), "log_pace_spread": log_pace.std() + LOG_PACE,
        "acceleration": np.zeros(2), "curvature": 0.0,
    } | {name: np.average(columns[name], weights=columns["share"]) for name in ("push", "turning")}  # fmt: skip
    columns["share"] = columns["share"] * (1.0 - STRAIGHT_SHARE)
    for name, value in straight.items():
        columns[name] = np.concatenate([columns[name], np.asarray(value)[None]])


def _follow(label: IntArray, later: IntArray, share: FloatArray) -> csr_array:
    """How often one manoeuvre followed the other, from the label of each instant and of that `JUMP_S` later.

    Of `share` (k,) manoeuvres in motion the last goes straight on and is never observed; standing follows them.
    """
    known = np.flatnonzero((later >= 0) & (label >= 0))
    known = known[label[later[known]] >= 0]
    k = share.size
    before, after = np.append(label[known], np.full(k, k - 1)), np.append(label[later[known]], np.arange(k))
    count = np.append(np.ones(known.size), np.append(share[:-1], STRAIGHT_KEPT))
    return csr_array((count, (before, after)), shape=(k + 1, k + 1))


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
