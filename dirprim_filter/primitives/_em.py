"""The two steps of EM: every row's responsibilities, summed as the maximisation needs them, and modes from these sums.

Rows go through in blocks, mode by mode, in loops that compile to vector instructions: no (rows x modes) array exists.
What is climbed is the log likelihood, scaled from rows to vehicles, plus the log prior of the modes: in each mode
`prior_strength` pseudo-vehicles of the usual spreads of direction and of speed, and normal slopes around 0.
"""

import math

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions._arithmetic import dot, fma, weighted_sums
from dirprim_filter.distributions._elementary import cos, exp, log, sin
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
    COSINE,
    EAST,
    GAIN_EAST,
    GAIN_NORTH,
    LOG_CONCENTRATION,
    LOG_MEAN_SPEED,
    LOG_SHAPE,
    LOG_SPEED,
    LOG_WEIGHT,
    MEAN,
    N_OF_ROW,
    NO_MODE,
    NORTH,
    SINE,
    SPEED,
    WEIGHT,
    Bounds,
)
from tessellation._compiling import compiled, uncounted

SUMS = 5  # responsibility, cosine, sine, speed, log speed
CURVED_SUMS = 16  # and the moments that bend and gain need
REST = 4  # rows of the room beside those of modes
BLOCK = 256  # rows: what is kept of a block stays in the nearest cache
MOST_LOG_SPEED = 20.0
"""Of a mode's mean at the centre of its cell: its slope may say anything where no row is."""
MIN_VEHICLES = 1e-3
"""A mode that fewer drive is given up."""


@compiled
def expectation(
    columns: FloatArray, at: int, n: int, with_speed: bool, table: FloatArray, room: FloatArray, sums: FloatArray
) -> float:
    """Fill `sums` (k, SUMS or CURVED_SUMS) with the weighted responsibilities of n columns from `at` on.

    Directions and speeds are taken back to the centre of the cell, along the mode's bend and gain, before they are
    summed: so what follows is the same for flat modes and for curved ones.

    Returns:
        The log likelihood.
    """
    k, curved = sums.shape[0], sums.shape[1] == CURVED_SUMS
    factor = np.empty((k, 8))  # of 1, cosine, sine, log speed and speed in the log density; for the slopes' scores
    factor[:], sums[:] = 0.0, 0.0
    for m in range(k):
        cosine, sine = math.cos(table[m, MEAN]), math.sin(table[m, MEAN])
        concentration = math.expm1(table[m, LOG_CONCENTRATION])
        factor[m, 0] = table[m, LOG_WEIGHT] - log_normaliser(table[m, LOG_CONCENTRATION]) - concentration
        factor[m, 1], factor[m, 2] = concentration * cosine, concentration * sine
        factor[m, 5], factor[m, 6], factor[m, 7] = cosine, sine, math.exp(-table[m, LOG_MEAN_SPEED])
        if with_speed:
            shape = math.exp(table[m, LOG_SHAPE])
            factor[m, 0] += shape * (1.0 - table[m, LOG_MEAN_SPEED]) - gamma_remainder(table[m, LOG_SHAPE])
            factor[m, 3], factor[m, 4] = shape - 1.0, -shape * factor[m, 7]
    rest, p = room[:REST], room[REST : REST + k]
    log_likelihood = 0.0
    for first in range(at, at + n, BLOCK):
        size = min(BLOCK, at + n - first)
        for m in range(k):
            rows, start = columns, first
            if curved:
                rows, start = room[REST + k + m * N_OF_ROW : REST + k + (m + 1) * N_OF_ROW], 0
                _take_back(columns, first, table[m], size, rows)
            _log_density(factor[m], rows, start, columns[LOG_SPEED][first:], size, p[m])
        log_likelihood += _normalise(p, columns[WEIGHT][first:], size, rest)
        for m in range(k):
            rows, start = columns, first
            if curved:
                rows, start = room[REST + k + m * N_OF_ROW : REST + k + (m + 1) * N_OF_ROW], 0
            _sum(p[m], rows, start, columns, first, size, factor[m], rest, sums[m])
    return log_likelihood


@uncounted
def _log_density(
    factor: FloatArray, rows: FloatArray, first: int, log_seen: FloatArray, n: int, out: FloatArray
) -> None:
    """Linear in what a row holds. The density is that of the speed seen, hence the gain since then as Jacobian."""
    f0, f1, f2, f3, f4 = factor[0], factor[1], factor[2], factor[3], factor[4]
    c, s, log_v, v = rows[COSINE][first:], rows[SINE][first:], rows[LOG_SPEED][first:], rows[SPEED][first:]
    for i in range(n):
        of_direction = fma(f1, c[i], fma(f2, s[i], f0))
        out[i] = fma(f3, log_v[i], fma(f4, v[i], of_direction)) + (log_v[i] - log_seen[i])


@uncounted
def _take_back(columns: FloatArray, first: int, mode: FloatArray, n: int, out: FloatArray) -> None:
    """Rows as they would be at the centre of the cell, if they followed the mode."""
    bend_east, bend_north, gain_east, gain_north = mode[BEND_EAST], mode[BEND_NORTH], mode[GAIN_EAST], mode[GAIN_NORTH]
    c, s, v, log_v = columns[COSINE][first:], columns[SINE][first:], columns[SPEED][first:], columns[LOG_SPEED][first:]
    east, north = columns[EAST][first:], columns[NORTH][first:]
    cosine, sine, speed, log_speed = out[COSINE], out[SINE], out[SPEED], out[LOG_SPEED]
    for i in range(n):
        cosine[i] = cos(fma(bend_east, east[i], bend_north * north[i]))
    for i in range(n):
        sine[i] = sin(fma(bend_east, east[i], bend_north * north[i]))
    for i in range(n):
        cos_turned, sin_turned = cosine[i], sine[i]
        cosine[i] = fma(c[i], cos_turned, s[i] * sin_turned)
        sine[i] = fma(s[i], cos_turned, -c[i] * sin_turned)
    for i in range(n):
        log_speed[i] = log_v[i] - fma(gain_east, east[i], gain_north * north[i])
    for i in range(n):
        speed[i] = v[i] * exp(log_speed[i] - log_v[i])


@uncounted
def _normalise(p: FloatArray, w: FloatArray, n: int, rest: FloatArray) -> float:
    """Turn log densities (k, n) into weighted responsibilities; returns the weighted log likelihood."""
    top, norm = rest[0], rest[1]
    for i in range(n):
        top[i] = p[0, i]
        norm[i] = 0.0
    for m in range(1, p.shape[0]):
        for i in range(n):
            top[i] = p[m, i] if p[m, i] > top[i] else top[i]
    for m in range(p.shape[0]):
        for i in range(n):
            p[m, i] = exp(p[m, i] - top[i])
        for i in range(n):
            norm[i] += p[m, i]
    for i in range(n):
        top[i] += log(norm[i])
    for i in range(n):
        norm[i] = w[i] / norm[i]
    for m in range(p.shape[0]):
        for i in range(n):
            p[m, i] *= norm[i]
    return dot(w[:n], top[:n])


@uncounted
def _sum(
    r: FloatArray, rows: FloatArray, start: int, columns: FloatArray, first: int, n: int, factor: FloatArray,
    rest: FloatArray, sums: FloatArray,
) -> None:  # fmt: skip
    """Add what the maximisation needs of some rows, and of curved modes the normal equations of bend and gain.

    These are moments of the place, and their products with the two scores.
    """
    r, end = r[:n], start + n
    c, s, v, log_v = rows[COSINE][start:end], rows[SINE][start:end], rows[SPEED][start:end], rows[LOG_SPEED][start:end]
    of_row = weighted_sums(r, (c, s, v, log_v))
    for k in range(SUMS):
        sums[k] += of_row[k]
    if sums.size == SUMS:
        return
    east, north = columns[EAST][first : first + n], columns[NORTH][first : first + n]
    cos_mean, sin_mean, per_mean_speed = factor[5], factor[6], factor[7]
    x, y, turn, gain = rest[0, :n], rest[1, :n], rest[2, :n], rest[3, :n]
    for i in range(n):
        x[i], y[i] = r[i] * east[i], r[i] * north[i]
        turn[i] = fma(s[i], cos_mean, -c[i] * sin_mean)  # sine of the deviation
        gain[i] = fma(v[i], per_mean_speed, -1.0)
    total_x, xx, xy, turned_x, gained_x = weighted_sums(x, (east, north, turn, gain))
    total_y, yy, turned_y, gained_y = weighted_sums(y, (north, turn, gain))
    _, turned, gained = weighted_sums(r, (turn, gain))
    of_place = total_x, total_y, xx, xy, yy, turned, turned_x, turned_y, gained, gained_x, gained_y
    for k in range(CURVED_SUMS - SUMS):
        sums[SUMS + k] += of_place[k]


@compiled
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


@compiled
def usual_log_density(log_concentration: float, log_shape: float, bounds: Bounds) -> float:
    """In a mode, of one usual vehicle, up to a constant: a log a - log Gamma(a) = a - remainder."""
    k, a = math.expm1(log_concentration), math.exp(log_shape)
    of_direction = k * (bounds.usual_resultant - 1.0) - log_normaliser(log_concentration)
    return of_direction - gamma_remainder(log_shape) - a * bounds.speed_spread


@compiled
def log_prior(bounds: Bounds, usual: float, table: FloatArray) -> float:
    """Log prior of the modes that are driven, in vehicles; 0 for the usual spreads of direction and of speed.

    usual: the greatest `usual_log_density`.
    """
    total = 0.0
    for m in range(table.shape[0]):
        if table[m, LOG_WEIGHT] > NO_MODE / 2:
            less = usual_log_density(table[m, LOG_CONCENTRATION], table[m, LOG_SHAPE], bounds) - usual
            bends = (table[m, BEND_EAST] ** 2 + table[m, BEND_NORTH] ** 2) / bounds.bend_scale**2
            gains = (table[m, GAIN_EAST] ** 2 + table[m, GAIN_NORTH] ** 2) / bounds.gain_scale**2
            total += bounds.prior_strength * less - 0.5 * (bends + gains)
    return total


@compiled
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


@compiled
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
