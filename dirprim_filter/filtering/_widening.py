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
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._arithmetic import dot, total_of
from dirprim_filter.distributions._elementary import EXACT, cos, exp, sin, wrap
from dirprim_filter.filtering._kernels import Cloud
from dirprim_filter.filtering._measuring import DIRECTION, SPEED, XX, XY, YY, Noise, X, Y, direction_fit, speed_fit
from dirprim_filter.primitives._manoeuvres import STANDING_BELOW

HALVINGS = 8
"""Of the intervals in which an exponent and a bandwidth are looked for."""
N_STATES = 5
"""Of a particle: place, direction, speed, push."""
LEAST_VARIANCE = 1e-9
"""Of a state, so that a covariance has a root."""


@njit(cache=True, nogil=True)
def weigh(
    cloud: Cloud, vehicle: IntArray, before: FloatArray, measured: FloatArray, least: float, noise: Noise
) -> None:  # fmt: skip
    """Weigh each vehicle's particles, of weights `before` (V, P), as kernels so wide that `least` of them come near.

    An outlier leaves a particle as it was. Who stands keeps its direction and speed. Some 80 ns a particle: two
    searches of nine exponentials each take two parts in three, the five normals of a draw most of the rest.
    """
    n = cloud.position.shape[1]
    state, fit, mean, r = np.empty((N_STATES, n)), np.empty(n), np.empty(N_STATES), np.empty((2, 2))
    spread = np.empty((N_STATES, N_STATES))
    for i in range(vehicle.size):
        v, z = vehicle[i], measured[i]
        weight, determinant = cloud.weight[v], z[XX] * z[YY] - z[XY] * z[XY]
        r[0, 0], r[1, 1], r[0, 1] = z[YY] / determinant, z[XX] / determinant, -z[XY] / determinant
        r[1, 0] = r[0, 1]
        states_of(cloud, v, before[i], z, state)
        nearest(before[i], state, z, least, fit, weight)
        moments(weight, state, mean, spread)
        low, high = 0.0, 1.0
        for k in range(HALVINGS + 1):
            h = 0.5 * (low + high) if k < HALVINGS else high
            if weigh_kernels(before[i], state, mean, spread, r, h, noise, fit, weight) < least:
                low = h
            else:
                high = h
        draw(cloud, v, state, mean, spread, r, h, noise.outlier, fit)
        weigh_motion(cloud, v, z[DIRECTION], z[SPEED], noise)


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


@njit(**EXACT)
def states_of(cloud: Cloud, v: int, weight: FloatArray, z: FloatArray, state: FloatArray) -> None:
    """Fills (5, P) states of the particles: places from the measured one, directions from their mean."""
    direction = cloud.direction[v]
    for p in range(weight.size):
        state[0, p], state[1, p] = cos(direction[p]), sin(direction[p])
    mean = math.atan2(dot(weight, state[1]), dot(weight, state[0]))
    for p in range(weight.size):
        state[0, p], state[1, p] = cloud.position[v, p, 0] - z[X], cloud.position[v, p, 1] - z[Y]
        state[2, p] = wrap(direction[p] - mean)
        state[3, p], state[4, p] = cloud.speed[v, p], cloud.push[v, p]


@njit(**EXACT)
def nearest(
    before: FloatArray, state: FloatArray, z: FloatArray, least: float, fit: FloatArray, weight: FloatArray
) -> None:
    """Fills (P,) weights before * N(z; x, R)^t, of the largest t up to 1 that leaves an effective size of `least`."""
    closest, low, t, high = np.inf, 0.0, 0.5, 1.0
    for p in range(weight.size):
        dx, dy = state[0, p], state[1, p]
        fit[p] = dx * (z[XX] * dx + 2.0 * z[XY] * dy) + z[YY] * dy * dy
        closest = min(closest, fit[p])
    for i in range(HALVINGS + 1):
        for p in range(weight.size):
            weight[p] = before[p] * exp(-0.5 * t * (fit[p] - closest))
        total = total_of(weight)
        if total * total >= least * dot(weight, weight):
            low = t
        else:
            high = t
        t = low if i == HALVINGS - 1 else 0.5 * (low + high)
    for p in range(weight.size):
        weight[p] /= total


@njit(cache=True)
def moments(weight: FloatArray, state: FloatArray, mean: FloatArray, covariance: FloatArray) -> None:
    """Fills (5,) and (5, 5) from (5, P) states by weights that sum to one."""
    off, weighted = np.empty_like(state), np.empty_like(weight)
    for a in range(N_STATES):
        mean[a] = dot(weight, state[a])
        for p in range(weight.size):
            off[a, p] = state[a, p] - mean[a]
            weighted[p] = weight[p] * off[a, p]
        for b in range(a + 1):
            covariance[a, b] = covariance[b, a] = dot(weighted, off[b])
        covariance[a, a] += LEAST_VARIANCE


@njit(**EXACT)
def weigh_kernels(
    before: FloatArray, state: FloatArray, mean: FloatArray, spread: FloatArray, r: FloatArray, h: float, noise: Noise,
    fit: FloatArray, weight: FloatArray,
) -> float:  # fmt: skip
    """Fills (P,) the density of the measurement about each kernel, and weights by it; -> their effective size."""
    kept, outlier = math.sqrt(1.0 - h * h), noise.outlier
    east, north = (1.0 - kept) * mean[0], (1.0 - kept) * mean[1]
    xx, xy, yy = r[0, 0] + h * h * spread[0, 0], r[0, 1] + h * h * spread[0, 1], r[1, 1] + h * h * spread[1, 1]
    determinant = xx * yy - xy * xy
    scale = noise.kept / (2.0 * math.pi * math.sqrt(determinant))
    xx, xy, yy = -0.5 * yy / determinant, xy / determinant, -0.5 * xx / determinant
    for p in range(weight.size):
        dx, dy = east + kept * state[0, p], north + kept * state[1, p]
        fit[p] = scale * exp(dx * (xx * dx + xy * dy) + yy * dy * dy)
        weight[p] = before[p] * (fit[p] + outlier)
    total = total_of(weight)
    return total * total / dot(weight, weight)


@njit(cache=True)
def draw(
    cloud: Cloud, v: int, state: FloatArray, mean: FloatArray, spread: FloatArray, r: FloatArray, h: float,
    outlier: float, fit: FloatArray,
) -> None:  # fmt: skip
    """Draw each particle from its kernel, given the measurement, or leave it, as likely as that is an outlier."""
    n, off, gain, root = fit.size, np.empty_like(state), np.empty((N_STATES, 2)), np.zeros((N_STATES, N_STATES))
    wider, kept = np.empty((N_STATES, N_STATES)), math.sqrt(1.0 - h * h)
    for a in range(N_STATES):  # whole arrays in one expression would take seconds to compile
        for b in range(N_STATES):
            wider[a, b] = h * h * spread[a, b]
    xx, xy, yy = wider[0, 0] + r[0, 0], wider[0, 1] + r[0, 1], wider[1, 1] + r[1, 1]
    for a in range(N_STATES):
        gain[a, 0] = (wider[a, 0] * yy - wider[a, 1] * xy) / (xx * yy - xy * xy)
        gain[a, 1] = (wider[a, 1] * xx - wider[a, 0] * xy) / (xx * yy - xy * xy)
    for b in range(N_STATES):
        x, y = wider[0, b], wider[1, b]
        for a in range(N_STATES):
            wider[a, b] -= gain[a, 0] * x + gain[a, 1] * y
    factorise(wider, root)
    random_state, normal, even = cloud.state[v].copy(), np.empty(2 * N_STATES * ((n + 1) // 2)), np.empty(n)
    random.fill_normals(normal, random_state)
    random.fill_even(even, random_state)
    for word in range(random_state.size):
        cloud.state[v, word] = random_state[word]
    east, north = (1.0 - kept) * mean[0], (1.0 - kept) * mean[1]
    for a in range(N_STATES):
        for p in range(n):
            dx, dy = east + kept * state[0, p], north + kept * state[1, p]
            off[a, p] = (1.0 - kept) * (mean[a] - state[a, p]) - gain[a, 0] * dx - gain[a, 1] * dy
        for b in range(a + 1):
            for p in range(n):
                off[a, p] += root[a, b] * normal[b * n + p]
    for p in range(n):
        if (even[p] + 0.5) * (fit[p] + outlier) >= fit[p]:
            continue
        cloud.position[v, p, 0] += off[0, p]
        cloud.position[v, p, 1] += off[1, p]
        if cloud.speed[v, p] >= STANDING_BELOW:
            cloud.direction[v, p] = wrap(cloud.direction[v, p] + off[2, p])
            cloud.speed[v, p] = max(cloud.speed[v, p] + off[3, p], 0.0)
            cloud.push[v, p] += off[4, p]


@njit(cache=True)
def factorise(covariance: FloatArray, root: FloatArray) -> None:
    """Fills the lower triangle (d, d) of Cholesky."""
    for b in range(len(root)):
        for a in range(b, len(root)):
            left = covariance[a, b]
            for k in range(b):
                left -= root[a, k] * root[b, k]
            root[a, b] = math.sqrt(max(left, 0.0)) if a == b else (left / root[b, b] if root[b, b] > 0.0 else 0.0)
