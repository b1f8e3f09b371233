"""Compiled steps of the particle filter, one vehicle after the other: no vehicle sees another's numbers.

Particles move by the manoeuvres of the map (`primitives._motion`), in forecasts also in response to the vehicle ahead.
Each vehicle sees where the others were before the step, so the order of the vehicles does not matter.
"""

import math
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions._arithmetic import dot, total_of
from dirprim_filter.distributions._elementary import squared_sine
from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.primitives import _leader, _motion
from dirprim_filter.primitives._leader import LeaderTable
from dirprim_filter.primitives._manoeuvres import MotionTable, acceleration_of, offset_from
from tessellation import OUTSIDE
from tessellation._compiling import compiled


class Cloud(NamedTuple):
    """Particles of every vehicle."""

    position: FloatArray  # (V, P, 2)
    direction: FloatArray  # (V, P)
    speed: FloatArray  # (V, P)
    cell: IntArray  # (V, P)
    manoeuvre: IntArray  # (V, P)
    push: FloatArray  # (V, P) the vehicle's own acceleration, in standard deviations of its manoeuvre's
    weight: FloatArray  # (V, P) sums to 1
    state: UIntArray  # (V, 4) of the random numbers
    since_s: FloatArray  # (V,) since each belief was last weighed


LOOK_S = 0.2
"""Seconds: the longest time between two searches for the vehicle ahead."""
NO_SCENE = np.empty((0, 0, 4))
"""The scene of vehicles that move as if alone."""
N_STATES = 5
"""Of a particle: x, y, their rates, and the acceleration along its way, which lasts: without it a sweep takes each
step's error for one of its own, and is too sure."""
N_MEANS = 7
"""Of a particle: its state, then cosine and sine of its direction."""
N_SAMPLE = 9
"""Those, then what it follows: its manoeuvre and its push."""


@compiled
def initialise_motion(table: MotionTable, cloud: Cloud, vehicle: IntArray) -> None:
    """Look up the cell of every particle, and draw a manoeuvre that fits its direction and speed."""
    for v in vehicle:
        _motion.initialise_motion(
            table, cloud.position[v], cloud.direction[v], cloud.speed[v], cloud.cell[v], cloud.manoeuvre[v],
            cloud.push[v], cloud.state[v],
        )  # fmt: skip


@compiled
def advance(
    table: MotionTable, response: LeaderTable, cloud: Cloud, scene: FloatArray, vehicle: IntArray, dt_s: FloatArray
) -> None:
    """Move every particle of the given vehicles by the map: the one transition of filter, smoother and forecasts.

    Args:
        table: the map.
        response: the map's response to leaders.
        cloud: the particles.
        scene: (n, m, 4) place, direction and speed of all vehicles before the step: particle p of all of them is one
            scene, which holds for at most `LOOK_S`. Or (0, 0, 4): vehicles move as if alone.
        vehicle: (V,) the vehicles to move.
        dt_s: (V,) seconds to move by.
    """
    n, is_alone = cloud.speed.shape[1], scene.shape[0] == 0
    curvature, seen, led = np.empty(n), np.empty((n, 3)), np.empty((0 if is_alone else n, 3))
    for i in range(vehicle.size):
        v = vehicle[i]
        if not is_alone:
            _leader.bends(table, cloud.manoeuvre[v], cloud.direction[v], curvature)
            _leader.behind(scene, v, cloud.position[v], cloud.direction[v], curvature, seen)
            _leader.respond(response, cloud.speed[v], cloud.push[v], seen, led)
        state = cloud.state[v].copy()  # of its own memory, or threads would count references to one array in turns
        _motion.move(
            table, cloud.position[v], cloud.direction[v], cloud.speed[v], cloud.cell[v], cloud.manoeuvre[v],
            cloud.push[v], led, dt_s[i], state,
        )  # fmt: skip
        for word in range(state.size):  # a slice would compile numba's strings for its error
            cloud.state[v, word] = state[word]


@compiled
def effective_sample_size(weight: FloatArray) -> float:
    """1 / sum of squared weights."""
    return 1.0 / dot(weight, weight)


@compiled
def moments(cloud: Cloud, vehicle: IntArray, out: FloatArray) -> None:
    """Fills (V, 10): mean x, y, covariance xx, xy, yy, direction, its resultant, speed, its deviation, sample size."""
    n = cloud.position.shape[1]
    one, two, three = np.empty(n), np.empty(n), np.empty(n)
    for i in range(vehicle.size):
        v = vehicle[i]
        weight, place, direction, pace = cloud.weight[v], cloud.position[v], cloud.direction[v], cloud.speed[v]
        for p in range(n):
            one[p] = 1.0 - 2.0 * squared_sine(0.5 * direction[p])
            two[p] = 1.0 - 2.0 * squared_sine(0.5 * direction[p] - 0.25 * math.pi)
        total = total_of(weight)
        c, s, speed = dot(weight, one) / total, dot(weight, two) / total, dot(weight, pace) / total
        for p in range(n):
            one[p], two[p] = place[p, 0], place[p, 1]
        x, y = dot(weight, one) / total, dot(weight, two) / total
        out[i, 0], out[i, 1], out[i, 5], out[i, 6], out[i, 7] = x, y, math.atan2(s, c), math.hypot(c, s), speed
        for p in range(n):
            dx, dy = place[p, 0] - x, place[p, 1] - y
            one[p], two[p], three[p] = dx * dx, dx * dy, dy * dy
        out[i, 2], out[i, 3] = dot(weight, one) / total, dot(weight, two) / total
        out[i, 4] = dot(weight, three) / total
        for p in range(n):
            one[p] = (pace[p] - speed) ** 2
        out[i, 8] = math.sqrt(dot(weight, one) / total)
        out[i, 9] = effective_sample_size(weight)


@compiled
def places(cloud: Cloud, of_manoeuvre: FloatArray, vehicle: IntArray, out: FloatArray) -> None:
    """Fills (V, 3): the weight of particles in no cell, and the means of two numbers of each manoeuvre, (z, 2)."""
    n = cloud.position.shape[1]
    outside, one, two = np.empty(n), np.empty(n), np.empty(n)
    for i in range(vehicle.size):
        cell, manoeuvre, weight = cloud.cell[vehicle[i]], cloud.manoeuvre[vehicle[i]], cloud.weight[vehicle[i]]
        for p in range(n):
            outside[p] = 1.0 if cell[p] == OUTSIDE else 0.0
            one[p], two[p] = of_manoeuvre[manoeuvre[p], 0], of_manoeuvre[manoeuvre[p], 1]
        out[i, 0], out[i, 1], out[i, 2] = dot(weight, outside), dot(weight, one), dot(weight, two)


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
