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

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._arithmetic import dot
from dirprim_filter.distributions._elementary import exp, squared_sine
from dirprim_filter.filtering import _kernels
from dirprim_filter.filtering._innovation_outliers import DENSEST, LEAST_SHARE, PLACE_M, displace
from dirprim_filter.filtering._kernels import Cloud
from dirprim_filter.filtering._measuring import Noise, direction_fit, speed_fit, weigh_by, weigh_motion
from dirprim_filter.primitives._manoeuvres import MotionTable

X, Y, DIRECTION, SPEED = range(4)
COSINE, SINE = 2, 3
"""Rows of `off`, below metres along and across."""
COURSE_FROM, COURSE_UNTIL = 0.95, 0.7
"""Resultants of a belief's directions from which on it has a course, and below which it has none any more.

Were the bias in the axes of each particle for good, it would be a lever: what it swings across would tell the filter of
directions far more than a body's heading, smooth as it is, tells of the motion's noise in them.
"""


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
    has_course: BoolArray  # (V,) the particles agree on a course: the bias is in its axes, for all alike


@njit(cache=True, nogil=True)
def begin(
    table: MotionTable, cloud: Cloud, carried: Carried, vehicle: IntArray, measured: FloatArray, axes: Axes,
    spread: float,
) -> None:  # fmt: skip
    """Move particles drawn around measurements (V, 4) with an isotropic `spread` to where the errors put them."""
    along = math.sqrt(axes.correlated[0] + axes.white[0]) / spread
    across = math.sqrt(axes.correlated[1] + axes.white[1]) / spread
    share, share_across = correlated_share(axes, 0), correlated_share(axes, 1)
    for i in range(vehicle.size):
        v = vehicle[i]
        place, direction, mean = cloud.position[v], cloud.direction[v], carried.mean[v]
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
        carried.has_course[v] = False
    _kernels.initialise_motion(table, cloud, vehicle)


@njit(cache=True, inline="always")
def correlated_share(axes: Axes, a: int) -> float:
    """Of the variance along an axis."""
    return axes.correlated[a] / (axes.correlated[a] + axes.white[a])


@njit(cache=True, nogil=True, error_model="numpy")
def left_by(
    cloud: Cloud, carried: Carried, v: int, measured: FloatArray, axes: Axes, off: FloatArray, fit: FloatArray
) -> float:
    """What each particle's path and carried error leave of a measurement (4,).

    Fills off (4, P), metres along and across and the unit vector of each course, and fit (P,), the squares of the
    metres in their variances. Returns the density of no difference, 1/m2.
    """
    place, direction, mean = cloud.position[v], cloud.direction[v], carried.mean[v]
    x, y, since = measured[X], measured[Y], carried.since_s[v]
    kept, other = math.exp(-since * axes.forgets[0]), math.exp(-since * axes.forgets[1])
    s, s_across = error_variance(carried, v, axes, 0), error_variance(carried, v, axes, 1)
    bias, bias_across = axes.bias[0], axes.bias[1]
    precision, precision_across = 1.0 / s, 1.0 / s_across
    for p in range(direction.size):
        off[COSINE, p] = 1.0 - 2.0 * squared_sine(0.5 * direction[p])
        off[SINE, p] = 1.0 - 2.0 * squared_sine(0.5 * direction[p] - 0.25 * math.pi)
    if carried.has_course[v]:
        c, s = course_of(cloud.weight[v], off)
        x, y = x - (bias * c - bias_across * s), y - (bias * s + bias_across * c)
        bias = bias_across = 0.0
    for p in range(direction.size):
        dx, dy = x - place[p, 0], y - place[p, 1]
        off[0, p] = dx * off[COSINE, p] + dy * off[SINE, p] - bias - kept * mean[p, 0]
        off[1, p] = dy * off[COSINE, p] - dx * off[SINE, p] - bias_across - other * mean[p, 1]
    for p in range(direction.size):
        fit[p] = precision * off[0, p] * off[0, p] + precision_across * off[1, p] * off[1, p]
    return math.sqrt(precision * precision_across) / (2.0 * math.pi)


@njit(cache=True)
def course_of(weight: FloatArray, off: FloatArray) -> tuple[float, float]:
    """The unit vector of the belief's course; off (4, P) as `left_by` fills it."""
    c, s = dot(weight, off[COSINE]), dot(weight, off[SINE])
    length = max(math.hypot(c, s), 1e-9)
    return c / length, s / length


@njit(cache=True)
def update_course(cloud: Cloud, carried: Carried, v: int, axes: Axes, off: FloatArray) -> None:
    """Update whether particles agree on a course; where that changes, move them so that detections fit as before."""
    weight, place, had = cloud.weight[v], cloud.position[v], carried.has_course[v]
    resultant = math.hypot(dot(weight, off[COSINE]), dot(weight, off[SINE]))
    has = resultant >= (COURSE_UNTIL if had else COURSE_FROM)
    if has == had:
        return
    carried.has_course[v] = has
    c, s = course_of(weight, off)
    sign = 1.0 if has else -1.0
    for p in range(weight.size):
        dc, ds = sign * (off[COSINE, p] - c), sign * (off[SINE, p] - s)
        place[p, 0] += axes.bias[0] * dc - axes.bias[1] * ds
        place[p, 1] += axes.bias[0] * ds + axes.bias[1] * dc


@njit(cache=True, inline="always")
def expected(variance: float, kept: float, correlated: float) -> float:
    """Variance of a Gauss-Markov process of which a share has been kept."""
    return kept * kept * variance + (1.0 - kept * kept) * correlated


@njit(cache=True, inline="always")
def error_variance(carried: Carried, v: int, axes: Axes, a: int) -> float:
    """Of the difference that a particle's path and carried error leave of a measurement, along an axis."""
    kept = math.exp(-carried.since_s[v] * axes.forgets[a])
    return float(expected(carried.variance[v, a], kept, axes.correlated[a]) + axes.white[a])


@njit(cache=True, nogil=True, error_model="numpy")
def weigh(
    cloud: Cloud, carried: Carried, vehicle: IntArray, measured: FloatArray, share: FloatArray, evidence: FloatArray,
    axes: Axes, noise: Noise,
) -> None:  # fmt: skip
    """Weigh each vehicle's particles by its measurement (V, 4), and learn of the error that each carries.

    A `share` (V,) are innovation outliers a priori. Fills (V, 2) as `_measuring.weigh`. A measurement that the belief
    as a whole calls an outlier tells nothing of the carried error.
    """
    n = cloud.position.shape[1]
    fit, off, before = np.empty(n), np.empty((4, n)), np.empty(n)
    for i in range(vehicle.size):
        v = vehicle[i]
        for p in range(n):
            before[p] = cloud.weight[v, p]
        scale = noise.kept * left_by(cloud, carried, v, measured[i], axes, off, fit)
        weigh_by(
            cloud.weight[v], cloud.direction[v], cloud.speed[v], fit, scale, measured[i, DIRECTION],
            measured[i, SPEED], noise, evidence[i],
        )  # fmt: skip
        is_explained = evidence[i, 1] >= math.log(2.0 * noise.outlier)
        if is_explained and math.exp(evidence[i, 1]) * LEAST_SHARE < share[i] * DENSEST:
            weigh_outliers(cloud, carried, v, before, measured[i], share[i], axes, noise, off, fit)
        learn(carried, v, axes, off, is_explained)
        update_course(cloud, carried, v, axes, off)


@njit(cache=True, error_model="numpy")
def weigh_outliers(
    cloud: Cloud, carried: Carried, v: int, before: FloatArray, measured: FloatArray, share: float, axes: Axes,
    noise: Noise, off: FloatArray, fit: FloatArray,
) -> None:  # fmt: skip
    """Weigh a vehicle's particles, of weights `before`, as `_innovation_outliers.weigh` does; `off` is what is left."""
    scale, k = noise.kept * left_by(cloud, carried, v, measured, axes, off, fit), PLACE_M * PLACE_M
    s, s_across = error_variance(carried, v, axes, 0), error_variance(carried, v, axes, 1)
    gain, gain_across = k / (k + s), k / (k + s_across)
    far_scale = share * noise.kept / (2.0 * math.pi * math.sqrt((k + s) * (k + s_across)))
    weight, state = cloud.weight[v], cloud.state[v].copy()
    for p in range(weight.size):
        ordinary = (1.0 - share) * (scale * exp(-0.5 * fit[p]) + noise.outlier)
        far = far_scale * exp(-0.5 * (gain * off[0, p] * off[0, p] + gain_across * off[1, p] * off[1, p]) / k)
        both = ordinary + far
        weight[p] = before[p] * both if both < np.inf else 0.0
        if random.uniform(state) * both < far:
            ahead = gain * off[0, p] + math.sqrt(gain * s) * random.draw_normal(state)
            aside = gain_across * off[1, p] + math.sqrt(gain_across * s_across) * random.draw_normal(state)
            off[0, p] -= ahead
            off[1, p] -= aside
            east = ahead * off[COSINE, p] - aside * off[SINE, p]
            displace(cloud, v, p, east, ahead * off[SINE, p] + aside * off[COSINE, p], state)
    for word in range(state.size):
        cloud.state[v, word] = state[word]
    weigh_motion(cloud, v, measured[DIRECTION], measured[SPEED], noise)


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
    fit, off = np.empty(n), np.empty((4, n))
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
        total = dot(cloud.weight[v], fit)
        out[i] = math.log(total * scale) - 0.5 * nearest if total > 0.0 else -np.inf
