"""Compiled: motion of the particles of vehicles, which respond to the vehicle ahead where the map says how.

Each vehicle sees where the others were before the step, so the order of the vehicles does not matter.
"""

import math

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.filtering._kernels import Cloud
from dirprim_filter.primitives import _leader, _motion
from dirprim_filter.primitives._leader import FAR_M, LeaderTable
from dirprim_filter.primitives._manoeuvres import MotionTable

LOOK_S = 0.2
"""Seconds: the longest time between two searches for the vehicle ahead."""


@njit(cache=True, nogil=True)
def advance(
    table: MotionTable, response: LeaderTable, cloud: Cloud, others: FloatArray, vehicle: IntArray, own: IntArray,
    since_s: FloatArray, dt_s: FloatArray,
) -> None:  # fmt: skip
    """Move every particle of the given vehicles by the map: the one transition of filter, smoother and forecasts.

    Args:
        table: the map.
        response: the map's response to leaders; without trust vehicles move as if alone.
        cloud: the particles.
        others: (1, m, 4) place, direction and speed of all vehicles, which are extrapolated at constant velocity; then
            particles without the map ignore leaders, for they cover vehicles that do what none did there in the log.
            Or (n, m, 4): particle p of all vehicles is one world, which holds for at most `LOOK_S`.
        vehicle: (V,) the vehicles to move.
        own: (V,) the index of each vehicle among the others, -1 for none.
        since_s: (V,) seconds by which each is later than the others.
        dt_s: (V,) seconds to move by.
    """
    n, m = cloud.speed.shape[1], others.shape[1]
    is_alone, is_world = response.trust == 0.0 or m == 0, others.shape[0] > 1
    curvature, seen = np.empty(n), np.empty((n, 3))
    led, there = np.empty((0 if is_alone else n, 3)), np.empty((1, m, 4))
    for i in range(vehicle.size):
        v = vehicle[i]
        n_looks = 1 if is_alone else max(1, math.ceil(dt_s[i] / LOOK_S - 1e-9))
        h = dt_s[i] / n_looks
        for look in range(n_looks):
            if not is_alone:
                near, n_near, itself = others, m, own[i]
                if not is_world:
                    later_s = since_s[i] + look * h
                    n_near, itself = vehicles_near(cloud.position[v], others[0], own[i], later_s, there[0])
                    near = there
                look_ahead(table, response, cloud, v, near, n_near, itself, curvature, seen, led)
                if not is_world:
                    for p in range(n):
                        if cloud.manoeuvre[v, p] >= table.begin[-1]:
                            led[p, 0], led[p, 1], led[p, 2] = 0.0, 1.0, 0.0
            step(table, cloud, v, led, h)


@njit(cache=True, nogil=True)
def vehicles_near(
    position: FloatArray, others: FloatArray, own: int, later_s: float, there: FloatArray
) -> tuple[int, int]:
    """Fills (m, 4) the vehicles that may lead one of the particles, (n, 2), as they are at constant velocity.

    Returns:
        Their number, and which of them is the particles' own, -1 for none.
    """
    west = east = position[0, 0]
    south = north = position[0, 1]
    for p in range(1, len(position)):
        west, east = min(west, position[p, 0]), max(east, position[p, 0])
        south, north = min(south, position[p, 1]), max(north, position[p, 1])
    n, itself = 0, -1
    for j in range(len(others)):
        distance = others[j, 3] * later_s
        x = others[j, 0] + distance * math.cos(others[j, 2])
        y = others[j, 1] + distance * math.sin(others[j, 2])
        if max(west - x, x - east, south - y, y - north) < FAR_M:
            itself = n if j == own else itself
            there[n, 0], there[n, 1], there[n, 2], there[n, 3] = x, y, others[j, 2], others[j, 3]
            n += 1
    return n, itself


@njit(cache=True, nogil=True)
def look_ahead(
    table: MotionTable, response: LeaderTable, cloud: Cloud, v: int, others: FloatArray, n_others: int,
    own: int, curvature: FloatArray, seen: FloatArray, led: FloatArray,
) -> None:  # fmt: skip
    """How the particles of a vehicle respond to their leaders: fills `led`, see `_motion.move`."""
    _leader.bends(table, cloud.manoeuvre[v], cloud.direction[v], curvature)
    _leader.behind(others, n_others, own, cloud.position[v], cloud.direction[v], curvature, seen)
    _leader.respond(response, cloud.speed[v], cloud.push[v], seen, led)


@njit(inline="always", cache=True, nogil=True)  # by itself it would compile all of `move` once more
def step(table: MotionTable, cloud: Cloud, v: int, led: FloatArray, dt_s: float) -> None:
    """Move the particles of one vehicle."""
    state = cloud.state[v].copy()  # of its own memory, or threads would count references to one array in turns
    _motion.move(
        table, cloud.position[v], cloud.direction[v], cloud.speed[v], cloud.cell[v], cloud.manoeuvre[v],
        cloud.push[v], led, dt_s, state,
    )  # fmt: skip
    for word in range(state.size):  # a slice would compile numba's strings for its error
        cloud.state[v, word] = state[word]
