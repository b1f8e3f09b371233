"""Compiled steps of the particle filter, one vehicle after the other: no vehicle sees another's numbers.

Particles move by the manoeuvres of the map (`primitives._motion`).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions._arithmetic import dot, total_of
from dirprim_filter.distributions._elementary import EXACT, squared_sine
from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.primitives import _motion
from dirprim_filter.primitives._manoeuvres import MotionTable
from tessellation import OUTSIDE


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


@njit(nogil=True, **EXACT)
def initialise_motion(table: MotionTable, cloud: Cloud, vehicle: IntArray) -> None:
    """Look up the cell of every particle, and draw a manoeuvre that fits its direction and speed."""
    for v in vehicle:
        _motion.initialise_motion(
            table, cloud.position[v], cloud.direction[v], cloud.speed[v], cloud.cell[v], cloud.manoeuvre[v],
            cloud.push[v], cloud.state[v],
        )  # fmt: skip


@njit(cache=True)
def effective_sample_size(weight: FloatArray) -> float:
    """1 / sum of squared weights."""
    return 1.0 / dot(weight, weight)


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def outside(cloud: Cloud, vehicle: IntArray, out: FloatArray) -> None:
    """Fills (V,): the weight of the particles that are in no cell."""
    is_outside = np.empty(cloud.position.shape[1])
    for i in range(vehicle.size):
        cell = cloud.cell[vehicle[i]]
        for p in range(cell.size):
            is_outside[p] = 1.0 if cell[p] == OUTSIDE else 0.0
        out[i] = dot(cloud.weight[vehicle[i]], is_outside)


@njit(cache=True, nogil=True)
def mean_of_manoeuvres(cloud: Cloud, value: FloatArray, vehicle: IntArray, out: FloatArray) -> None:
    """Fills (V,): the mean over the particles of what is (z,) of each manoeuvre."""
    of_particle = np.empty(cloud.position.shape[1])
    for i in range(vehicle.size):
        manoeuvre = cloud.manoeuvre[vehicle[i]]
        for p in range(manoeuvre.size):
            of_particle[p] = value[manoeuvre[p]]
        out[i] = dot(cloud.weight[vehicle[i]], of_particle)
