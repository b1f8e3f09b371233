"""Compiled steps of the smoother: particles as columns, their joint moments, and the sweep back.

A state is x, y and their rates. A link says what the state at one time was, given that at a later one:
x | x' ~ N(mean + gain (x' - later), spread).
"""

import math

import numpy as np
from numba import njit

from dirprim_filter.distributions._elementary import squared_sine
from dirprim_filter.filtering._kernels import Cloud, effective_sample_size
from tessellation.arrays import FloatArray, IntArray

N_STATES = 4
N_COLUMNS = 6
"""Of a particle: its state, then cosine and sine of its direction."""
HALVINGS = 12
"""Of the interval in which the exponent of weights is looked for."""
LEAST_VARIANCE = np.array([1e-8, 1e-8, 1e-6, 1e-6])
"""Added to what a later state varies by: standing vehicles' velocities do not vary at all."""


@njit(cache=True, nogil=True)
def columns_of(cloud: Cloud, vehicle: IntArray, out: FloatArray) -> None:
    """Fills (V, 6, P): x, y, their rates, cosine and sine of the direction."""
    for i in range(vehicle.size):
        v = vehicle[i]
        place, direction, speed, column = cloud.position[v], cloud.direction[v], cloud.speed[v], out[i]
        for p in range(direction.size):
            column[4, p] = 1.0 - 2.0 * squared_sine(0.5 * direction[p])
        for p in range(direction.size):
            column[5, p] = 1.0 - 2.0 * squared_sine(0.5 * direction[p] - 0.25 * math.pi)
        for p in range(direction.size):
            column[0, p], column[1, p] = place[p, 0], place[p, 1]
        for p in range(direction.size):
            column[2, p], column[3, p] = speed[p] * column[4, p], speed[p] * column[5, p]


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
    """Fills (6,) and (4, 4) from (6, P) columns."""
    for a in range(N_COLUMNS):
        mean[a] = np.dot(weight, column[a])
    for a in range(N_STATES):
        for b in range(a + 1):
            covariance[a, b] = covariance[b, a] = cross(weight, column[a], mean[a], column[b], mean[b])


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def cross(weight: FloatArray, one: FloatArray, its_mean: float, other: FloatArray, others_mean: float) -> float:
    """Weighted covariance of two columns."""
    total = 0.0
    for p in range(weight.size):
        total += weight[p] * (one[p] - its_mean) * (other[p] - others_mean)
    return total


@njit(cache=True, nogil=True)
def link(
    weight: FloatArray, then: FloatArray, now: FloatArray, mean: FloatArray, later: FloatArray, gain: FloatArray,
    spread: FloatArray,
) -> None:  # fmt: skip
    """The link from particles `then` (6, P) to the same ones `now`: mean (6,), later (4,), gain and spread (4, 4).

    gain = C (P' + least)^-1 and spread = P - gain C^T - C gain^T + gain P' gain^T, C = cov(then, now).
    """
    of_now, p_now, p_then, c = np.empty(N_COLUMNS), np.empty((4, 4)), np.empty((4, 4)), np.empty((4, 4))
    moments(weight, now, of_now, p_now)
    moments(weight, then, mean, p_then)
    for a in range(N_STATES):
        for b in range(N_STATES):
            c[a, b] = cross(weight, then[a], mean[a], now[b], of_now[b])
    later[:] = of_now[:N_STATES]
    solved(c, p_now, gain)
    around(p_then, p_now, c, gain, spread)


@njit(cache=True, nogil=True)
def solved(c: FloatArray, p_later: FloatArray, gain: FloatArray) -> None:
    """Fills gain = C (P' + least)^-1."""
    regular = p_later.copy()
    for a in range(N_STATES):
        regular[a, a] += LEAST_VARIANCE[a]
    gain[:] = np.linalg.solve(regular, np.ascontiguousarray(c.T)).T


@njit(cache=True, nogil=True)
def around(p: FloatArray, p_later: FloatArray, c: FloatArray, gain: FloatArray, spread: FloatArray) -> None:
    """Fills P - G C^T - C G^T + G P' G^T: a covariance whatever the gain."""
    half = gain @ c.T
    spread[:] = p - half - half.T + gain @ p_later @ gain.T


@njit(cache=True, nogil=True)
def sweep_back(
    ahead: IntArray, mean: FloatArray, later: FloatArray, gain: FloatArray, spread: FloatArray, state: FloatArray,
    covariance: FloatArray,
) -> None:  # fmt: skip
    """Rauch, Tung and Striebel's sweep over n links, from the state after the last one back to the first.

    Args:
        ahead: (n,) how many links ahead the later state of each stands.
        mean: (n, 4) of each state.
        later: (n, 4) of its later state.
        gain: (n, 4, 4) from a later state's deviation to its own.
        spread: (n, 4, 4) of what the later state leaves open.
        state: (n + 1, 4) of which the last is given; the others are filled.
        covariance: (n + 1, 4, 4), likewise.
    """
    for i in range(ahead.size - 1, -1, -1):
        j = i + ahead[i]
        state[i] = mean[i] + gain[i] @ (state[j] - later[i])
        covariance[i] = spread[i] + gain[i] @ covariance[j] @ gain[i].T
