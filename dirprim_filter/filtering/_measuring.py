"""Compiled likelihoods: particles against measured positions, directions and speeds, each of which may be an outlier.

Arguments shared by all vehicles come as one `Noise`; those of one vehicle come as a row of `measured`: x, y, the
inverse covariance xx, xy, yy, the log of its normaliser, direction, speed; NaN where not measured.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions._arithmetic import dot, total_of
from dirprim_filter.distributions._elementary import exp, log, squared_sine
from dirprim_filter.filtering._kernels import Cloud

X, Y, XX, XY, YY, LOG_NORMAL, DIRECTION, SPEED = range(8)
LEAST = 1e-200
"""Weight below which a particle has none: far above the subnormal numbers, with which processors are slow."""


class Noise(NamedTuple):
    """Densities of measurement errors: (1 - e) of a Gaussian or von Mises, e of an outlier.

    Those of course and speed are ratios to the densities of a false detection's, 1/(2 pi) and 1/`FASTEST`.
    """

    outlier: float  # per square metre
    kept: float  # 1 less the probability of an outlier
    direction_concentration: float
    direction_scale: float
    direction_outlier: float
    speed_precision: float  # (s/m)^2
    speed_scale: float
    speed_outlier: float


@njit(cache=True, inline="always")
def direction_fit(noise: Noise, direction: float, course: float) -> float:
    """Density of a measured course, over that of a false detection's."""
    agreed = noise.direction_concentration * squared_sine(0.5 * (direction - course))
    return float(noise.direction_scale * exp(-2.0 * agreed) + noise.direction_outlier)


@njit(cache=True, inline="always")
def speed_fit(noise: Noise, speed: float, pace: float) -> float:
    """Density of a measured speed, likewise."""
    off = speed - pace
    return float(noise.speed_scale * exp(-0.5 * noise.speed_precision * off * off) + noise.speed_outlier)


@njit(cache=True, inline="always")
def log_motion_fit(noise: Noise, direction: float, speed: float, course: float, pace: float) -> float:
    """Natural log of that of a measured course and pace; 0 of what is not measured."""
    fit = 1.0
    if not math.isnan(course):
        fit *= direction_fit(noise, direction, course)
    if not math.isnan(pace):
        fit *= speed_fit(noise, speed, pace)
    return float(log(fit))


@njit(cache=True, nogil=True, error_model="numpy")
def weigh(cloud: Cloud, vehicle: IntArray, measured: FloatArray, evidence: FloatArray, noise: Noise) -> None:
    """Weigh each vehicle's particles by its measurement; normalise.

    Fills (V, 2): the log density of the measurement given those before it, and that of its position alone. Loops are
    kept apart, and without branches, so that they are compiled to vector instructions.
    """
    n = cloud.position.shape[1]
    fit = np.empty(n)
    for i in range(vehicle.size):
        weight, place = cloud.weight[vehicle[i]], cloud.position[vehicle[i]]
        direction, speed = cloud.direction[vehicle[i]], cloud.speed[vehicle[i]]
        x, y, xx, xy, yy = measured[i, X], measured[i, Y], measured[i, XX], measured[i, XY], measured[i, YY]
        course, pace = measured[i, DIRECTION], measured[i, SPEED]
        scale = noise.kept * math.exp(measured[i, LOG_NORMAL])
        for p in range(n):
            dx, dy = place[p, 0] - x, place[p, 1] - y
            fit[p] = dx * (xx * dx + 2.0 * xy * dy) + yy * dy * dy
        weigh_by(weight, direction, speed, fit, scale, course, pace, noise, evidence[i])


@njit(cache=True, nogil=True, error_model="numpy")
def weigh_by(
    weight: FloatArray, direction: FloatArray, speed: FloatArray, fit: FloatArray, scale: float, course: float,
    pace: float, noise: Noise, evidence: FloatArray,
) -> None:  # fmt: skip
    """Weigh (P,) particles by the squared distances `fit`, which are lost, and by a course and a pace; normalise.

    `scale` is the density of no distance, 1/m2. Fills the evidence as `weigh`.
    """
    n = weight.size
    for p in range(n):
        density = scale * exp(-0.5 * fit[p]) + noise.outlier
        fit[p] = density if fit[p] < np.inf else 0.0  # it has run off to where there are no numbers
    near = dot(weight, fit)
    if not math.isnan(course):
        for p in range(n):
            fit[p] *= direction_fit(noise, direction[p], course)
    if not math.isnan(pace):
        for p in range(n):
            fit[p] *= speed_fit(noise, speed[p], pace)
    total = dot(weight, fit)
    evidence[0] = math.log(total) if total > 0.0 else -np.inf  # no particle has a weight
    evidence[1] = math.log(near) if near > 0.0 else -np.inf
    if total > 0.0:
        for p in range(n):
            later = weight[p] * fit[p] / total
            weight[p] = later if later > LEAST else 0.0


@njit(cache=True)
def weigh_motion(cloud: Cloud, v: int, course: float, pace: float, noise: Noise) -> None:
    """Weigh the particles of a vehicle by a measured course and pace; normalise."""
    weight, direction, speed = cloud.weight[v], cloud.direction[v], cloud.speed[v]
    if not math.isnan(course):
        for p in range(weight.size):
            weight[p] *= direction_fit(noise, direction[p], course)
    if not math.isnan(pace):
        for p in range(weight.size):
            weight[p] *= speed_fit(noise, speed[p], pace)
    total = total_of(weight)
    for p in range(weight.size):
        weight[p] /= total


@njit(cache=True, nogil=True)
def weigh_at_birth(cloud: Cloud, vehicle: IntArray, measured: FloatArray, spread: FloatArray, noise: Noise) -> None:
    """Correct particles drawn around a position with an isotropic `spread` (V,) to what was measured; normalise."""
    log_fit = np.empty(cloud.weight.shape[1])
    for i in range(vehicle.size):
        weight, place = cloud.weight[vehicle[i]], cloud.position[vehicle[i]]
        direction, speed = cloud.direction[vehicle[i]], cloud.speed[vehicle[i]]
        top = -np.inf
        for p in range(weight.size):
            dx, dy = place[p, 0] - measured[i, X], place[p, 1] - measured[i, Y]
            distance = measured[i, XX] * dx * dx + 2.0 * measured[i, XY] * dx * dy + measured[i, YY] * dy * dy
            log_fit[p] = -0.5 * (distance - (dx * dx + dy * dy) / (spread[i] * spread[i]))
            log_fit[p] += log_motion_fit(noise, direction[p], speed[p], measured[i, DIRECTION], measured[i, SPEED])
            top = max(top, log_fit[p])
        for p in range(weight.size):
            weight[p] = math.exp(log_fit[p] - top)
        weight /= weight.sum()


@njit(cache=True, nogil=True)
def log_likelihood(cloud: Cloud, vehicle: IntArray, measured: FloatArray, result: FloatArray, noise: Noise) -> None:
    """Fills (V,) the log density of each measurement under the belief, outlying positions aside."""
    for i in range(vehicle.size):
        weight, place = cloud.weight[vehicle[i]], cloud.position[vehicle[i]]
        direction, speed = cloud.direction[vehicle[i]], cloud.speed[vehicle[i]]
        course, pace = measured[i, DIRECTION], measured[i, SPEED]
        is_moving = not (math.isnan(course) and math.isnan(pace))
        total = 0.0
        for p in range(weight.size):
            dx, dy = place[p, 0] - measured[i, X], place[p, 1] - measured[i, Y]
            distance = measured[i, XX] * dx * dx + 2.0 * measured[i, XY] * dx * dy + measured[i, YY] * dy * dy
            if distance < 100.0:
                log_fit = -0.5 * distance
                if is_moving:
                    log_fit += log_motion_fit(noise, direction[p], speed[p], course, pace)
                total += weight[p] * math.exp(log_fit)
        result[i] = measured[i, LOG_NORMAL] + math.log(total) if total > 0.0 else -np.inf
