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
from dirprim_filter.primitives._manoeuvres import MotionTable
from tessellation import OUTSIDE
from tessellation._compiling import compiled, pasted


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
        step(table, cloud, v, led, dt_s[i])


@pasted  # by itself it would compile all of `move` once more
def step(table: MotionTable, cloud: Cloud, v: int, led: FloatArray, dt_s: float) -> None:
    """Move the particles of one vehicle."""
    state = cloud.state[v].copy()  # of its own memory, or threads would count references to one array in turns
    _motion.move(
        table, cloud.position[v], cloud.direction[v], cloud.speed[v], cloud.cell[v], cloud.manoeuvre[v],
        cloud.push[v], led, dt_s, state,
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
