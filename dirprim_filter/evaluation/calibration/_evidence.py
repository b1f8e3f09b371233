"""Compiled: a Kalman filter over detections, whose innovations are their likelihood.

The state is the vehicle's place and velocity, its acceleration along and across the way, and the part of the error
that lasts along and across it.
"""

import math

import numpy as np
from numba import njit

from dirprim_filter.arrays import BoolArray, FloatArray
from tessellation._compiling import COMPILED

N = 8  # east, north, their rates, then along and across: acceleration, lasting error
ANYWHERE, ANY_VELOCITY = 1e4, 1e3
"""Variances, m^2 and (m/s)^2, of a place and a velocity that are not known."""


@njit(nogil=True, **COMPILED)
def log_likelihoods(
    time_s: FloatArray, position: FloatArray, along: FloatArray, known: BoolArray, model: FloatArray, scale: float,
    out: FloatArray,
) -> None:  # fmt: skip
    """Fills (w,): natural log of the density of each window's positions.

    Args:
        time_s: (w, n) seconds.
        position: (w, n, 2) metres.
        along: (w, n, 2) unit vectors of the course.
        known: (w, n) false after a window's end.
        model: (2, 5) of errors and accelerations along and across: variance that lasts, variance that does not, 1/s by
            which the former forgets, variance of the acceleration, 1/s by which that does.
        scale: factor of both variances of acceleration.
        out: (w,).
    """
    mean, p, ph = np.empty(N), np.empty((N, N)), np.empty((N, 2))
    for w in range(len(time_s)):
        begin(model, scale, mean, p)
        out[w] = correct(position[w, 0], along[w, 0], model, mean, p, ph)
        for i in range(1, known.shape[1]):
            if not known[w, i]:
                break
            advance(time_s[w, i] - time_s[w, i - 1], along[w, i - 1], model, scale, mean, p)
            out[w] += correct(position[w, i], along[w, i], model, mean, p, ph)


@njit(**COMPILED)
def begin(model: FloatArray, scale: float, mean: FloatArray, p: FloatArray) -> None:
    """Anywhere, at any velocity; acceleration and lasting error as they usually are."""
    for a in range(N):
        mean[a] = 0.0
        for b in range(N):
            p[a, b] = 0.0
    for a in range(2):
        p[a, a], p[2 + a, 2 + a] = ANYWHERE, ANY_VELOCITY
        p[4 + a, 4 + a], p[6 + a, 6 + a] = scale * model[a, 3], model[a, 0]


@njit(**COMPILED)
def advance(dt: float, unit: FloatArray, model: FloatArray, scale: float, mean: FloatArray, p: FloatArray) -> None:
    """By `dt` seconds, in which the acceleration is held, in the axes of the course at their beginning."""
    c, s, half = unit[0], unit[1], 0.5 * dt * dt
    for k in range(N):  # of rows
        at, across = p[4, k], p[5, k]
        east, north = c * at - s * across, s * at + c * across
        p[0, k] += dt * p[2, k] + half * east
        p[1, k] += dt * p[3, k] + half * north
        p[2, k] += dt * east
        p[3, k] += dt * north
    for k in range(N):  # and of columns
        at, across = p[k, 4], p[k, 5]
        east, north = c * at - s * across, s * at + c * across
        p[k, 0] += dt * p[k, 2] + half * east
        p[k, 1] += dt * p[k, 3] + half * north
        p[k, 2] += dt * east
        p[k, 3] += dt * north
    east, north = c * mean[4] - s * mean[5], s * mean[4] + c * mean[5]
    mean[0] += dt * mean[2] + half * east
    mean[1] += dt * mean[3] + half * north
    mean[2] += dt * east
    mean[3] += dt * north
    for a in range(2):
        for first, rate, variance in ((4, model[a, 4], scale * model[a, 3]), (6, model[a, 2], model[a, 0])):
            kept = math.exp(-rate * dt)
            mean[first + a] *= kept
            for k in range(N):
                p[first + a, k] *= kept
            for k in range(N):
                p[k, first + a] *= kept
            p[first + a, first + a] += variance * (1.0 - kept * kept)


@njit(**COMPILED)
def correct(
    z: FloatArray, unit: FloatArray, model: FloatArray, mean: FloatArray, p: FloatArray, ph: FloatArray
) -> float:
    """By one position; -> natural log of its density given those before it. `ph` is room for (N, 2) numbers."""
    c, s = unit[0], unit[1]
    for k in range(N):
        ph[k, 0] = p[k, 0] + c * p[k, 6] - s * p[k, 7]
        ph[k, 1] = p[k, 1] + s * p[k, 6] + c * p[k, 7]
    white, other = model[0, 1], model[1, 1]
    xx = ph[0, 0] + c * ph[6, 0] - s * ph[7, 0] + white * c * c + other * s * s
    xy = ph[0, 1] + c * ph[6, 1] - s * ph[7, 1] + (white - other) * c * s
    yy = ph[1, 1] + s * ph[6, 1] + c * ph[7, 1] + white * s * s + other * c * c
    dx = z[0] - mean[0] - c * mean[6] + s * mean[7]
    dy = z[1] - mean[1] - s * mean[6] - c * mean[7]
    determinant = xx * yy - xy * xy
    if not determinant > 0.0:
        return -np.inf
    ix, iy = (yy * dx - xy * dy) / determinant, (xx * dy - xy * dx) / determinant
    for a in range(N):
        mean[a] += ph[a, 0] * ix + ph[a, 1] * iy
        gx, gy = (yy * ph[a, 0] - xy * ph[a, 1]) / determinant, (xx * ph[a, 1] - xy * ph[a, 0]) / determinant
        for b in range(N):
            p[a, b] -= gx * ph[b, 0] + gy * ph[b, 1]
    return -0.5 * (math.log(determinant) + dx * ix + dy * iy) - math.log(2.0 * math.pi)
