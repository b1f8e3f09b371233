"""Compiled fitting of every cell's modes: direction by von Mises (Eq. 1), speed by gamma (Eq. 3).

A cell's rows stand together; responsibilities are made and summed row by row, so no (rows x modes) array exists.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dirprim_filter.distributions import _kernels as density
from tessellation.arrays import BoolArray, FloatArray, IntArray

MAX_ITERATIONS = 200
TOLERANCE = 1e-7  # of the mean log likelihood per row
N_SUMS = 5  # responsibility, cosine, sine, speed, log speed
N_CURVED_SUMS = 16  # and the moments that bend and gain need


class Rows(NamedTuple):
    """Observations of moving vehicles, sorted by cell and, inside a cell, by direction."""

    direction: FloatArray
    cosine: FloatArray
    sine: FloatArray
    speed: FloatArray
    log_speed: FloatArray
    weight: FloatArray
    east: FloatArray  # metres from the centre of the cell
    north: FloatArray


class Bounds(NamedTuple):
    """Priors and bounds of a fit; see `config.LearningConfig`."""

    max_modes: int
    prior_strength: float
    speed_spread: float  # log(mean) - mean(log) of the place-free speeds
    max_concentration: float
    max_shape: float
    dbscan_eps: float
    dbscan_share: float
    bend_scale: float  # rad/m, standard deviation of a bend before it is seen
    gain_scale: float  # 1/m, likewise of a gain
    curved: bool  # whether modes may bend


class Modes(NamedTuple):
    """Parameters of a cell's modes, a row for each cell or, inside a cell, a number for each mode."""

    weight: FloatArray
    mean: FloatArray
    concentration: FloatArray
    shape: FloatArray
    rate: FloatArray
    bend_east: FloatArray  # rad/m, how the mean direction turns across the cell
    bend_north: FloatArray
    gain_east: FloatArray  # 1/m, how the logarithm of the mean speed grows across the cell
    gain_north: FloatArray


@njit(cache=True, nogil=True)
def fit_cells_at_once(rows: Rows, start: IntArray, n_vehicles: FloatArray, bounds: Bounds, out: Modes) -> None:
    """Direction and speed together, modes by BIC; cell c has rows start[c] to start[c + 1]. Fills the rows of `out`."""
    for c in range(n_vehicles.size):
        if start[c + 1] > start[c]:
            fit_at_once(slice_rows(rows, start[c], start[c + 1]), n_vehicles[c], bounds, mode_row(out, c))


@njit(cache=True)
def slice_rows(rows: Rows, first: int, last: int) -> Rows:
    return Rows(
        rows.direction[first:last],
        rows.cosine[first:last],
        rows.sine[first:last],
        rows.speed[first:last],
        rows.log_speed[first:last],
        rows.weight[first:last],
        rows.east[first:last],
        rows.north[first:last],
    )


@njit(cache=True)
def mode_row(modes: Modes, c: int) -> Modes:
    return Modes(
        modes.weight[c],
        modes.mean[c],
        modes.concentration[c],
        modes.shape[c],
        modes.rate[c],
        modes.bend_east[c],
        modes.bend_north[c],
        modes.gain_east[c],
        modes.gain_north[c],
    )


@njit(cache=True)
def empty_modes(n: int) -> Modes:
    """Room for n modes, of weight 0."""
    zeros, ones = np.zeros((7, n)), np.ones((2, n))
    return Modes(zeros[0], zeros[1], zeros[2], ones[0], ones[1], zeros[3], zeros[4], zeros[5], zeros[6])


@njit(cache=True)
def total_of(values: FloatArray) -> float:
    """The sum; a loop compiles ten times as fast as numpy's."""
    total = 0.0
    for value in values:
        total += value
    return total


@njit(cache=True)
def fit_at_once(rows: Rows, n_vehicles: float, bounds: Bounds, out: Modes) -> None:
    """Joint EM of direction and speed, flat and curved, with the number of modes that BIC prefers."""
    best = np.inf
    for k in range(1, bounds.max_modes + 1):
        if k > n_vehicles:
            break
        trial = empty_modes(k)
        start_evenly(rows, trial, bounds)
        lowest = np.inf
        for stage in range(1 + bounds.curved):  # flat, and curved from there on
            log_likelihood = expectation_maximisation(rows, n_vehicles, True, stage == 1, bounds, trial)
            bic = bayesian_information(log_likelihood, rows, n_vehicles, (5 + 4 * stage) * k - 1)
            lowest = min(lowest, bic)
            if bic < best:
                best = bic
                copy_modes(trial, out)
        if k > 2 and lowest > best + 20.0:  # far past the best: more modes only cost more
            break


@njit(cache=True)
def bayesian_information(log_likelihood: float, rows: Rows, n_vehicles: float, n_parameters: int) -> float:
    """BIC; rows of one vehicle repeat each other, so it counts vehicles: the likelihood is scaled from rows to them."""
    return -2.0 * log_likelihood / total_of(rows.weight) * n_vehicles + n_parameters * math.log(max(n_vehicles, 2.0))


@njit(cache=True)
def copy_modes(source: Modes, target: Modes) -> None:
    """Fill `target` with the modes of `source`, and with nothing beyond them."""
    for m in range(target.weight.size):
        target.weight[m] = 0.0
    for m in range(source.weight.size):
        target.weight[m] = source.weight[m]
        target.mean[m] = source.mean[m]
        target.concentration[m] = source.concentration[m]
        target.shape[m] = source.shape[m]
        target.rate[m] = source.rate[m]
        target.bend_east[m] = source.bend_east[m]
        target.bend_north[m] = source.bend_north[m]
        target.gain_east[m] = source.gain_east[m]
        target.gain_north[m] = source.gain_north[m]


@njit(cache=True)
def start_evenly(rows: Rows, modes: Modes, bounds: Bounds) -> None:
    """Modes at even quantiles of the circle, cut at its widest gap."""
    n, k = rows.direction.size, modes.weight.size
    theta = rows.direction
    cut, widest = 0, theta[0] + density.TWO_PI - theta[n - 1]
    for i in range(1, n):
        if theta[i] - theta[i - 1] > widest:
            cut, widest = i, theta[i] - theta[i - 1]
    speed = 0.0
    for i in range(n):
        speed += rows.weight[i] * rows.speed[i]
    mean_speed = speed / total_of(rows.weight)
    shape = density.gamma_shape(bounds.speed_spread, 1.0, bounds.max_shape)
    for m in range(k):
        modes.weight[m] = 1.0 / k
        modes.mean[m] = theta[(cut + int((m + 0.5) * n / k)) % n]
        modes.concentration[m] = 1.0 * k * k
        modes.shape[m] = shape
        modes.rate[m] = shape / mean_speed


@njit(cache=True)
def expectation_maximisation(
    rows: Rows, n_vehicles: float, with_speed: bool, curved: bool, bounds: Bounds, modes: Modes
) -> float:
    """EM in log space from the modes given, in place; returns the log likelihood of the last E-step."""
    k = modes.weight.size
    total = total_of(rows.weight)
    previous = -np.inf
    for _ in range(MAX_ITERATIONS):
        sums = np.zeros((k, N_CURVED_SUMS if curved else N_SUMS))
        log_likelihood = expectation(rows, with_speed, curved, modes, sums)
        if log_likelihood - previous < TOLERANCE * total:
            return log_likelihood
        previous = log_likelihood
        maximisation(sums, total, n_vehicles, bounds, modes)
        if curved:
            bend(sums, total, n_vehicles, bounds, modes)
    return previous


@njit(cache=True)
def expectation(rows: Rows, with_speed: bool, curved: bool, modes: Modes, sums: FloatArray) -> float:
    """Add every row's weighted responsibilities to `sums` (k, N_SUMS); returns the log likelihood.

    Directions and speeds are taken back to the centre of the cell, along the mode's bend and gain, before they are
    summed: so what follows is the same for flat modes and for curved ones.
    """
    k = modes.weight.size
    constant, cosine, sine = np.empty(k), np.empty(k), np.empty(k)
    for m in range(k):
        cosine[m], sine[m] = math.cos(modes.mean[m]), math.sin(modes.mean[m])
        constant[m] = -np.inf
        if modes.weight[m] > 0.0:
            constant[m] = math.log(modes.weight[m]) - density.log_normaliser(modes.concentration[m])
            if with_speed:
                constant[m] += modes.shape[m] * math.log(modes.rate[m]) - math.lgamma(modes.shape[m])
    log_p = np.empty(k)
    at_centre = np.empty((k, 4))  # cosine, sine, speed, log speed
    log_likelihood = 0.0
    for i in range(rows.direction.size):
        c, s, v, log_v, w = rows.cosine[i], rows.sine[i], rows.speed[i], rows.log_speed[i], rows.weight[i]
        top = -np.inf
        for m in range(k):
            c0, s0, v0, log_v0, gained = c, s, v, log_v, 0.0
            if curved:
                turned = modes.bend_east[m] * rows.east[i] + modes.bend_north[m] * rows.north[i]
                gained = modes.gain_east[m] * rows.east[i] + modes.gain_north[m] * rows.north[i]
                cos_turned, sin_turned = math.cos(turned), math.sin(turned)
                c0, s0 = c * cos_turned + s * sin_turned, s * cos_turned - c * sin_turned
                v0, log_v0 = v * math.exp(-gained), log_v - gained
            at_centre[m, 0], at_centre[m, 1], at_centre[m, 2], at_centre[m, 3] = c0, s0, v0, log_v0
            log_p[m] = constant[m] + modes.concentration[m] * (cosine[m] * c0 + sine[m] * s0 - 1.0)
            if with_speed:
                # The density of v, not of v0: hence the gain once more, as Jacobian.
                log_p[m] += (modes.shape[m] - 1.0) * log_v0 - modes.rate[m] * v0 - gained
            top = max(top, log_p[m])
        norm = 0.0
        for m in range(k):
            log_p[m] = math.exp(log_p[m] - top)
            norm += log_p[m]
        log_likelihood += w * (top + math.log(norm))
        for m in range(k):
            r = w * log_p[m] / norm
            sums[m, 0] += r
            for q in range(4):
                sums[m, 1 + q] += r * at_centre[m, q]
            if curved:
                _add_slopes(sums[m], r, at_centre[m], cosine[m], sine[m], modes, m, rows.east[i], rows.north[i])
    return log_likelihood


@njit(cache=True)
def _add_slopes(
    sums: FloatArray,
    r: float,
    at_centre: FloatArray,
    cosine: float,
    sine: float,
    modes: Modes,
    m: int,
    east: float,
    north: float,
) -> None:
    """The normal equations of bend and gain: moments of the place, and their products with the two scores."""
    turn = at_centre[1] * cosine - at_centre[0] * sine  # sine of the deviation
    gain = at_centre[2] * modes.rate[m] / modes.shape[m] - 1.0
    sums[5] += r * east
    sums[6] += r * north
    sums[7] += r * east * east
    sums[8] += r * east * north
    sums[9] += r * north * north
    sums[10] += r * turn
    sums[11] += r * turn * east
    sums[12] += r * turn * north
    sums[13] += r * gain
    sums[14] += r * gain * east
    sums[15] += r * gain * north


@njit(cache=True)
def bend(sums: FloatArray, total: float, n_vehicles: float, bounds: Bounds, modes: Modes) -> None:
    """A step of Fisher scoring for each mode's bend and gain, with the prior that there is none (Fisher and Lee 1992).

    `maximisation` has found the means without the step; they move with it where the rows are not around the centre.
    """
    for m in range(modes.weight.size):
        if sums[m, 0] / total * n_vehicles < 1e-3:
            continue
        scale = n_vehicles / total  # rows of one vehicle repeat each other
        east, north = sums[m, 5] / sums[m, 0], sums[m, 6] / sums[m, 0]
        k = modes.concentration[m]
        if k > density.NEGLIGIBLE_CONCENTRATION:
            information = k * density.i1e(k) / density.i0e(k) * scale
            d_east, d_north = _slope(
                sums[m], 10, k * scale, information, bounds.bend_scale, modes.bend_east[m], modes.bend_north[m]
            )
            modes.bend_east[m] += d_east
            modes.bend_north[m] += d_north
            modes.mean[m] -= d_east * east + d_north * north
        a = modes.shape[m] * scale
        d_east, d_north = _slope(sums[m], 13, a, a, bounds.gain_scale, modes.gain_east[m], modes.gain_north[m])
        modes.gain_east[m] += d_east
        modes.gain_north[m] += d_north
        modes.rate[m] *= math.exp(d_east * east + d_north * north)


@njit(cache=True)
def _slope(
    sums: FloatArray, at: int, score: float, information: float, prior: float, east: float, north: float
) -> tuple[float, float]:
    """The slope of weighted least squares on (1, east, north) with a ridge on the slope; the mean is profiled out."""
    n, sx, sy = sums[0], sums[5], sums[6]
    ridge = 1.0 / (prior * prior)
    xx = information * (sums[7] - sx * sx / n) + ridge
    xy = information * (sums[8] - sx * sy / n)
    yy = information * (sums[9] - sy * sy / n) + ridge
    bx = score * (sums[at + 1] - sx * sums[at] / n) - ridge * east
    by = score * (sums[at + 2] - sy * sums[at] / n) - ridge * north
    determinant = xx * yy - xy * xy
    return (yy * bx - xy * by) / determinant, (xx * by - xy * bx) / determinant


@njit(cache=True)
def maximisation(sums: FloatArray, total: float, n_vehicles: float, bounds: Bounds, modes: Modes) -> None:
    """New parameters from the sums, each mode with its pseudo-vehicles of the prior."""
    for m in range(modes.weight.size):
        share = sums[m, 0] / total
        if share * n_vehicles < 1e-3:  # a mode that no vehicle drives
            modes.weight[m] = 0.0
            continue
        modes.weight[m] = share
        n = share * n_vehicles
        modes.mean[m] = math.atan2(sums[m, 2], sums[m, 1])
        resultant = math.hypot(sums[m, 1], sums[m, 2]) / sums[m, 0] * n / (n + bounds.prior_strength)
        modes.concentration[m] = min(density.concentration_of(resultant), bounds.max_concentration)
        mean_speed = sums[m, 3] / sums[m, 0]
        spread = max(math.log(mean_speed) - sums[m, 4] / sums[m, 0], 0.0)
        spread = (n * spread + bounds.prior_strength * bounds.speed_spread) / (n + bounds.prior_strength)
        modes.shape[m] = density.gamma_shape(spread, 1.0, bounds.max_shape)
        modes.rate[m] = modes.shape[m] / mean_speed
    norm = total_of(modes.weight)
    for m in range(modes.weight.size):
        modes.weight[m] /= norm


@njit(cache=True, nogil=True)
def thin(vehicle: IntArray, time_ns: IntArray, interval_ns: int) -> BoolArray:
    """Which rows to keep, sorted by vehicle and time, so that a vehicle's are at least `interval_ns` apart."""
    keep = np.zeros(vehicle.size, np.bool_)
    last = -1
    for i in range(vehicle.size):
        if last < 0 or vehicle[i] != vehicle[last] or time_ns[i] - time_ns[last] >= interval_ns:
            keep[i] = True
            last = i
    return keep
