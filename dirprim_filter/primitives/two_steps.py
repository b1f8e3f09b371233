"""The paper's recipe for the modes of a cell: counted on directions alone, and speeds fitted when directions are.

Source: Senanayake et al. 2020, section III; Anderson and Ray, Improved maximum likelihood estimators for the gamma
distribution, 1975.
"""

from __future__ import annotations

import math

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions import von_mises
from dirprim_filter.distributions._estimates import shape_from
from dirprim_filter.distributions.modes import dbscan
from dirprim_filter.primitives._ascent import ascend
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


def fit_in_two_steps(columns: FloatArray, n_vehicles: float, bounds: Bounds, out: FloatArray) -> None:
    """DBSCAN for the number of modes, EM on directions, then a gamma for each mode.

    Args:
        columns: (N_COLUMNS, n) a column for each of the cell's rows.
        n_vehicles: that they are of.
        bounds: priors and bounds.
        out: (max_modes, N_CURVED) is filled.
    """
    n, filled = columns.shape[1], np.empty((3, ON_CIRCLE))
    used, total, mean_speed = sort_around(columns, 0, n, filled)
    if mean_speed == 0.0:
        return
    share = max(3, math.ceil(bounds.dbscan_share * n))
    label = dbscan(np.arctan2(columns[SINE], columns[COSINE]), eps=bounds.dbscan_eps, min_samples=share)
    k = min(max(int(label.max()) + 1, 1), bounds.max_modes)
    table = out[:k]
    start_evenly(filled, used, total, mean_speed, bounds, table)
    one = np.vstack([np.ones(n), columns[[COSINE, SINE, SPEED, LOG_SPEED]]])
    sums = np.stack([(one * (columns[WEIGHT] * (label == m))).sum(axis=1) for m in range(k)])
    if sums[:, 0].min() > 0.0:
        maximisation(sums, n_vehicles, bounds, table)
    ascend(columns, 0, n, n_vehicles, bounds.curved, -np.inf, 0.0, bounds, table)
    for mode in table:
        _fit_speeds(columns, bounds, mode)


def _fit_speeds(columns: FloatArray, bounds: Bounds, mode: FloatArray) -> None:
    """Eq. 3: maximum likelihood on rows within two circular standard deviations, sqrt(-2 log R), of the mode.

    The shape's bias is reduced as Anderson and Ray (1975) do: a (n - 3) / n + 2 / (3 n).
    """
    resultant = float(von_mises.mean_resultant_length(np.expm1(mode[LOG_CONCENTRATION])))
    reach = 2.0 * math.sqrt(-2.0 * math.log(max(resultant, 1e-12)))
    along = columns[COSINE] * math.cos(mode[MEAN]) + columns[SINE] * math.sin(mode[MEAN])
    near = columns[:, along >= math.cos(min(reach, math.pi))]
    n = near.shape[1]
    if n < 4:  # too few to estimate a spread: keep that of EM's last step
        return
    weight = near[WEIGHT] / near[WEIGHT].sum()
    log_mean = math.log(weight @ near[SPEED])
    shape = shape_from(log_mean - weight @ near[LOG_SPEED], bounds.max_shape) * (n - 3) / n + 2.0 / (3.0 * n)
    mode[LOG_SHAPE] = math.log(min(max(shape, 1.0), bounds.max_shape))
    mode[LOG_MEAN_SPEED] = log_mean
