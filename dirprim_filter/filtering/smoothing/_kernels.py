"""Compiled steps of the smoother: particles as columns, their joint moments, and the sweep back."""

import math

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions._elementary import squared_sine
from dirprim_filter.filtering._kernels import Cloud
from dirprim_filter.primitives._manoeuvres import acceleration_of, offset_from
from tessellation._compiling import compiled

N_STATES = 5
"""Of a particle: x, y, their rates, and the acceleration along its way, which lasts: without it a sweep takes each
step's error for one of its own, and is too sure."""
N_MEANS = 7
"""Of a particle: its state, then cosine and sine of its direction."""
N_COLUMNS = 9
"""Those, then what it follows: its manoeuvre and its push."""


@compiled
def columns_of(cloud: Cloud, rows: FloatArray, vehicle: IntArray, out: FloatArray) -> None:
    """Fills (V, 9, P): x, y, their rates, acceleration, cosine and sine of the direction, manoeuvre and push."""
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
            z = manoeuvre[p]
            east, north = offset_from(rows, z, place[p, 0], place[p, 1])
            column[4, p] = acceleration_of(rows, z, east, north, speed[p], push[p])
            column[7, p], column[8, p] = z, push[p]


@compiled
def joint_moments(
    weight: FloatArray, now: FloatArray, vehicle: IntArray, then: FloatArray, mean: FloatArray, covariance: FloatArray
) -> None:
    """Fills (k, 14) and (k, 10, 10) from particles `then` (k, 9, P) and the same ones `now[vehicle]`, by weight."""
    for i in range(vehicle.size):
        w, columns = weight[vehicle[i]], (then[i], now[vehicle[i]])
        off, by_weight = np.empty((2 * N_STATES, w.size)), np.empty((2 * N_STATES, w.size))
        for k in range(2):
            of, first = columns[k][:N_MEANS], k * N_STATES
            average = np.dot(of, w)
            mean[i, k * N_MEANS : (k + 1) * N_MEANS] = average
            for a in range(N_STATES):
                for p in range(w.size):
                    off[first + a, p] = of[a, p] - average[a]
                for p in range(w.size):
                    by_weight[first + a, p] = w[p] * off[first + a, p]
        covariance[i] = np.dot(by_weight, off.T)


@compiled
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
    for i in range(ahead.size - 1, -1, -1):
        j = i + ahead[i]
        state[i] = mean[i] + np.dot(gain[i], state[j] - later[i])
        covariance[i] = spread[i] + np.dot(np.dot(gain[i], covariance[j]), gain[i].T)
