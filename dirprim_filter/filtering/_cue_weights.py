"""Compiled: particle weights by a cue such as a turn signal (Senanayake et al. 2020, Eq. 4).

p_t is the cue: a mixture of von Mises over the direction some seconds later, relative to the current one. p_0 is given
by the particles: how far vehicles on their manoeuvre have turned by then.
"""

import math

from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.filtering._kernels import Cloud
from dirprim_filter.primitives._manoeuvres import MotionTable


@njit(cache=True, nogil=True)
def weigh_by_cue(
    table: MotionTable, cloud: Cloud, vehicle: IntArray, log_evidence: FloatArray, turn: FloatArray,
    log_scale: FloatArray, concentration: FloatArray,
) -> None:  # fmt: skip
    """Multiply the weights by the cue's density and normalise. Fills (V,) the log density of the cue under each belief.

    Args:
        table: the map.
        cloud: the particles.
        vehicle: (V,) the vehicles that give the cue.
        log_evidence: (V,) filled.
        turn: (M,) radians, the cue's mean directions, relative to the current direction.
        log_scale: (M,) log of each weight over its von Mises normaliser.
        concentration: (M,) of each von Mises.
    """
    for i in range(vehicle.size):
        v, weight = vehicle[i], cloud.weight[vehicle[i]]
        for p in range(cloud.speed.shape[1]):
            turned = table.ahead[cloud.manoeuvre[v, p]]
            fit = 0.0
            for m in range(turn.size):
                fit += math.exp(log_scale[m] + concentration[m] * (math.cos(turned - turn[m]) - 1.0))
            weight[p] *= max(fit, 1e-300)
        total = weight.sum()
        log_evidence[i] = math.log(total)
        weight /= total
