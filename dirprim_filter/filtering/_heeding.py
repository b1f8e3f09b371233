"""Compiled: particles weighed by what a vehicle tells of where it will turn (Senanayake et al. 2020, Eq. 4).

p_t is the cue, a mixture of von Mises over the direction some seconds later relative to the one now; p_0 is what the
particles are about to do: the journeys that they follow, or the mean directions of their modes.
"""

import math

from numba import njit

from dirprim_filter.filtering._kernels import Cloud
from dirprim_filter.filtering._relaxing import MotionTable, offset_in
from dirprim_filter.primitives._likening import DURATION, NO_ROW, TURN, JourneyTable
from tessellation.arrays import FloatArray, IntArray


@njit(cache=True)
def turn_ahead(journeys: JourneyTable, row: int, since: float, ahead_s: float) -> float:
    """Radians by which a journey's direction differs `ahead_s` later, or at its end; turns add up, full ones too."""
    r = row if row > NO_ROW else -2 - row
    left, turned = ahead_s, 0.0
    while left > 0.0 and journeys.row[r, DURATION] > 0.0:
        lasts = min(left, journeys.row[r, DURATION] - since)
        turned += journeys.row[r, TURN] * lasts
        left -= lasts
        since = 0.0
        r += 1
    return turned


@njit(cache=True, nogil=True)
def heed(
    table: MotionTable, cloud: Cloud, vehicle: IntArray, log_evidence: FloatArray, turn: FloatArray,
    log_scale: FloatArray, concentration: FloatArray, ahead_s: float,
) -> None:  # fmt: skip
    """Weigh by a cue; normalise. Fills (V,) the log density of the cue under each belief.

    Args:
        table: the map.
        cloud: the particles.
        vehicle: (V,) which.
        log_evidence: (V,) is filled.
        turn: (M,) radians, the cue's mean directions relative to the one now.
        log_scale: (M,) log of weight over what normalises each.
        concentration: (M,) of each.
        ahead_s: how much later the vehicle will have turned.
    """
    for i in range(vehicle.size):
        v, weight = vehicle[i], cloud.weight[vehicle[i]]
        for p in range(cloud.speed.shape[1]):
            row = cloud.row[v, p]
            if row != NO_ROW:
                turned = turn_ahead(table.journeys, row, cloud.since[v, p], ahead_s)
            else:
                cell, mode = cloud.cell[v, p], cloud.mode[v, p]
                east, north = offset_in(table, cell, cloud.position[v, p, 0], cloud.position[v, p, 1])
                turned = table.mean[cell, mode] - cloud.direction[v, p]
                turned += table.bend[cell, mode, 0] * east + table.bend[cell, mode, 1] * north
                if not table.draws[cell, mode]:
                    turned = 0.0
            fit = 0.0
            for m in range(turn.size):
                fit += math.exp(log_scale[m] + concentration[m] * (math.cos(turned - turn[m]) - 1.0))
            weight[p] *= max(fit, 1e-300)
        total = weight.sum()
        log_evidence[i] = math.log(total)
        weight /= total
