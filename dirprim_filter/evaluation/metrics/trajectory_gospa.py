"""T-GOSPA: how far are whole tracks from whole trajectories, with a price on every switch?

Source: Garcia-Fernandez, Rahmathullah and Svensson, A Metric on the Space of Finite Sets of Trajectories for Evaluation
of Multi-Target Tracking Algorithms, IEEE Transactions on Signal Processing, 2020: its linear program, of order 2.

An assignment W(i, j, k) in [0, 1] of vehicle i to track j at instant k costs

    sum_k sum_ij D(i, j, k) W(i, j, k) + penalty^2 / 2 sum_k sum_ij |W(i, j, k + 1) - W(i, j, k)|

where a vehicle that is not assigned, or farther than the cut-off, costs half the squared cut-off, as does a track.
Vehicles and tracks that never come near each other need no W. What does come near each other makes a component, and
the program falls into one for each. At instants at which no two of a component are near, W may stay as it is.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_array, eye_array, hstack, kron, vstack

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.evaluation.metrics.comparison import Comparison
from dirprim_filter.evaluation.metrics.gospa import ORDER
from dirprim_filter.evaluation.metrics.matching import components

MAX_ASSIGNMENTS = 500_000
"""Numbers W of one linear program: so many take half a minute and 2.5 GB."""


class TrajectoryGospa(NamedTuple):
    """The metric; the parts add up to its square.

    Attributes:
        distance: metres.
        localisation: square metres, from tracks to the vehicles they are assigned to.
        missed: square metres, half the squared cut-off for each vehicle and instant without a track.
        false: square metres, the same for each track without a vehicle.
        switch: square metres; from one track to another costs the squared penalty, to or from none half of it.
    """

    distance: float
    localisation: float
    missed: float
    false: float
    switch: float


def trajectory_gospa(comparison: Comparison, *, cutoff_m: float, penalty_m: float = 2.0) -> TrajectoryGospa:
    """The metric of order 2.

    Args:
        comparison: of one world, or of several, whose squared metrics are added.
        cutoff_m: metres.
        penalty_m: metres, the price of a switch.

    Raises:
        ValueError: a length is not positive, the cut-off is beyond the comparison's reach, or one linear program has
            more than 500,000 assignments: pairs of vehicles and tracks that come near each other, times instants.
    """
    if not penalty_m > 0:
        raise ValueError(f"penalty_m: expected a positive distance in metres, got {penalty_m}")
    near = comparison.within(cutoff_m)
    key, of_pair = np.unique(
        comparison.vehicle[near.row] * comparison.n_tracks + comparison.track[near.column], return_inverse=True
    )
    vehicle, track = key // max(comparison.n_tracks, 1), key % max(comparison.n_tracks, 1)
    component = components(vehicle, track)
    instant = comparison.row_instant[near.row]
    weight, turned = np.ones(near.row.size), 0.0
    for number in np.flatnonzero(np.bincount(component) > 1):  # a pair alone is together from first to last
        pairs = np.flatnonzero(component == number)
        rows = np.flatnonzero(component[of_pair] == number)
        instants, when = np.unique(instant[rows], return_inverse=True)
        which = np.searchsorted(pairs, of_pair[rows])
        cost = np.zeros((pairs.size, instants.size))
        cost[which, when] = near.distance[rows] ** ORDER - cutoff_m**ORDER
        solved = _assigned(cost, vehicle[pairs], track[pairs], penalty=0.5 * penalty_m**ORDER)
        weight[rows] = solved[which, when]
        turned += float(np.abs(np.diff(solved, axis=1)).sum())
    half, assigned = 0.5 * cutoff_m**ORDER, float(weight.sum())
    parts = (
        float(weight @ near.distance**ORDER), half * (comparison.vehicle.size - assigned),
        half * (comparison.track.size - assigned), 0.5 * penalty_m**ORDER * turned,
    )  # fmt: skip
    return TrajectoryGospa(float(np.sqrt(sum(parts))), *parts)


def _assigned(cost: FloatArray, vehicle: IntArray, track: IntArray, *, penalty: float) -> FloatArray:
    """(p, k) the assignments of pairs at instants that cost least.

    Args:
        cost: (p, k) of an assignment, less what it costs to leave both alone.
        vehicle: (p,) of each pair.
        track: (p,) of each pair.
        penalty: of a change by one.

    Raises:
        ValueError: there are too many.
    """
    p, k = cost.shape
    if p * k > MAX_ASSIGNMENTS:
        raise ValueError(
            f"T-GOSPA: expected at most {MAX_ASSIGNMENTS} assignments, got {p} pairs of vehicles and tracks that come "
            f"near each other, at {k} instants; score a shorter part"
        )
    once = vstack([kron(_members(column), eye_array(k)) for column in (vehicle, track)])
    change = kron(eye_array(p), eye_array(k - 1, k, k=1) - eye_array(k - 1, k))
    n_changes = p * (k - 1)
    size_of_change = -eye_array(n_changes)
    limits: Any = vstack(  # a sparse array, of whose formats the stubs know no sum
        [
            hstack([once, csr_array((once.shape[0], n_changes))]),
            hstack([change, size_of_change]),
            hstack([-change, size_of_change]),
        ],
        format="csr",
    )
    above = np.concatenate([np.ones(once.shape[0]), np.zeros(2 * n_changes)])
    price = np.concatenate([cost.ravel(), np.full(n_changes, penalty)])
    found = linprog(price, A_ub=limits, b_ub=above, bounds=(0.0, 1.0), method="highs")
    if found.x is None:
        raise ValueError(f"T-GOSPA: expected a solution of its linear program, got {found.message}")
    return np.asarray(found.x[: p * k]).reshape(p, k)


def _members(column: IntArray) -> csr_array:
    """(m, p) which pairs each vehicle, or track, is in: those that are in several, so that they bind."""
    _, number, count = np.unique(column, return_inverse=True, return_counts=True)
    which = np.zeros((count.size, column.size))
    which[number, np.arange(column.size)] = 1.0
    return csr_array(which[count > 1])
