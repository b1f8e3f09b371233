"""Compiled densities of rows in cells that need not be their own."""

import math

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions._elementary import EXACT, cos, exp

CONSTANT, WEIGHT, MEAN, CONCENTRATION, SHAPE, RATE, BEND_EAST, BEND_NORTH, GAIN_EAST, GAIN_NORTH = range(10)
"""Columns of a mode; the first is what its log density has that depends on no row."""
LEAST_SPEED = 1e-3
"""m/s; slower rows are taken for so fast, for at 0 a gamma's density is 0 or without bound."""
_LOG_TWO_PI = math.log(2.0 * math.pi)


@njit(nogil=True, **EXACT)
def log_densities(
    table: FloatArray,
    standing: FloatArray,
    standing_rate: float,
    center: FloatArray,
    place_free_share: FloatArray,
    place_free: FloatArray,
    position: FloatArray,
    direction: FloatArray,
    speed: FloatArray,
    row: IntArray,
    cell: IntArray,
    out: FloatArray,
) -> None:
    """Fill `out` with the log density of direction and speed of row[p] in cell[p].

    table: (n_cells, K, 10) modes in motion; place_free: (n,) the place-free log density of each row.
    """
    log_p = np.empty(table.shape[1])
    for p in range(row.size):
        i, c = row[p], cell[p]
        east, north = position[i, 0] - center[c, 0], position[i, 1] - center[c, 1]
        v = max(speed[i], LEAST_SPEED)
        log_v = math.log(v)
        top, n = -np.inf, 0
        for m in range(table.shape[1]):
            mode = table[c, m]
            if mode[WEIGHT] > 0.0:
                off = direction[i] - mode[MEAN] - mode[BEND_EAST] * east - mode[BEND_NORTH] * north
                gained = mode[GAIN_EAST] * east + mode[GAIN_NORTH] * north
                log_p[n] = (
                    mode[CONSTANT]
                    + mode[CONCENTRATION] * (cos(off) - 1.0)
                    + (mode[SHAPE] - 1.0) * log_v
                    - mode[SHAPE] * gained
                    - mode[RATE] * v * math.exp(-gained)
                )
                top = max(top, log_p[n])
                n += 1
        if top == -np.inf:  # far from the cell every mode's speed may have run out of the numbers there are
            n = 0
        moving = 0.0
        for m in range(n):
            moving += exp(log_p[m] - top)
        still = standing[c] * standing_rate * math.exp(-standing_rate * v - _LOG_TWO_PI)
        share = place_free_share[c]
        rest = share * math.exp(place_free[i]) + (1.0 - share) * still
        log_moving, log_rest = -np.inf, math.log(max(rest, 1e-300))
        if n > 0 and share < 1.0 and standing[c] < 1.0:
            log_moving = math.log((1.0 - share) * (1.0 - standing[c]) * moving) + top
        high = max(log_moving, log_rest)
        out[p] = high + math.log(math.exp(log_moving - high) + math.exp(log_rest - high))
