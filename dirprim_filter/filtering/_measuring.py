"""Compiled: particles against measured positions, directions and speeds, each of which may be an outlier.

A measurement leaves each particle a residual along two axes, with a variance along each: that of what is new of the
error since the detection before; see `sensor` for what lasts. The axes are those of the measurement's covariance; or,
where a sensor errs along and across a vehicle's way, those of the belief's mean course. Particles differ in theirs:
turned by d from the mean course, of E[cos d] = r and E[cos^2 d] = q, an error of mean b and variances s^2 has in the
shared axes the mean r b, and the variance along

    q (s_1^2 + b_1^2) + (1 - q) (s_2^2 + b_2^2) - r^2 b_1^2

The error of a measured position is wrong with a share e: its density N(z; x, R) has a tail of Student's t with two
degrees of freedom, `TAIL` times as wide, T(z; x, R), and so has each noise its own. And now and then a vehicle leaves
its motion model: a particle that stands two metres beyond where its vehicle stopped stays there, and so do all others:
they are equally far off, so none is preferred. An *innovation outlier*, of a share a, puts it off by a Gaussian of
K = `PLACE_M`^2 in each axis, and its speed by one of `SPEED_OFF` that goes with how far it is ahead. A particle weighs

    (1 - e) ((1 - a) N(z; x, R) + a N(z; x, R + K)) + e T(z; x, R)

and is drawn from the middle part given the measurement as often as that part weighs. Of one wrong row the tail explains
most, of a vehicle that is off for longer the outlier: a belief that is sure and wrong takes two measurements to mend.

Source: Fox, Outliers in time series, 1972, for innovation outliers, against additive ones, which are a sensor's; Liu
and Chen, Sequential Monte Carlo methods for dynamic systems, 1998, for drawing from a transition given the measurement.
"""

import math
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._arithmetic import dot
from dirprim_filter.distributions._elementary import cos, exp, sin, squared_sine, wrap
from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.filtering._conditioning import Measured, draw_given
from dirprim_filter.filtering._kernels import Cloud
from dirprim_filter.filtering.measurements import TAIL
from dirprim_filter.primitives import _map_kernels
from dirprim_filter.primitives._manoeuvres import STANDING_BELOW
from dirprim_filter.primitives._map_kernels import MapTable
from tessellation._compiling import compiled

X, Y, COURSE, PACE, AXIS, ALONG, ACROSS, BIAS, BIAS_ACROSS = range(9)
"""Columns of a measurement: metres; radians and m/s, NaN where not measured; the direction of the errors' first axis,
NaN where it is a vehicle's course; the variances along both axes, m2, and the means, m."""
LEAST = 1e-200
"""Weight below which a particle has none: far above the subnormal numbers, with which processors are slow."""
PLACE_M, SPEED_OFF, TOGETHER = 1.0, 2.0, 0.7
"""Metres, m/s, and their correlation: an acceleration of 2 m/s^2 beside the model's, for a second."""
LEAST_SHARE = 0.01
"""Of a measurement's density, that innovation outliers make: where it is less they are left out."""
MOST_OUTLIERS = 0.1
"""Share of the particles that left the motion model since the frame before, at most."""


class Noise(NamedTuple):
    """Measurement errors: (1 - e) of a Gaussian or von Mises, e of an outlier.

    Those of course and speed are ratios to the densities of a false detection's, see `measurements`.
    """

    few: float  # share of the particles: where effectively fewer are left, they are drawn given the measurement
    outlier: float  # share of measured positions
    lost: float  # odds of an outlier to the vehicle from which on a belief explains nothing
    leaves: float  # 1/s, rate of innovation outliers
    free: int  # the manoeuvre of who goes straight on
    direction_concentration: float
    direction_scale: float
    direction_outlier: float
    speed_precision: float  # (s/m)^2
    speed_scale: float
    speed_outlier: float


@compiled
def begin(
    primitives: MapTable, noise: Noise, cloud: Cloud, vehicle: IntArray, key: UIntArray, measured: FloatArray
) -> None:
    """Initialise beliefs from one measurement each: positions by its errors, direction and speed by the primitive.

    Where the axes are the particles' own, the primitive is that at a position drawn with the larger of the two errors.
    A measured course and pace weigh the particles. `initialise_motion` then looks up cells and draws manoeuvres.
    """
    n = cloud.speed.shape[1]
    fit = np.empty(n)
    for i in range(vehicle.size):
        v, z = vehicle[i], measured[i]
        place, direction, state = cloud.position[v], cloud.direction[v], cloud.state[v]
        random.seed_state(key[i], state)
        along, across = math.sqrt(z[ALONG]), math.sqrt(z[ACROSS])
        is_own, widest = math.isnan(z[AXIS]), along if along > across else across
        c, s = (1.0, 0.0) if is_own else (math.cos(z[AXIS]), math.sin(z[AXIS]))
        first, second = (widest, widest) if is_own else (along, across)
        for p in range(n):
            ahead, aside = first * random.draw_normal(state), second * random.draw_normal(state)
            place[p, 0], place[p, 1] = z[X] + ahead * c - aside * s, z[Y] + ahead * s + aside * c
        _map_kernels.draw(primitives, place, state, direction, cloud.speed[v])
        for p in range(n if is_own else 0):
            c, s = math.cos(direction[p]), math.sin(direction[p])
            dx, dy = (z[X] - place[p, 0]) / widest, (z[Y] - place[p, 1]) / widest
            ahead, aside = along * (dx * c + dy * s) + z[BIAS], across * (dy * c - dx * s) + z[BIAS_ACROSS]
            place[p, 0], place[p, 1] = z[X] - (ahead * c - aside * s), z[Y] - (ahead * s + aside * c)
        fit[:], cloud.weight[v] = 1.0, 1.0 / n
        fit_motion(cloud, v, z, noise, fit)
        normalise(cloud.weight[v], fit)
        cloud.since_s[v] = 0.0


@compiled
def weigh(noise: Noise, cloud: Cloud, vehicle: IntArray, measured: FloatArray, evidence: FloatArray) -> None:
    """Weigh each vehicle's particles by its measurement, and normalise.

    Fills (V, 3): the log density of the measurement given those before it; 1 where the vehicle explains it better than
    an outlier; and 1 where particles were moved: drawn given it, or as innovation outliers. Loops are kept apart, and
    without branches, so that they are compiled to vector instructions.
    """
    n = cloud.position.shape[1]
    fit, far, tail, off = np.empty(n), np.empty(n), np.empty(n), np.empty((2, n))
    for i in range(vehicle.size):
        v, z, e = vehicle[i], measured[i], noise.outlier
        weight, share = cloud.weight[v], min(noise.leaves * cloud.since_s[v], MOST_OUTLIERS)
        place = in_shared_axes(cloud, v, z, off)
        scale = residuals(cloud, v, place, off, fit)
        for p in range(n):
            q = 1.0 + fit[p] / (2.0 * TAIL * TAIL)
            tail[p] = scale / (TAIL * TAIL * q * q)
            fit[p] = scale * exp(-0.5 * fit[p]) if fit[p] < np.inf else 0.0  # it has run off to where no numbers are
        own, wrong = dot(weight, fit), noise.lost * dot(weight, tail)
        is_moved = own * LEAST_SHARE < share * densest(place)
        beside = share * outlying(weight, place, off, far) if is_moved else 0.0
        is_drawn = False
        if noise.few > 0.0 and (own < wrong or effective_share(weight, fit) < noise.few):
            found = draw_given(cloud, v, place, e, tail, wrong, share, PLACE_M * PLACE_M)
            if found > 0.0:
                own, is_drawn, is_moved, fit[:] = found, True, False, found
        if is_moved:
            own = (1.0 - share) * own + beside
            move_outliers(cloud, v, place, share, noise, off, fit, far, tail)
        elif not is_drawn:
            for p in range(n):
                fit[p] = (1.0 - e) * fit[p] + e * tail[p]
        fit_motion(cloud, v, z, noise, fit)
        total = dot(weight, fit)
        evidence[i, 0] = math.log(total) if total > 0.0 else -np.inf  # no particle has a weight
        evidence[i, 1] = 1.0 if own >= wrong and total > 0.0 else 0.0
        evidence[i, 2] = 1.0 if is_moved or is_drawn else 0.0
        normalise(weight, fit)
        cloud.since_s[v] = 0.0


@compiled
def effective_share(weight: FloatArray, fit: FloatArray) -> float:
    """The share of particles (P,) that are effectively left of weights times likelihoods."""
    total, squares = 0.0, 0.0
    for p in range(weight.size):
        later = weight[p] * fit[p]
        total += later
        squares += later * later
    return total * total / (squares * weight.size) if squares > 0.0 else 0.0


@compiled
def densest(measured: Measured) -> float:
    """The density of no residual of an innovation outlier, 1/m2."""
    k = PLACE_M * PLACE_M
    return 1.0 / (2.0 * math.pi * math.sqrt((k + measured.along) * (k + measured.across)))


@compiled
def outlying(weight: FloatArray, measured: Measured, off: FloatArray, far: FloatArray) -> float:
    """Fill (P,) densities of innovation outliers by residuals (2, P); -> that of the belief, 1/m2."""
    k, scale = PLACE_M * PLACE_M, densest(measured)
    along, across = 1.0 / (k + measured.along), 1.0 / (k + measured.across)
    for p in range(far.size):
        q = along * off[0, p] * off[0, p] + across * off[1, p] * off[1, p]
        far[p] = scale * exp(-0.5 * q) if q < np.inf else 0.0
    return float(dot(weight, far))


@compiled
def log_likelihood(noise: Noise, cloud: Cloud, vehicle: IntArray, measured: FloatArray, out: FloatArray) -> None:
    """Fills (V,): natural log of the density of each measurement under the belief, wrong positions aside."""
    n = cloud.position.shape[1]
    fit, far, off = np.empty(n), np.empty(n), np.empty((2, n))
    for i in range(vehicle.size):
        v, share = vehicle[i], min(noise.leaves * cloud.since_s[vehicle[i]], MOST_OUTLIERS)
        place = in_shared_axes(cloud, v, measured[i], off)
        scale = residuals(cloud, v, place, off, fit)
        nearest = fit.min()
        for p in range(n):
            fit[p] = exp(-0.5 * (fit[p] - nearest))
        fit_motion(cloud, v, measured[i], noise, fit)
        total = (1.0 - share) * scale * dot(cloud.weight[v], fit)
        out[i] = math.log(total) - 0.5 * nearest if total > 0.0 else -np.inf
        if share * densest(place) * 1e6 > math.exp(out[i]):  # else a course or pace gives it no part either
            outlying(cloud.weight[v], place, off, far)
            fit_motion(cloud, v, measured[i], noise, far)
            total = math.exp(out[i]) + share * dot(cloud.weight[v], far)
            out[i] = math.log(total) if total > 0.0 else out[i]


@compiled
def in_shared_axes(cloud: Cloud, v: int, z: FloatArray, room: FloatArray) -> Measured:
    """A measured place without its bias, and its errors in axes that all particles share, see above. room: (2, P)."""
    if not math.isnan(z[AXIS]):
        return Measured(z[X], z[Y], math.cos(z[AXIS]), math.sin(z[AXIS]), z[ALONG], z[ACROSS])
    weight, direction = cloud.weight[v], cloud.direction[v]
    for p in range(direction.size):
        room[0, p] = 1.0 - 2.0 * squared_sine(0.5 * direction[p])
        room[1, p] = 1.0 - 2.0 * squared_sine(0.5 * direction[p] - 0.25 * math.pi)
    c, s = dot(weight, room[0]), dot(weight, room[1])
    r = math.hypot(c, s)
    c, s = (c / r, s / r) if r > 0.0 else (1.0, 0.0)
    for p in range(direction.size):
        room[0, p] = (room[0, p] * c + room[1, p] * s) ** 2
    q, ahead, aside = dot(weight, room[0]), r * z[BIAS], r * z[BIAS_ACROSS]
    along, across = z[ALONG] + z[BIAS] * z[BIAS], z[ACROSS] + z[BIAS_ACROSS] * z[BIAS_ACROSS]
    return Measured(
        z[X] - ahead * c + aside * s, z[Y] - ahead * s - aside * c, c, s,
        q * along + (1.0 - q) * across - ahead * ahead, q * across + (1.0 - q) * along - aside * aside,
    )  # fmt: skip


@compiled
def residuals(cloud: Cloud, v: int, measured: Measured, off: FloatArray, fit: FloatArray) -> float:
    """What each particle leaves of a measured place.

    Fills off (2, P), metres along both axes, and fit (P,), their squares in their variances. Returns the density of no
    difference, 1/m2.
    """
    place, c, s = cloud.position[v], measured.c, measured.s
    by_along, by_across = 1.0 / measured.along, 1.0 / measured.across
    for p in range(fit.size):
        dx, dy = measured.x - place[p, 0], measured.y - place[p, 1]
        off[0, p], off[1, p] = dx * c + dy * s, dy * c - dx * s
    for p in range(fit.size):
        fit[p] = by_along * off[0, p] * off[0, p] + by_across * off[1, p] * off[1, p]
    return math.sqrt(by_along * by_across) / (2.0 * math.pi)


@compiled
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


@compiled
def normalise(weight: FloatArray, fit: FloatArray) -> None:
    """Multiply weights (P,) by likelihoods; where none is left, they stay as they are."""
    total = dot(weight, fit)
    if total > 0.0:
        for p in range(weight.size):
            later = weight[p] * fit[p] / total
            weight[p] = later if later > LEAST else 0.0


@compiled
def move_outliers(
    cloud: Cloud, v: int, measured: Measured, share: float, noise: Noise, off: FloatArray, fit: FloatArray,
    far: FloatArray, tail: FloatArray,
) -> None:  # fmt: skip
    """Fill (P,) likelihoods of the mixture from its parts, and move the particles that are innovation outliers."""
    k, state, c, s = PLACE_M * PLACE_M, cloud.state[v].copy(), measured.c, measured.s
    along, across, kept = measured.along, measured.across, 1.0 - noise.outlier
    gain, gain_across = k / (k + along), k / (k + across)
    for p in range(fit.size):
        fit[p] = kept * ((1.0 - share) * fit[p] + share * far[p]) + noise.outlier * tail[p]
        if random.uniform(state) * fit[p] < kept * share * far[p]:
            ahead = gain * off[0, p] + math.sqrt(gain * along) * random.draw_normal(state)
            aside = gain_across * off[1, p] + math.sqrt(gain_across * across) * random.draw_normal(state)
            displace(cloud, v, p, ahead * c - aside * s, ahead * s + aside * c, noise.free, state)
    for word in range(state.size):  # a slice would compile numba's strings for its error
        cloud.state[v, word] = state[word]


@compiled
def displace(cloud: Cloud, v: int, p: int, east: float, north: float, free: int, state: UIntArray) -> None:
    """Move a particle, and draw its velocity given by how far; who moves keeps moving.

    Who stands keeps standing, or as often starts, whichever way it was moved: backwards too, as by a `free` manoeuvre.
    """
    cloud.position[v, p, 0] += east
    cloud.position[v, p, 1] += north
    theta, pace = cloud.direction[v, p], cloud.speed[v, p]
    c, s, alone = cos(theta), sin(theta), math.sqrt(1.0 - TOGETHER * TOGETHER)
    ahead = SPEED_OFF * (TOGETHER * (east * c + north * s) / PLACE_M + alone * random.draw_normal(state))
    aside = SPEED_OFF * (TOGETHER * (north * c - east * s) / PLACE_M + alone * random.draw_normal(state))
    if pace >= STANDING_BELOW:
        cloud.direction[v, p] = wrap(theta + aside / (pace + SPEED_OFF))
        cloud.speed[v, p] = max(pace + ahead, STANDING_BELOW)
    elif random.uniform(state) < 0.5:
        cloud.direction[v, p], cloud.manoeuvre[v, p] = wrap(theta + math.atan2(aside, ahead)), free
        cloud.speed[v, p] = max(math.hypot(ahead, aside), STANDING_BELOW)
