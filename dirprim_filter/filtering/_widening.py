"""Compiled weighing where few particles come near a measurement: each is taken for a kernel of the belief's density.

After a gap a handful of a thousand particles is near, or one. All that follow descend from it, and the belief is sure
of whatever speed it has. So each particle becomes a Gaussian about x_p, of covariance h^2 P, is weighed by the density
N(z; x_p, h^2 P + R) of the measurement, and drawn anew from that Gaussian given the measurement: particles beside the
vehicle come to it, as much faster as those are that got farther. P is the covariance of those that are nearest. All
are first moved to the mean of these by the factor sqrt(1 - h^2), which leaves P as it was. h is the smallest that
leaves enough particles: of 0 this is a particle filter, of 1 a Kalman filter on the particles' moments.

Source: Stordal et al., Bridging the ensemble Kalman filter and particle filters: the adaptive Gaussian mixture filter,
2011; Liu and West, Combined parameter and state estimation in simulation-based filtering, 2001, for the factor.
"""

import math

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions import _kernels as density
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._elementary import exp
from dirprim_filter.filtering._kernels import Cloud, effective_sample_size, mean_of, total_of
from dirprim_filter.filtering._measuring import DIRECTION, SPEED, XX, XY, YY, Noise, direction_fit, speed_fit
from dirprim_filter.primitives._manoeuvres import STANDING_BELOW

FEW = 0.3
"""Share of the particles: where effectively fewer come near, they are taken for kernels."""
HALVINGS = 8
"""Of the intervals in which an exponent and a bandwidth are looked for."""
N_STATES = 5
"""Of a particle: place, direction, speed, push."""
LEAST_VARIANCE = 1e-9
"""Of a state, so that a covariance has a root."""


@njit(cache=True, nogil=True)
def weigh(cloud: Cloud, vehicle: IntArray, before: FloatArray, measured: FloatArray, noise: Noise) -> None:
    """Weigh each vehicle's particles, of weights `before` (V, P), as kernels, and draw them anew.

    An outlier leaves a particle as it was. Who stands keeps its direction and speed.
    """
    n, least = cloud.position.shape[1], FEW * cloud.position.shape[1]
    state, moved, fit, mean = np.empty((N_STATES, n)), np.empty((N_STATES, n)), np.empty(n), np.empty(N_STATES)
    spread, wider, r = np.empty((N_STATES, N_STATES)), np.empty((N_STATES, N_STATES)), np.empty((2, 2))
    for i in range(vehicle.size):
        v, z = vehicle[i], measured[i]
        weight, determinant = cloud.weight[v], z[XX] * z[YY] - z[XY] * z[XY]
        r[0, 0], r[1, 1], r[0, 1] = z[YY] / determinant, z[XX] / determinant, -z[XY] / determinant
        r[1, 0] = r[0, 1]
        states_of(cloud, v, before[i], state)
        nearest(before[i], state, z, r, least, fit, weight)
        moments(weight, state, mean, spread)
        low, high = 0.0, 1.0
        for k in range(HALVINGS + 1):
            h = 0.5 * (low + high) if k < HALVINGS else high
            widen(state, mean, spread, h, moved, wider)
            weigh_kernels(before[i], moved, z, r, wider, noise, fit, weight)
            if effective_sample_size(weight) < least:
                low = h
            else:
                high = h
        draw(cloud, v, state, moved, wider, z, r, noise.outlier, fit)
        weigh_motion(cloud, v, z[DIRECTION], z[SPEED], noise)


@njit(cache=True)
def weigh_motion(cloud: Cloud, v: int, course: float, pace: float, noise: Noise) -> None:
    """Weigh the particles of a vehicle by a measured course and pace."""
    weight, direction, speed = cloud.weight[v], cloud.direction[v], cloud.speed[v]
    if not math.isnan(course):
        for p in range(weight.size):
            weight[p] *= direction_fit(noise, direction[p], course)
    if not math.isnan(pace):
        for p in range(weight.size):
            weight[p] *= speed_fit(noise, speed[p], pace)
    normalise(weight)


@njit(cache=True)
def normalise(weight: FloatArray) -> None:
    """Have (P,) weights sum to one."""
    total = total_of(weight)
    for p in range(weight.size):
        weight[p] /= total


@njit(cache=True)
def states_of(cloud: Cloud, v: int, weight: FloatArray, state: FloatArray) -> None:
    """Fills (5, P) states of the particles; directions from their mean."""
    direction, c, s = cloud.direction[v], 0.0, 0.0
    for p in range(weight.size):
        c += weight[p] * math.cos(direction[p])
        s += weight[p] * math.sin(direction[p])
    mean = math.atan2(s, c)
    for p in range(weight.size):
        state[0, p], state[1, p] = cloud.position[v, p, 0], cloud.position[v, p, 1]
        state[2, p] = density.wrap(direction[p] - mean)
        state[3, p], state[4, p] = cloud.speed[v, p], cloud.push[v, p]


@njit(cache=True)
def nearest(
    before: FloatArray, state: FloatArray, z: FloatArray, r: FloatArray, least: float, fit: FloatArray,
    weight: FloatArray,
) -> None:  # fmt: skip
    """Fills (P,) weights before * N(z; x, R)^t, of the largest t up to 1 that leaves an effective size of `least`."""
    squared_distances(state, z, r[0, 0], r[0, 1], r[1, 1], fit)
    closest, low, t, high = np.inf, 0.0, 0.5, 1.0
    for p in range(weight.size):
        closest = min(closest, fit[p])
    for i in range(HALVINGS + 1):
        for p in range(weight.size):
            weight[p] = before[p] * exp(-0.5 * t * (fit[p] - closest))
        normalise(weight)
        if effective_sample_size(weight) >= least:
            low = t
        else:
            high = t
        t = low if i == HALVINGS - 1 else 0.5 * (low + high)


@njit(cache=True)
def squared_distances(state: FloatArray, z: FloatArray, xx: float, xy: float, yy: float, fit: FloatArray) -> float:
    """Fills (P,) the squared Mahalanobis distances from a place, by a covariance; -> the density of none."""
    determinant = xx * yy - xy * xy
    for p in range(fit.size):
        dx, dy = state[0, p] - z[0], state[1, p] - z[1]
        fit[p] = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / determinant
    return 1.0 / (2.0 * math.pi * math.sqrt(determinant))


@njit(cache=True)
def moments(weight: FloatArray, state: FloatArray, mean: FloatArray, covariance: FloatArray) -> None:
    """Fills (5,) and (5, 5) from (5, P) states by weights that sum to one."""
    off = np.empty_like(state)
    for a in range(N_STATES):
        mean[a] = mean_of(weight, state[a], 1.0)
        for p in range(weight.size):
            off[a, p] = state[a, p] - mean[a]
    for a in range(N_STATES):
        for b in range(a + 1):
            total = LEAST_VARIANCE if a == b else 0.0
            for p in range(weight.size):
                total += weight[p] * off[a, p] * off[b, p]
            covariance[a, b] = covariance[b, a] = total


@njit(cache=True)
def widen(
    state: FloatArray, mean: FloatArray, spread: FloatArray, h: float, moved: FloatArray, wider: FloatArray
) -> None:
    """Fills (5, P) where kernels of a bandwidth stand, and (5, 5) their covariance."""
    kept = math.sqrt(1.0 - h * h)
    for a in range(N_STATES):
        for p in range(state.shape[1]):
            moved[a, p] = mean[a] + kept * (state[a, p] - mean[a])
        for b in range(N_STATES):
            wider[a, b] = h * h * spread[a, b]


@njit(cache=True)
def weigh_kernels(
    before: FloatArray, state: FloatArray, z: FloatArray, r: FloatArray, spread: FloatArray, noise: Noise,
    fit: FloatArray, weight: FloatArray,
) -> None:  # fmt: skip
    """Fills (P,) weights by the density about each kernel, and that density, outliers aside."""
    xx, xy, yy = r[0, 0] + spread[0, 0], r[0, 1] + spread[0, 1], r[1, 1] + spread[1, 1]
    scale = noise.kept * squared_distances(state, z, xx, xy, yy, fit)
    for p in range(weight.size):
        fit[p] = scale * exp(-0.5 * fit[p])
        weight[p] = before[p] * (fit[p] + noise.outlier)
    normalise(weight)


@njit(cache=True)
def draw(
    cloud: Cloud, v: int, state: FloatArray, moved: FloatArray, spread: FloatArray, z: FloatArray, r: FloatArray,
    outlier: float, fit: FloatArray,
) -> None:  # fmt: skip
    """Draw each particle from its kernel, given the measurement, or leave it, as likely as that is an outlier."""
    n, off, gain = fit.size, np.empty(N_STATES), np.empty((N_STATES, 2))
    root, root_of_noise = np.zeros((N_STATES, N_STATES)), np.zeros((2, 2))
    factorise(spread, root)
    factorise(r, root_of_noise)
    xx, xy, yy = spread[0, 0] + r[0, 0], spread[0, 1] + r[0, 1], spread[1, 1] + r[1, 1]
    for a in range(N_STATES):
        gain[a, 0] = (spread[a, 0] * yy - spread[a, 1] * xy) / (xx * yy - xy * xy)
        gain[a, 1] = (spread[a, 1] * xx - spread[a, 0] * xy) / (xx * yy - xy * xy)
    random_state, normal, even = cloud.state[v].copy(), np.empty(8 * n), np.empty(n)
    random.fill_normals(normal, random_state)
    random.fill_even(even, random_state)
    cloud.state[v] = random_state
    for p in range(n):
        if (even[p] + 0.5) * (fit[p] + outlier) >= fit[p]:
            continue
        e = normal[8 * p : 8 * p + 8]
        for a in range(N_STATES):
            off[a] = moved[a, p] - state[a, p]
            for b in range(a + 1):
                off[a] += root[a, b] * e[b]
        dx = z[0] - state[0, p] - off[0] + root_of_noise[0, 0] * e[5]
        dy = z[1] - state[1, p] - off[1] + root_of_noise[1, 0] * e[5] + root_of_noise[1, 1] * e[6]
        for a in range(N_STATES):
            off[a] += gain[a, 0] * dx + gain[a, 1] * dy
        cloud.position[v, p, 0] += off[0]
        cloud.position[v, p, 1] += off[1]
        if cloud.speed[v, p] >= STANDING_BELOW:
            cloud.direction[v, p] = density.wrap(cloud.direction[v, p] + off[2])
            cloud.speed[v, p] = max(cloud.speed[v, p] + off[3], 0.0)
            cloud.push[v, p] += off[4]


@njit(cache=True)
def factorise(covariance: FloatArray, root: FloatArray) -> None:
    """Fills the lower triangle (d, d) of Cholesky."""
    for b in range(len(root)):
        for a in range(b, len(root)):
            left = covariance[a, b]
            for k in range(b):
                left -= root[a, k] * root[b, k]
            root[a, b] = math.sqrt(max(left, 0.0)) if a == b else (left / root[b, b] if root[b, b] > 0.0 else 0.0)
