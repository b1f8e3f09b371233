"""Compiled likelihoods of detections whose errors are biased, correlated, and different along and across the direction.

Each particle carries the correlated part of the error in closed form: given the particle's path it is a first-order
Gauss-Markov process, measured in white noise along each axis of the vehicle by what the path leaves of the detections.
So its mean follows by a scalar Kalman filter for each axis, and its variance is the same for all particles of a belief,
for it depends on times alone. That is Rao-Blackwellisation: samples of the error would need more particles by its two
directions, and would degenerate, since no measurement distinguishes them within a correlation time.

Source: Doucet, de Freitas, Murphy and Russell, Rao-Blackwellised Particle Filtering, 2000; Bar-Shalom, Li and
Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 8, for the state augmented by it.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._elementary import exp, squared_sine
from dirprim_filter.filtering import _kernels
from dirprim_filter.filtering._kernels import Cloud, effective_sample_size, mean_of, systematic
from dirprim_filter.filtering._measuring import LEAST, Noise, direction_fit, speed_fit
from dirprim_filter.primitives._manoeuvres import MotionTable

X, Y, DIRECTION, SPEED = range(4)


class Axes(NamedTuple):
    """A sensor's errors along and across the direction of travel, as variances in square metres."""

    bias: tuple[float, float]
    correlated: tuple[float, float]
    white: tuple[float, float]
    forgets: tuple[float, float]  # 1/s, the inverse of the correlation time


class Carried(NamedTuple):
    """The correlated part of every belief's error."""

    mean: FloatArray  # (V, P, 2) metres along and across, given the particle's path
    variance: FloatArray  # (V, 2) of that
    since_s: FloatArray  # (V,) since both held


@njit(cache=True, nogil=True)
def begin(
    table: MotionTable, cloud: Cloud, carried: Carried, vehicle: IntArray, measured: FloatArray, axes: Axes,
    spread: float,
) -> None:  # fmt: skip
    """Move particles drawn around measurements (V, 4) with an isotropic `spread` to where the errors put them."""
    for i in range(vehicle.size):
        v = vehicle[i]
        place, direction, mean = cloud.position[v], cloud.direction[v], carried.mean[v]
        along = math.sqrt(axes.correlated[0] + axes.white[0]) / spread
        across = math.sqrt(axes.correlated[1] + axes.white[1]) / spread
        share = axes.correlated[0] / (axes.correlated[0] + axes.white[0])
        share_across = axes.correlated[1] / (axes.correlated[1] + axes.white[1])
        for p in range(direction.size):
            c, s = math.cos(direction[p]), math.sin(direction[p])
            dx, dy = measured[i, X] - place[p, 0], measured[i, Y] - place[p, 1]
            ahead, aside = along * (dx * c + dy * s), across * (dy * c - dx * s)
            mean[p, 0], mean[p, 1] = share * ahead, share_across * aside
            ahead, aside = ahead + axes.bias[0], aside + axes.bias[1]
            place[p, 0] = measured[i, X] - (ahead * c - aside * s)
            place[p, 1] = measured[i, Y] - (ahead * s + aside * c)
        carried.variance[v, 0] = share * axes.white[0]
        carried.variance[v, 1] = share_across * axes.white[1]
        carried.since_s[v] = 0.0
    _kernels.initialise_motion(table, cloud, vehicle)


@njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")
def left_by(
    cloud: Cloud, carried: Carried, v: int, measured: FloatArray, axes: Axes, off: FloatArray, fit: FloatArray
) -> float:
    """What each particle's path and carried error leave of a measurement (4,).

    Fills off (2, P), metres along and across, and fit (P,), the squares of them in their variances. Returns the density
    of no difference, 1/m2.
    """
    place, direction, mean = cloud.position[v], cloud.direction[v], carried.mean[v]
    x, y, since = measured[X], measured[Y], carried.since_s[v]
    kept, other = math.exp(-since * axes.forgets[0]), math.exp(-since * axes.forgets[1])
    s = expected(carried.variance[v, 0], kept, axes.correlated[0]) + axes.white[0]
    s_across = expected(carried.variance[v, 1], other, axes.correlated[1]) + axes.white[1]
    bias, bias_across = axes.bias[0], axes.bias[1]
    precision, precision_across = 1.0 / s, 1.0 / s_across
    for p in range(direction.size):
        cosine = 1.0 - 2.0 * squared_sine(0.5 * direction[p])
        sine = 1.0 - 2.0 * squared_sine(0.5 * direction[p] - 0.25 * math.pi)
        dx, dy = x - place[p, 0], y - place[p, 1]
        off[0, p] = dx * cosine + dy * sine - bias - kept * mean[p, 0]
        off[1, p] = dy * cosine - dx * sine - bias_across - other * mean[p, 1]
    for p in range(direction.size):
        fit[p] = precision * off[0, p] * off[0, p] + precision_across * off[1, p] * off[1, p]
    return 1.0 / (2.0 * math.pi * math.sqrt(s * s_across))


@njit(cache=True, inline="always")
def expected(variance: float, kept: float, correlated: float) -> float:
    """Variance of a Gauss-Markov process of which a share has been kept."""
    return kept * kept * variance + (1.0 - kept * kept) * correlated


@njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")
def weigh(
    cloud: Cloud, carried: Carried, vehicle: IntArray, measured: FloatArray, evidence: FloatArray, axes: Axes,
    noise: Noise,
) -> None:  # fmt: skip
    """Weigh each vehicle's particles by its measurement (V, 4), and learn of the error that each carries.

    Fills (V, 2) as `_measuring.weigh`. A measurement that the belief as a whole calls an outlier does not update the
    carried error.
    """
    n = cloud.position.shape[1]
    fit, off = np.empty(n), np.empty((2, n))
    for i in range(vehicle.size):
        v = vehicle[i]
        weight, direction, speed = cloud.weight[v], cloud.direction[v], cloud.speed[v]
        course, pace = measured[i, DIRECTION], measured[i, SPEED]
        scale = noise.kept * left_by(cloud, carried, v, measured[i], axes, off, fit)
        for p in range(n):
            density = scale * exp(-0.5 * fit[p]) + noise.outlier
            fit[p] = density if fit[p] < np.inf else 0.0
        near = mean_of(weight, fit, 1.0)
        if not math.isnan(course):
            for p in range(n):
                fit[p] *= direction_fit(noise, direction[p], course)
        if not math.isnan(pace):
            for p in range(n):
                fit[p] *= speed_fit(noise, speed[p], pace)
        total = mean_of(weight, fit, 1.0)
        evidence[i, 0] = math.log(total) if total > 0.0 else -np.inf
        evidence[i, 1] = math.log(near) if near > 0.0 else -np.inf
        if total > 0.0:
            for p in range(n):
                later = weight[p] * fit[p] / total
                weight[p] = later if later > LEAST else 0.0
        learn(carried, v, axes, off, near >= 2.0 * noise.outlier)


@njit(cache=True, nogil=True)
def learn(carried: Carried, v: int, axes: Axes, off: FloatArray, is_explained: bool) -> None:
    """The carried error at the measurement's time, and corrected by what is left of it where the belief explains it."""
    for a in range(2):
        kept = math.exp(-carried.since_s[v] * axes.forgets[a])
        variance = expected(carried.variance[v, a], kept, axes.correlated[a])
        gain = variance / (variance + axes.white[a]) if is_explained else 0.0
        carried.variance[v, a] = (1.0 - gain) * variance
        for p in range(off.shape[1]):
            carried.mean[v, p, a] = kept * carried.mean[v, p, a] + gain * off[a, p]
    carried.since_s[v] = 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def log_likelihood(
    cloud: Cloud, carried: Carried, vehicle: IntArray, measured: FloatArray, out: FloatArray, axes: Axes, noise: Noise
) -> None:
    """Fills (V,): natural log of the density of each measurement (V, 4) under the belief, outliers aside."""
    n = cloud.position.shape[1]
    fit, off = np.empty(n), np.empty((2, n))
    for i in range(vehicle.size):
        v = vehicle[i]
        scale = left_by(cloud, carried, v, measured[i], axes, off, fit)
        nearest = fit.min()
        for p in range(n):
            density = exp(-0.5 * (fit[p] - nearest))
            if not math.isnan(measured[i, DIRECTION]):
                density *= direction_fit(noise, cloud.direction[v, p], measured[i, DIRECTION])
            if not math.isnan(measured[i, SPEED]):
                density *= speed_fit(noise, cloud.speed[v, p], measured[i, SPEED])
            fit[p] = density
        total = mean_of(cloud.weight[v], fit, 1.0)
        out[i] = math.log(total * scale) - 0.5 * nearest if total > 0.0 else -np.inf


@njit(cache=True, nogil=True)
def resample(cloud: Cloud, carried: Carried, vehicle: IntArray, below: float) -> None:
    """`_kernels.resample`, with the error that each survivor carries.

    A copy that is put beside its survivor carries the error that leaves the detections where they were.
    """
    n = cloud.position.shape[1]
    survivors, parent, place = np.empty(n, np.int64), np.empty(n, np.int64), np.empty((n, 2))
    for i in range(vehicle.size):
        v = vehicle[i]
        if effective_sample_size(cloud.weight[v]) >= below:
            continue
        systematic(cloud.weight[v], random.uniform(cloud.state[v].copy()), survivors)  # the very draw it will make
        free = 0
        for a in range(n):
            if survivors[a] > 0:
                parent[a] = a
            for _ in range(survivors[a] - 1):
                while survivors[free] > 0:
                    free += 1
                parent[free] = a
                free += 1
        place[:] = cloud.position[v]
        _kernels.resample(cloud, vehicle[i : i + 1], below)
        mean, direction = carried.mean[v], cloud.direction[v]
        for p in range(n):
            if parent[p] != p:
                dx = cloud.position[v, p, 0] - place[parent[p], 0]
                dy = cloud.position[v, p, 1] - place[parent[p], 1]
                c, s = math.cos(direction[p]), math.sin(direction[p])
                mean[p, 0] = mean[parent[p], 0] - (dx * c + dy * s)
                mean[p, 1] = mean[parent[p], 1] - (dy * c - dx * s)
