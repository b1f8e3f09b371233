"""Compiled steps of the smoother: particles as columns, their joint moments, and the sweep back.

A link says what the state at one time was, given that at a later one: x | x' ~ N(mean + gain (x' - later), spread).
"""

import math

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions._elementary import squared_sine
from dirprim_filter.filtering._kernels import Cloud, effective_sample_size
from dirprim_filter.primitives._manoeuvres import A_0, A_E, A_N, A_V, EAST, EXTENT, NORTH, PUSH, STARTS

N_STATES = 5
"""Of a particle: x, y, their rates, and the acceleration along its way, which lasts: without it a sweep takes each
step's error for one of its own, and is too sure."""
N_COLUMNS = 7
"""Of a particle: its state, then cosine and sine of its direction."""
HALVINGS = 12
"""Of the interval in which the exponent of weights is looked for."""
LEAST_VARIANCE = np.array([1e-8, 1e-8, 1e-6, 1e-6, 1e-6])
"""Added to what a later state varies by: standing vehicles' velocities do not vary at all."""


@njit(cache=True, nogil=True)
def columns_of(cloud: Cloud, rows: FloatArray, vehicle: IntArray, out: FloatArray) -> None:
    """Fills (V, 7, P): x, y, their rates, acceleration, cosine and sine of the direction; `rows` see `MotionTable`."""
    for i in range(vehicle.size):
        v = vehicle[i]
        place, direction, speed, column = cloud.position[v], cloud.direction[v], cloud.speed[v], out[i]
        manoeuvre, push = cloud.manoeuvre[v], cloud.push[v]
        for p in range(direction.size):
            column[5, p] = 1.0 - 2.0 * squared_sine(0.5 * direction[p])
        for p in range(direction.size):
            column[6, p] = 1.0 - 2.0 * squared_sine(0.5 * direction[p] - 0.25 * math.pi)
        for p in range(direction.size):
            column[0, p], column[1, p] = place[p, 0], place[p, 1]
        for p in range(direction.size):
            column[2, p], column[3, p] = speed[p] * column[5, p], speed[p] * column[6, p]
        for p in range(direction.size):
            row = rows[manoeuvre[p]]
            extent, moves = row[EXTENT], 0.0 if row[STARTS] > 0.0 else 1.0
            east = min(max(place[p, 0] - row[EAST], -extent), extent)
            north = min(max(place[p, 1] - row[NORTH], -extent), extent)
            gained = row[A_0] + row[A_E] * east + row[A_N] * north + row[A_V] * speed[p] + row[PUSH] * push[p]
            column[4, p] = moves * gained


@njit(cache=True, nogil=True)
def tempered(before: FloatArray, after: FloatArray, least: float, weight: FloatArray) -> None:
    """Fills (P,) weights before^(1-t) after^t with the largest t up to 1 that leaves an effective size of `least`.

    All of them are right to learn from how a state follows from a later one: they differ by a function of the later.
    """
    weight[:] = after
    if effective_sample_size(weight) >= least:
        return
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        total = 0.0
        for p in range(weight.size):
            weight[p] = before[p] * (after[p] / before[p]) ** middle if before[p] > 0.0 else 0.0
            total += weight[p]
        weight /= total
        if effective_sample_size(weight) >= least:
            low = middle
        else:
            high = middle
    total = 0.0
    for p in range(weight.size):
        weight[p] = before[p] * (after[p] / before[p]) ** low if before[p] > 0.0 else 0.0
        total += weight[p]
    weight /= total


@njit(cache=True, nogil=True)
def moments(weight: FloatArray, column: FloatArray, mean: FloatArray, covariance: FloatArray) -> None:
    """Fills (7,) and (5, 5) from (7, P) columns."""
    mean[:] = np.dot(column, weight)
    off = np.empty((N_STATES, weight.size))
    covariance[:] = np.dot(weighted(weight, column, mean, off), off.T)


@njit(cache=True, nogil=True)
def weighted(weight: FloatArray, column: FloatArray, mean: FloatArray, off: FloatArray) -> FloatArray:
    """Fills (5, P) deviations of the states from their mean; -> (5, P) the same by weight."""
    by_weight = np.empty_like(off)
    for a in range(N_STATES):
        for p in range(weight.size):
            off[a, p] = column[a, p] - mean[a]
        for p in range(weight.size):
            by_weight[a, p] = weight[p] * off[a, p]
    return by_weight


@njit(cache=True, nogil=True)
def link(
    weight: FloatArray, then: FloatArray, now: FloatArray, added: FloatArray, mean: FloatArray, later: FloatArray,
    gain: FloatArray, spread: FloatArray,
) -> None:  # fmt: skip
    """The link from particles `then` (7, P) to the same ones `now`: mean (7,), later (5,), gain and spread (5, 5).

    P' is the covariance of `now` with what is `added` (5, 5) to it, C = cov(then, now): gain = C (P' + least)^-1 and
    spread = P - gain C^T - C gain^T + gain P' gain^T.
    """
    of_now, off = np.dot(now, weight), np.empty((2 * N_STATES, weight.size))
    mean[:] = np.dot(then, weight)
    by_weight = np.empty_like(off)
    by_weight[:N_STATES] = weighted(weight, then, mean, off[:N_STATES])
    by_weight[N_STATES:] = weighted(weight, now, of_now, off[N_STATES:])
    both = np.dot(by_weight, off.T)
    p_then, c, p_now = both[:N_STATES, :N_STATES], both[:N_STATES, N_STATES:], both[N_STATES:, N_STATES:] + added
    later[:] = of_now[:N_STATES]
    solved(c, p_now, gain)
    around(p_then, p_now, c, gain, spread)


@njit(cache=True, nogil=True)
def link_each(
    weight: FloatArray, then: FloatArray, now: FloatArray, added: FloatArray, at: IntArray, row: IntArray,
    vehicle: IntArray, mean: FloatArray, later: FloatArray, gain: FloatArray, spread: FloatArray,
) -> None:  # fmt: skip
    """`link` from particles `then[row]` to those of a vehicle `now`, by its weights, into results number `at`."""
    for i in range(at.size):
        k, v = at[i], vehicle[i]
        link(weight[v], then[row[i]], now[v], added[v], mean[k], later[k], gain[k], spread[k])


@njit(cache=True, nogil=True)
def moments_each(weight: FloatArray, column: FloatArray, mean: FloatArray, covariance: FloatArray) -> None:
    """`moments` of several vehicles, likewise."""
    for i in range(weight.shape[0]):
        moments(weight[i], column[i], mean[i], covariance[i])


@njit(cache=True, nogil=True)
def solved(c: FloatArray, p_later: FloatArray, gain: FloatArray) -> None:
    """Fills gain = C (P' + least)^-1."""
    regular = p_later.copy()
    for a in range(N_STATES):
        regular[a, a] += LEAST_VARIANCE[a]
    gain[:] = np.linalg.solve(regular, c.T.copy()).T


@njit(cache=True, nogil=True)
def around(p: FloatArray, p_later: FloatArray, c: FloatArray, gain: FloatArray, spread: FloatArray) -> None:
    """Fills P - G C^T - C G^T + G P' G^T: a covariance whatever the gain."""
    for a in range(N_STATES):
        for b in range(N_STATES):
            total = p[a, b]
            for k in range(N_STATES):
                total -= gain[a, k] * c[b, k] + c[a, k] * gain[b, k]
                for m in range(N_STATES):
                    total += gain[a, k] * p_later[k, m] * gain[b, m]
            spread[a, b] = total


@njit(cache=True, nogil=True)
def sweep_back(
    ahead: IntArray, mean: FloatArray, later: FloatArray, gain: FloatArray, spread: FloatArray, state: FloatArray,
    covariance: FloatArray,
) -> None:  # fmt: skip
    """Rauch, Tung and Striebel's sweep over n links, from the state after the last one back to the first.

    Args:
        ahead: (n,) how many links ahead the later state of each stands.
        mean: (n, d) of each state.
        later: (n, d) of its later state.
        gain: (n, d, d) from a later state's deviation to its own.
        spread: (n, d, d) of what the later state leaves open.
        state: (n + 1, d) of which the last is given; the others are filled.
        covariance: (n + 1, d, d), likewise.
    """
    d = mean.shape[1]
    half = np.empty((d, d))
    for i in range(ahead.size - 1, -1, -1):
        j = i + ahead[i]
        for a in range(d):
            state[i, a] = mean[i, a]
            for k in range(d):
                state[i, a] += gain[i, a, k] * (state[j, k] - later[i, k])
                half[a, k] = 0.0
                for m in range(d):
                    half[a, k] += gain[i, a, m] * covariance[j, m, k]
        for a in range(d):
            for b in range(d):
                covariance[i, a, b] = spread[i, a, b]
                for k in range(d):
                    covariance[i, a, b] += half[a, k] * gain[i, b, k]
