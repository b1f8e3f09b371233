"""Compiled fitting by the paper's recipe: modes counted on directions alone, and speeds fitted when directions are.

Source: Senanayake et al. 2020, section III.
"""

import math

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions import _kernels as density
from dirprim_filter.distributions._elementary import EXACT
from dirprim_filter.primitives._ascent import ascend
from dirprim_filter.primitives._expectation import SUMS
from dirprim_filter.primitives._kernels import ON_CIRCLE, sort_around, start_evenly
from dirprim_filter.primitives._maximisation import maximisation
from dirprim_filter.primitives._modes import (
    COSINE,
    LOG_CONCENTRATION,
    LOG_MEAN_SPEED,
    LOG_SHAPE,
    LOG_SPEED,
    MEAN,
    SINE,
    SPEED,
    WEIGHT,
    Bounds,
)


@njit(nogil=True, **EXACT)
def fit_cells_in_two_steps(
    columns: FloatArray,
    start: IntArray,
    n_vehicles: FloatArray,
    bounds: Bounds,
    first: int,
    last: int,
    out: FloatArray,
) -> None:
    """The paper's recipe, modes by DBSCAN and directions before speeds; else as `fit_cells_at_once`.

    Columns stand for one row each, and in each cell in order of their directions.
    """
    for c in range(first, last):
        fit_in_two_steps(columns, start[c], start[c + 1] - start[c], n_vehicles[c], bounds, out[c])


@njit(**EXACT)
def fit_in_two_steps(columns: FloatArray, at: int, n: int, n_vehicles: float, bounds: Bounds, out: FloatArray) -> None:
    """The paper's recipe: DBSCAN for the number of modes, EM on directions, then a gamma for each mode."""
    filled = np.empty((3, ON_CIRCLE))
    used, total, mean_speed = sort_around(columns, at, n, filled)
    if mean_speed == 0.0:
        return
    theta, index, label = np.zeros(n), np.zeros(n, np.int64), np.zeros(n, np.int64)
    for i in range(n):
        theta[i], index[i] = math.atan2(columns[SINE, at + i], columns[COSINE, at + i]), i
    min_samples = max(3, math.ceil(bounds.dbscan_share * n))
    k = density.dbscan_sorted(theta, index, bounds.dbscan_eps, min_samples, label)
    k = min(max(k, 1), bounds.max_modes)
    table = out[:k]
    start_evenly(filled, used, total, mean_speed, bounds, table)
    sums = np.zeros((k, SUMS))
    for i in range(n):
        if 0 <= label[i] < k:
            m, w = label[i], columns[WEIGHT, at + i]
            sums[m, 0] += w
            sums[m, 1] += w * columns[COSINE, at + i]
            sums[m, 2] += w * columns[SINE, at + i]
            sums[m, 3] += w * columns[SPEED, at + i]
            sums[m, 4] += w * columns[LOG_SPEED, at + i]
    least = np.inf
    for m in range(k):
        least = min(least, sums[m, 0])
    if least > 0.0:
        maximisation(sums, n_vehicles, bounds, table)
    ascend(columns, at, n, n_vehicles, bounds.curved, -np.inf, 0.0, bounds, table)
    for m in range(k):
        _gamma_within_two_deviations(columns, at, n, bounds, table[m])


@njit(**EXACT)
def _gamma_within_two_deviations(columns: FloatArray, at: int, n: int, bounds: Bounds, mode: FloatArray) -> None:
    """Eq. 3: maximum likelihood on rows within two circular standard deviations, sqrt(-2 log R), of the mode.

    The shape's bias is reduced as Anderson and Ray (1975) do: a (n - 3) / n + 2 / (3 n).
    """
    concentration = math.expm1(mode[LOG_CONCENTRATION])
    resultant = density.i1e(concentration) / density.i0e(concentration)
    reach = 2.0 * math.sqrt(-2.0 * math.log(max(resultant, 1e-12)))
    near = math.cos(min(reach, math.pi))
    cosine, sine = math.cos(mode[MEAN]), math.sin(mode[MEAN])
    count, weight, speed, log_speed = 0, 0.0, 0.0, 0.0
    for i in range(at, at + n):
        if columns[COSINE, i] * cosine + columns[SINE, i] * sine >= near:
            count += 1
            weight += columns[WEIGHT, i]
            speed += columns[WEIGHT, i] * columns[SPEED, i]
            log_speed += columns[WEIGHT, i] * columns[LOG_SPEED, i]
    if count < 4:  # too few to estimate a spread: keep that of EM's last step
        return
    log_mean = math.log(speed / weight)
    shape = density.gamma_shape(log_mean - log_speed / weight, 1.0, bounds.max_shape)
    mode[LOG_SHAPE] = math.log(min(max(shape * (count - 3) / count + 2.0 / (3.0 * count), 1.0), bounds.max_shape))
    mode[LOG_MEAN_SPEED] = log_mean
