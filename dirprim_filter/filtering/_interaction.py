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
def predict(
    table: MotionTable, response: LeaderTable, cloud: Cloud, others: FloatArray, vehicle: IntArray, own: IntArray,
    since_s: FloatArray, dt_s: FloatArray,
) -> None:  # fmt: skip
    """Move every particle of the given vehicles, among others that are extrapolated at constant velocity.

    Place-free particles ignore leaders: they cover vehicles that do what no vehicle did there in the log.

    Args:
        table: the map.
        response: the map's response to leaders; without trust vehicles move as if alone.
        cloud: the particles.
        others: (1, m, 4) place, direction and speed.
        vehicle: (V,) the vehicles to move.
        own: (V,) the index of each vehicle among the others, -1 for none.
        since_s: (V,) seconds by which each is later than the others.
        dt_s: (V,) seconds to move by.
    """
    n, m = cloud.speed.shape[1], others.shape[1]
    is_alone = response.trust == 0.0 or m == 0
    curvature, seen = np.empty(n), np.empty((n, 3))
    led, there = np.empty((0 if is_alone else n, 3)), np.empty((1, m, 4))
    for i in range(vehicle.size):
        v = vehicle[i]
        if is_alone:
            step(table, cloud, v, led, dt_s[i])
            continue
        n_looks = max(1, math.ceil(dt_s[i] / LOOK_S - 1e-9))
        h = dt_s[i] / n_looks
        for look in range(n_looks):
            n_near, itself = vehicles_near(cloud.position[v], others[0], own[i], since_s[i] + look * h, there[0])
            look_ahead(table, response, cloud, v, there, n_near, itself, curvature, seen, led)
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
def predict_paths(
    table: MotionTable, response: LeaderTable, cloud: Cloud, dt_s: FloatArray, path: FloatArray
) -> None:  # fmt: skip
    """Joint rollouts: particle p of all vehicles is one world. (n_steps,) seconds; fills (V, P, n_steps, 2)."""
    n_vehicles, n = cloud.speed.shape
    is_alone = response.trust == 0.0 or n_vehicles == 1
    seers = 0 if is_alone else n
    curvature, seen = np.empty(seers), np.empty((seers, 3))
    led, world = np.empty((n_vehicles, seers, 3)), np.empty((seers, n_vehicles, 4))
    for t in range(dt_s.size):
        n_looks = 1 if is_alone else max(1, math.ceil(dt_s[t] / LOOK_S - 1e-9))
        for _ in range(n_looks):
            if not is_alone:
                for v in range(n_vehicles):
                    for p in range(n):
                        world[p, v, 0], world[p, v, 1] = cloud.position[v, p, 0], cloud.position[v, p, 1]
                        world[p, v, 2], world[p, v, 3] = cloud.direction[v, p], cloud.speed[v, p]
                for v in range(n_vehicles):
                    look_ahead(table, response, cloud, v, world, n_vehicles, v, curvature, seen, led[v])
            for v in range(n_vehicles):
                step(table, cloud, v, led[v], dt_s[t] / n_looks)
        for v in range(n_vehicles):
            for p in range(n):
                path[v, p, t, 0], path[v, p, t, 1] = cloud.position[v, p, 0], cloud.position[v, p, 1]


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
