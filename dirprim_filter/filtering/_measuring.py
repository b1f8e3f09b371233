"""Compiled: particles against measured positions, directions and speeds, each of which may be an outlier.

A measurement leaves each particle a residual along two axes, with a variance along each. The axes are those of the
measurement's covariance, or each particle's own, along and across its direction, where a sensor errs so. Part of a
sensor's error lasts: given the particle's path it is a first-order Gauss-Markov process, measured in white noise by
what the path leaves of the detections. Each particle *carries* its mean, by a scalar Kalman filter for each axis; its
variance is the same for all particles of a belief, for it depends on times alone (Rao-Blackwellisation). White errors
are the case in which nothing is carried.

A particle that stands two metres beyond where its vehicle stopped stays there, and so do all others: they are equally
far off, so none is preferred. But now and then a vehicle leaves its motion model: an *innovation outlier* puts it off
by a Gaussian of `PLACE_M` in each axis, and its speed by one of `SPEED_OFF` that goes with how far it is ahead. A
particle is weighed by the mixture (1 - e) N(z; x, R) + e N(z; x, R + PLACE_M^2), and is drawn from the second part
given the measurement as often as that part weighs. A belief that is sure and wrong then takes a few measurements to
mend.

Source: Doucet, de Freitas, Murphy and Russell, Rao-Blackwellised Particle Filtering, 2000; Bar-Shalom, Li and
Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 8, for the state augmented by the
error; Fox, Outliers in time series, 1972, for innovation outliers, against additive ones, which are a sensor's; Liu and
Chen, Sequential Monte Carlo methods for dynamic systems, 1998, for drawing from a transition given the measurement.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._arithmetic import dot
from dirprim_filter.distributions._elementary import cos, exp, sin, squared_sine, wrap
from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.filtering._conditioning import Measured, draw_given
from dirprim_filter.filtering._errors import (
    AXIS,
    COSINE,
    COURSE,
    PACE,
    SINE,
    WHITE,
    Errors,
    X,
    Y,
    course_of,
    lasting_share,
    lasting_variance,
    learn,
)  # fmt: skip
from dirprim_filter.filtering._kernels import Carried, Cloud
from dirprim_filter.primitives import _map_kernels
from dirprim_filter.primitives._manoeuvres import STANDING_BELOW
from dirprim_filter.primitives._map_kernels import MapTable

LEAST = 1e-200
"""Weight below which a particle has none: far above the subnormal numbers, with which processors are slow."""
PLACE_M, SPEED_OFF, TOGETHER = 1.0, 2.0, 0.7
"""Metres, m/s, and their correlation: an acceleration of 2 m/s^2 beside the model's, for a second."""
LEAST_SHARE = 0.01
"""Of the particles, that innovation outliers explain: of beliefs in which fewer do they are left out."""
MOST_OUTLIERS = 0.1
"""Share of the particles that left the motion model since the frame before, at most."""


class Noise(NamedTuple):
    """Densities of measurement errors: (1 - e) of a Gaussian or von Mises, e of an outlier.

    Those of course and speed are ratios to the densities of a false detection's, see `measurements`.
    """

    few: float  # share of the particles: where effectively fewer are left, they are drawn given the measurement
    outlier: float  # per square metre
    kept: float  # 1 less the probability of an outlier
    leaves: float  # 1/s, rate of innovation outliers
    direction_concentration: float
    direction_scale: float
    direction_outlier: float
    speed_precision: float  # (s/m)^2
    speed_scale: float
    speed_outlier: float


@njit(cache=True, nogil=True)
def begin(
    primitives: MapTable, cloud: Cloud, carried: Carried, vehicle: IntArray, key: UIntArray, measured: FloatArray,
    errors: Errors, noise: Noise,
) -> None:  # fmt: skip
    """Initialise beliefs from one measurement each: positions by its errors, direction and speed by the primitive.

    Where the axes are the particles' own, the primitive is that at a position drawn with the larger of the two errors.
    A measured course and pace weigh the particles. `initialise_motion` then looks up cells and draws manoeuvres.
    """
    n = cloud.speed.shape[1]
    fit = np.empty(n)
    for i in range(vehicle.size):
        v, z = vehicle[i], measured[i]
        place, direction, mean, state = cloud.position[v], cloud.direction[v], carried.mean[v], cloud.state[v]
        random.seed_state(key[i], state)
        along, across = math.sqrt(z[WHITE] + errors.lasting[0]), math.sqrt(z[WHITE + 1] + errors.lasting[1])
        is_own, widest = math.isnan(z[AXIS]), max(along, across)
        c, s = (1.0, 0.0) if is_own else (math.cos(z[AXIS]), math.sin(z[AXIS]))
        first, second = (widest, widest) if is_own else (along, across)
        for p in range(n):
            ahead, aside = first * random.draw_normal(state), second * random.draw_normal(state)
            place[p, 0], place[p, 1] = z[X] + ahead * c - aside * s, z[Y] + ahead * s + aside * c
        _map_kernels.draw(primitives, place, state, direction, cloud.speed[v])
        share, share_across = lasting_share(z, errors, 0), lasting_share(z, errors, 1)
        if is_own:
            along, across = along / widest, across / widest
            for p in range(n):
                c, s = math.cos(direction[p]), math.sin(direction[p])
                dx, dy = z[X] - place[p, 0], z[Y] - place[p, 1]
                ahead, aside = along * (dx * c + dy * s), across * (dy * c - dx * s)
                mean[p, 0], mean[p, 1] = share * ahead, share_across * aside
                ahead, aside = ahead + errors.bias[0], aside + errors.bias[1]
                place[p, 0], place[p, 1] = z[X] - (ahead * c - aside * s), z[Y] - (ahead * s + aside * c)
        for p in range(n):
            fit[p], cloud.weight[v, p] = 1.0, 1.0 / n
        fit_motion(cloud, v, z, noise, fit)
        normalise(cloud.weight[v], fit)
        carried.variance[v, 0], carried.variance[v, 1] = share * z[WHITE], share_across * z[WHITE + 1]
        carried.since_s[v], carried.has_course[v] = 0.0, False


@njit(cache=True, nogil=True, error_model="numpy")
def weigh(
    cloud: Cloud, carried: Carried, vehicle: IntArray, measured: FloatArray, evidence: FloatArray, errors: Errors,
    noise: Noise,
) -> None:  # fmt: skip
    """Weigh each vehicle's particles by its measurement, normalise, and learn of the error that each carries.

    Fills (V, 3): the log density of the measurement given those before it, that of its position alone, and 1 where
    particles were moved: drawn given it, or as innovation outliers. A measurement that the belief as a whole calls an
    outlier says nothing of the carried error. Loops are kept apart, and without branches, so that they are compiled to
    vector instructions.
    """
    n = cloud.position.shape[1]
    fit, off = np.empty(n), np.empty((4, n))
    densest = 1.0 / (2.0 * math.pi * PLACE_M * PLACE_M)
    for i in range(vehicle.size):
        v, z = vehicle[i], measured[i]
        weight, share = cloud.weight[v], min(noise.leaves * carried.since_s[v], MOST_OUTLIERS)
        scale = noise.kept * residuals(cloud, carried, v, z, errors, off, fit)
        for p in range(n):
            likely = scale * exp(-0.5 * fit[p]) + noise.outlier
            fit[p] = likely if fit[p] < np.inf else 0.0  # it has run off to where there are no numbers
        near = dot(weight, fit)
        is_drawn = False
        if noise.few > 0.0 and (near < 2.0 * noise.outlier or effective_share(weight, fit) < noise.few):
            found = draw_given_measurement(cloud, carried, v, z, share, errors, noise, off)
            is_drawn = found > 0.0
            if is_drawn:
                near = found
                residuals(cloud, carried, v, z, errors, off, fit)
                fit[:] = near
        fit_motion(cloud, v, z, noise, fit)
        total = dot(weight, fit)
        evidence[i, 0] = math.log(total) if total > 0.0 else -np.inf  # no particle has a weight
        evidence[i, 1] = math.log(near) if near > 0.0 else -np.inf
        is_explained = near >= 2.0 * noise.outlier and total > 0.0
        is_moved = is_explained and not is_drawn and near * LEAST_SHARE < share * densest
        evidence[i, 2] = 1.0 if is_moved or is_drawn else 0.0
        if is_moved:
            move_outliers(cloud, carried, v, z, share, errors, noise, off, fit)
            fit_motion(cloud, v, z, noise, fit)
        normalise(weight, fit)
        learn(cloud, carried, v, z, errors, off, is_explained)
        carried.since_s[v] = 0.0


@njit(cache=True)
def effective_share(weight: FloatArray, fit: FloatArray) -> float:
    """The share of particles (P,) that are effectively left of weights times likelihoods."""
    total, squares = 0.0, 0.0
    for p in range(weight.size):
        later = weight[p] * fit[p]
        total += later
        squares += later * later
    return total * total / (squares * weight.size) if squares > 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def draw_given_measurement(
    cloud: Cloud, carried: Carried, v: int, z: FloatArray, share: float, errors: Errors, noise: Noise, off: FloatArray
) -> float:
    """Draw particles given the measurement, unless innovation outliers explain it better; its density, 1/m2, or 0.

    Where particles do not agree on a course, each has the bias elsewhere: there nothing is drawn. Carried errors come
    to the measurement's time.
    """
    if not carried.has_course[v] and (errors.bias[0] != 0.0 or errors.bias[1] != 0.0):
        return 0.0
    for a in range(2):
        kept = math.exp(-carried.since_s[v] * errors.forgets[a])
        carried.variance[v, a] = lasting_variance(carried, v, errors, a)
        for p in range(off.shape[1]):
            carried.mean[v, p, a] *= kept
    carried.since_s[v], weight, place, far = 0.0, cloud.weight[v], cloud.position[v], 0.0
    for p in range(weight.size):
        dx, dy = z[X] - place[p, 0], z[Y] - place[p, 1]
        far += weight[p] * exp(-0.5 * (dx * dx + dy * dy) / (PLACE_M * PLACE_M))
    far *= share / (2.0 * math.pi * PLACE_M * PLACE_M)
    c, s = course_of(weight, off)
    measured = Measured(
        z[X] - errors.bias[0] * c + errors.bias[1] * s, z[Y] - errors.bias[0] * s - errors.bias[1] * c, c, s,
        z[WHITE] + carried.variance[v, 0], z[WHITE + 1] + carried.variance[v, 1],
    )  # fmt: skip
    lasts = errors.lasting[0] > 0.0 or errors.lasting[1] > 0.0
    least = max(2.0 * noise.outlier, far)
    return float(draw_given(cloud, carried, v, measured, noise.kept, noise.outlier, least, lasts))


@njit(cache=True, nogil=True, error_model="numpy")
def log_likelihood(
    cloud: Cloud, carried: Carried, vehicle: IntArray, measured: FloatArray, out: FloatArray, errors: Errors,
    noise: Noise,
) -> None:  # fmt: skip
    """Fills (V,): natural log of the density of each measurement under the belief, outlying positions aside."""
    n = cloud.position.shape[1]
    fit, off = np.empty(n), np.empty((4, n))
    for i in range(vehicle.size):
        v = vehicle[i]
        scale = residuals(cloud, carried, v, measured[i], errors, off, fit)
        nearest = fit.min()
        for p in range(n):
            fit[p] = exp(-0.5 * (fit[p] - nearest))
        fit_motion(cloud, v, measured[i], noise, fit)
        total = dot(cloud.weight[v], fit)
        out[i] = math.log(total * scale) - 0.5 * nearest if total > 0.0 else -np.inf


@njit(cache=True, nogil=True, error_model="numpy")
def residuals(
    cloud: Cloud, carried: Carried, v: int, z: FloatArray, errors: Errors, off: FloatArray, fit: FloatArray
) -> float:
    """What each particle's path and carried error leave of a measurement.

    Fills off (4, P), metres along both axes and the unit vector of the first, and fit (P,), the squares of the metres
    in their variances. Returns the density of no difference, 1/m2.
    """
    place, direction, mean, x, y = cloud.position[v], cloud.direction[v], carried.mean[v], z[X], z[Y]
    kept, other = math.exp(-carried.since_s[v] * errors.forgets[0]), math.exp(-carried.since_s[v] * errors.forgets[1])
    precision = 1.0 / (z[WHITE] + lasting_variance(carried, v, errors, 0))
    precision_across = 1.0 / (z[WHITE + 1] + lasting_variance(carried, v, errors, 1))
    bias, bias_across = errors.bias[0], errors.bias[1]
    if math.isnan(z[AXIS]):
        for p in range(direction.size):
            off[COSINE, p] = 1.0 - 2.0 * squared_sine(0.5 * direction[p])
            off[SINE, p] = 1.0 - 2.0 * squared_sine(0.5 * direction[p] - 0.25 * math.pi)
    else:
        c, s = math.cos(z[AXIS]), math.sin(z[AXIS])
        for p in range(direction.size):
            off[COSINE, p], off[SINE, p] = c, s
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


@njit(cache=True, nogil=True)
def fit_motion(cloud: Cloud, v: int, z: FloatArray, noise: Noise, fit: FloatArray) -> None:
    """Multiply (P,) by how well a measured course and pace fit, over how well they fit a false detection."""
    direction, speed, course, pace = cloud.direction[v], cloud.speed[v], z[COURSE], z[PACE]
    if not math.isnan(course):
        for p in range(fit.size):
            apart = 2.0 * noise.direction_concentration * squared_sine(0.5 * (direction[p] - course))
            fit[p] *= noise.direction_scale * exp(-apart) + noise.direction_outlier
    if not math.isnan(pace):
        for p in range(fit.size):
            off = speed[p] - pace
            fit[p] *= noise.speed_scale * exp(-0.5 * noise.speed_precision * off * off) + noise.speed_outlier


@njit(cache=True, nogil=True)
def normalise(weight: FloatArray, fit: FloatArray) -> None:
    """Multiply weights (P,) by likelihoods; where none is left, they stay as they are."""
    total = dot(weight, fit)
    if total > 0.0:
        for p in range(weight.size):
            later = weight[p] * fit[p] / total
            weight[p] = later if later > LEAST else 0.0


@njit(cache=True, error_model="numpy")
def move_outliers(
    cloud: Cloud, carried: Carried, v: int, z: FloatArray, share: float, errors: Errors, noise: Noise,
    off: FloatArray, fit: FloatArray,
) -> None:  # fmt: skip
    """Fill (P,) likelihoods of the mixture, and move the particles that are its outliers; `off` stays what is left."""
    k, state = PLACE_M * PLACE_M, cloud.state[v].copy()
    s = z[WHITE] + lasting_variance(carried, v, errors, 0)
    s_across = z[WHITE + 1] + lasting_variance(carried, v, errors, 1)
    gain, gain_across = k / (k + s), k / (k + s_across)
    scale = (1.0 - share) * noise.kept / (2.0 * math.pi * math.sqrt(s * s_across))
    wide = share * noise.kept / (2.0 * math.pi * math.sqrt((k + s) * (k + s_across)))
    for p in range(fit.size):
        ahead, aside = off[0, p], off[1, p]
        ordinary = scale * exp(-0.5 * (ahead * ahead / s + aside * aside / s_across)) + (1.0 - share) * noise.outlier
        far = wide * exp(-0.5 * (gain * ahead * ahead + gain_across * aside * aside) / k)
        fit[p] = ordinary + far if ordinary + far < np.inf else 0.0
        if random.uniform(state) * fit[p] < far:
            ahead = gain * ahead + math.sqrt(gain * s) * random.draw_normal(state)
            aside = gain_across * aside + math.sqrt(gain_across * s_across) * random.draw_normal(state)
            off[0, p] -= ahead
            off[1, p] -= aside
            east = ahead * off[COSINE, p] - aside * off[SINE, p]
            displace(cloud, v, p, east, ahead * off[SINE, p] + aside * off[COSINE, p], state)
    for word in range(state.size):  # a slice would compile numba's strings for its error
        cloud.state[v, word] = state[word]


@njit(cache=True)
def displace(cloud: Cloud, v: int, p: int, east: float, north: float, state: UIntArray) -> None:
    """Move a particle, and draw its velocity given by how far. Who stands keeps standing, who moves keeps moving."""
    cloud.position[v, p, 0] += east
    cloud.position[v, p, 1] += north
    theta, pace = cloud.direction[v, p], cloud.speed[v, p]
    if pace >= STANDING_BELOW:
        c, s, alone = cos(theta), sin(theta), math.sqrt(1.0 - TOGETHER * TOGETHER)
        ahead = SPEED_OFF * (TOGETHER * (east * c + north * s) / PLACE_M + alone * random.draw_normal(state))
        aside = SPEED_OFF * (TOGETHER * (north * c - east * s) / PLACE_M + alone * random.draw_normal(state))
        cloud.direction[v, p] = wrap(theta + aside / (pace + SPEED_OFF))
        cloud.speed[v, p] = max(pace + ahead, STANDING_BELOW)
