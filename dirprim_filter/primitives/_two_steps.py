"""Compiled fitting by the paper's recipe: modes counted on directions alone, and speeds fitted when directions are.

Source: Senanayake et al. 2020, section III.
"""

import math

import numpy as np
from numba import njit

from dirprim_filter.distributions import _kernels as density
from dirprim_filter.primitives import _kernels
from dirprim_filter.primitives._kernels import Bounds, Modes, Rows
from tessellation.arrays import FloatArray, IntArray


@njit(cache=True, nogil=True)
def fit_cells_in_two_steps(rows: Rows, start: IntArray, n_vehicles: FloatArray, bounds: Bounds, out: Modes) -> None:
    """The paper's recipe, modes by DBSCAN and directions before speeds; else as `fit_cells_at_once`."""
    for c in range(n_vehicles.size):
        if start[c + 1] > start[c]:
            fit_in_two_steps(
                _kernels.slice_rows(rows, start[c], start[c + 1]), n_vehicles[c], bounds, _kernels.mode_row(out, c)
            )


@njit(cache=True)
def fit_in_two_steps(rows: Rows, n_vehicles: float, bounds: Bounds, out: Modes) -> None:
    """The paper's recipe: DBSCAN for the number of modes, EM on directions, then a gamma for each mode."""
    n = rows.direction.size
    label = np.empty(n, np.int64)
    min_samples = max(3, math.ceil(bounds.dbscan_share * n))
    k = density.dbscan_sorted(rows.direction, np.arange(n), bounds.dbscan_eps, min_samples, label)
    k = min(max(k, 1), bounds.max_modes)
    trial = _kernels.empty_modes(k)
    _kernels.start_evenly(rows, trial, bounds)
    sums = np.zeros((k, _kernels.N_SUMS))
    for i in range(n):
        if 0 <= label[i] < k:
            m, w = label[i], rows.weight[i]
            sums[m, 0] += w
            sums[m, 1] += w * rows.cosine[i]
            sums[m, 2] += w * rows.sine[i]
            sums[m, 3] += w * rows.speed[i]
            sums[m, 4] += w * rows.log_speed[i]
    if sums[:, 0].min() > 0.0:
        _kernels.maximisation(sums, sums[:, 0].sum(), n_vehicles, bounds, trial)
    _kernels.expectation_maximisation(rows, n_vehicles, False, False, bounds, trial)
    for m in range(k):
        _gamma_within_two_deviations(rows, bounds, trial, m)
    _kernels.copy_modes(trial, out)


@njit(cache=True)
def _gamma_within_two_deviations(rows: Rows, bounds: Bounds, modes: Modes, m: int) -> None:
    """Eq. 3: maximum likelihood on rows within two circular standard deviations, sqrt(-2 log R), of the mode.

    The shape's bias is reduced as Anderson and Ray (1975) do: a (n - 3) / n + 2 / (3 n).
    """
    resultant = density.i1e(modes.concentration[m]) / density.i0e(modes.concentration[m])
    reach = 2.0 * math.sqrt(-2.0 * math.log(max(resultant, 1e-12)))
    near = math.cos(min(reach, math.pi))
    cosine, sine = math.cos(modes.mean[m]), math.sin(modes.mean[m])
    count, weight, speed, log_speed = 0, 0.0, 0.0, 0.0
    for i in range(rows.direction.size):
        if rows.cosine[i] * cosine + rows.sine[i] * sine >= near:
            count += 1
            weight += rows.weight[i]
            speed += rows.weight[i] * rows.speed[i]
            log_speed += rows.weight[i] * rows.log_speed[i]
    if count < 4:  # too few to tell a spread: the one that EM's last step left
        return
    mean_speed = speed / weight
    shape = density.gamma_shape(math.log(mean_speed) - log_speed / weight, 1.0, bounds.max_shape)
    modes.shape[m] = min(max(shape * (count - 3) / count + 2.0 / (3.0 * count), 1.0), bounds.max_shape)
    modes.rate[m] = modes.shape[m] / mean_speed
