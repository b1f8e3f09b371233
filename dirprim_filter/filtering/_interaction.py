"""Compiled: motion of the particles of vehicles, which in forecasts respond to the vehicle ahead.

Each vehicle sees where the others were before the step, so the order of the vehicles does not matter.
"""

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.filtering._kernels import Cloud
from dirprim_filter.primitives import _leader, _motion
from dirprim_filter.primitives._leader import LeaderTable
from dirprim_filter.primitives._manoeuvres import MotionTable

LOOK_S = 0.2
"""Seconds: the longest time between two searches for the vehicle ahead."""
NOBODY = np.empty((0, 0, 4))
"""The scene of vehicles that move as if alone."""


@njit(cache=True, nogil=True)
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
