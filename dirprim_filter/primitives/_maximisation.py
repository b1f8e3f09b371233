"""The maximisation step: modes from sums of responsibilities, and the objective that it climbs.

The objective is the log likelihood, scaled from rows to vehicles, plus the log prior of the modes: in each mode
`prior_strength` pseudo-vehicles of the usual spreads of direction and of speed, and normal slopes around 0.
"""

import math

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions._elementary import EXACT
from dirprim_filter.distributions._estimates import (
    NEGLIGIBLE_CONCENTRATION,
    concentration_from,
    gamma_remainder,
    log_normaliser,
    resultant_of,
    shape_from,
)
from dirprim_filter.primitives._modes import (
    BEND_EAST,
    BEND_NORTH,
    GAIN_EAST,
    GAIN_NORTH,
    LOG_CONCENTRATION,
    LOG_MEAN_SPEED,
    LOG_SHAPE,
    LOG_WEIGHT,
    MEAN,
    NO_MODE,
    Bounds,
)

MOST_LOG_SPEED = 20.0
"""Of a mode's mean at the centre of its cell: its slope may say anything where no row is."""
MIN_VEHICLES = 1e-3
"""A mode that fewer drive is given up."""


@njit(**EXACT)
def maximisation(sums: FloatArray, n_vehicles: float, bounds: Bounds, table: FloatArray) -> int:
    """New parameters from the sums, each mode with its pseudo-vehicles of the prior; slopes stay.

    Returns:
        How many modes are driven.
    """
    k, driven = sums.shape[0], 0
    total, kept = 0.0, 0.0
    for m in range(k):
        total += sums[m, 0]
    for m in range(k):
        n = sums[m, 0] / total * n_vehicles
        if n < MIN_VEHICLES:
            table[m, LOG_WEIGHT] = NO_MODE
            continue
        driven += 1
        kept += sums[m, 0]
        own = n / (n + bounds.prior_strength)
        table[m, LOG_WEIGHT] = math.log(sums[m, 0])
        table[m, MEAN] = math.atan2(sums[m, 2], sums[m, 1])
        resultant = own * math.hypot(sums[m, 1], sums[m, 2]) / sums[m, 0] + (1.0 - own) * bounds.usual_resultant
        concentration = concentration_from(resultant)
        table[m, LOG_CONCENTRATION] = math.log1p(min(concentration, bounds.max_concentration))
        log_mean = math.log(sums[m, 3] / sums[m, 0])
        spread = max(log_mean - sums[m, 4] / sums[m, 0], 0.0)
        spread = own * spread + (1.0 - own) * bounds.speed_spread
        table[m, LOG_SHAPE] = math.log(shape_from(spread, bounds.max_shape))
        table[m, LOG_MEAN_SPEED] = log_mean
    for m in range(k):
        if table[m, LOG_WEIGHT] != NO_MODE:
            table[m, LOG_WEIGHT] -= math.log(kept)
    return driven


@njit(**EXACT)
def usual_log_density(bounds: Bounds) -> float:
    """The greatest that `_in_usual` is, for the usual spreads of direction and of speed."""
    shape, concentration = shape_from(bounds.speed_spread, bounds.max_shape), concentration_from(bounds.usual_resultant)
    return _in_usual(math.log1p(concentration), math.log(shape), bounds)


@njit(**EXACT)
def _in_usual(log_concentration: float, log_shape: float, bounds: Bounds) -> float:
    """Log density in a mode of one usual vehicle, up to a constant: a log a - log Gamma(a) = a - remainder."""
    k, a = math.expm1(log_concentration), math.exp(log_shape)
    of_direction = k * (bounds.usual_resultant - 1.0) - log_normaliser(log_concentration)
    return of_direction - gamma_remainder(log_shape) - a * bounds.speed_spread


@njit(**EXACT)
def log_prior(bounds: Bounds, usual: float, table: FloatArray) -> float:
    """Log prior of the modes that are driven, in vehicles; 0 for the usual spreads of direction and of speed.

    usual: `usual_log_density`.
    """
    total = 0.0
    for m in range(table.shape[0]):
        if table[m, LOG_WEIGHT] > NO_MODE / 2:
            less = _in_usual(table[m, LOG_CONCENTRATION], table[m, LOG_SHAPE], bounds) - usual
            bends = (table[m, BEND_EAST] ** 2 + table[m, BEND_NORTH] ** 2) / bounds.bend_scale**2
            gains = (table[m, GAIN_EAST] ** 2 + table[m, GAIN_NORTH] ** 2) / bounds.gain_scale**2
            total += bounds.prior_strength * less - 0.5 * (bends + gains)
    return total


@njit(**EXACT)
def bend(sums: FloatArray, scale: float, bounds: Bounds, table: FloatArray) -> None:
    """A step of Fisher scoring for each mode's bend and gain, with the prior that there is none (Fisher and Lee 1992).

    `maximisation` has found the means without the step; they move with it where the rows are not around the centre.
    `scale` is vehicles per row: rows of one vehicle repeat each other.
    """
    for m in range(table.shape[0]):
        if table[m, LOG_WEIGHT] < NO_MODE / 2:
            continue
        k = math.expm1(table[m, LOG_CONCENTRATION])
        if k > NEGLIGIBLE_CONCENTRATION:
            information = k * resultant_of(table[m, LOG_CONCENTRATION]) * scale
            at, slope = np.int64(10), np.int64(BEND_EAST)  # literals would compile `_slope` twice
            table[m, MEAN] -= _slope(sums[m], at, k * scale, information, bounds.bend_scale, table[m], slope)
        a = math.exp(table[m, LOG_SHAPE]) * scale
        at, slope = np.int64(13), np.int64(GAIN_EAST)
        table[m, LOG_MEAN_SPEED] -= _slope(sums[m], at, a, a, bounds.gain_scale, table[m], slope)
        table[m, LOG_MEAN_SPEED] = min(max(table[m, LOG_MEAN_SPEED], -MOST_LOG_SPEED), MOST_LOG_SPEED)


@njit(**EXACT)
def _slope(
    sums: FloatArray, at: int, score: float, information: float, prior: float, mode: FloatArray, slope: int
) -> float:
    """Step to the slope of weighted least squares on (1, east, north) with a ridge; the mean is profiled out.

    Returns:
        What the step adds where the rows are.
    """
    n, sx, sy = sums[0], sums[5], sums[6]
    ridge = 1.0 / (prior * prior)
    xx = information * (sums[7] - sx * sx / n) + ridge
    xy = information * (sums[8] - sx * sy / n)
    yy = information * (sums[9] - sy * sy / n) + ridge
    bx = score * (sums[at + 1] - sx * sums[at] / n) - ridge * mode[slope]
    by = score * (sums[at + 2] - sy * sums[at] / n) - ridge * mode[slope + 1]
    determinant = xx * yy - xy * xy
    east, north = (yy * bx - xy * by) / determinant, (xx * by - xy * bx) / determinant
    mode[slope] += east
    mode[slope + 1] += north
    return (east * sx + north * sy) / n
