"""Compiled: particles drawn given a measurement, where it leaves few of those that the motion model drew.

Of a vehicle that is seen each three seconds the belief is metres wide by the next detection, which is known to a
decimetre: one particle in a thousand is near it, and what it happens to have of course and speed is all that is left.
So the belief is taken to be a mixture of Gaussians of h^2 P, as in `_resampling`, each about a particle shrunk towards
the mean. A Gaussian weighs as it explains the measurement, w N(z; x, h^2 P + R), and its particle is drawn from its
product with the likelihood, as an ensemble Kalman filter does, by its own random errors:

    x <- x + K (z - x - e),    K = h^2 P (h^2 P + R)^-1,    e of N(0, R)

Source: Musso, Oudjane and Le Gland, Improving regularised particle filters, 2001, for the regularisation before the
measurement; Liu and Chen, Sequential Monte Carlo methods for dynamic systems, 1998, for drawing given it.
"""

import math
from typing import NamedTuple

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._arithmetic import dot
from dirprim_filter.distributions._elementary import exp
from dirprim_filter.filtering._kernels import Cloud
from dirprim_filter.filtering._resampling import AHEAD, ASIDE, kernel_of, put, room_for, spread
from tessellation._compiling import compiled, pasted

FEWEST = 0.01
"""Share of the particles that a measurement leaves effectively, below which they are drawn given it. Else forecasts of
buses are 7.8 ± 2.5 % farther off at 5 s (five seeds); elsewhere nothing changes."""
WIDE = 10.0
"""By how much a belief's area is greater than its measurement's where that is due: else few particles are near because
the vehicle left the motion model, see `_measuring`."""


class Measured(NamedTuple):
    """A place, as it was measured, and its errors along two axes that all particles share."""

    x: float  # m, without bias
    y: float
    c: float  # the unit vector of the errors' first axis
    s: float
    along: float  # m2, variances of the errors along both axes
    across: float


@compiled
def draw_given(
    cloud: Cloud, v: int, measured: Measured, outlier: float, tail: FloatArray, least: float, leaves: float,
    put_off: float,
) -> float:  # fmt: skip
    """Draw a vehicle's particles given the place where it was measured.

    Where it was wrong, of a share `outlier` and by densities `tail` (P,), a particle stays as it was.

    Returns:
        The density of the measurement, 1/m2. Or 0, and the belief is as before: where that is below `least`, where the
        belief is not wide, or where vehicles that left their motion, a share of `leaves`, explain it better, which were
        put off by a variance of `put_off`, m2.
    """
    room = room_for(cloud.speed.shape[1])
    h, c, s = kernel_of(cloud, v, room)
    along, across, state, weight = measured.along, measured.across, room.state, cloud.weight[v]
    dx, dy = measured.x - room.mean[AHEAD], measured.y - room.mean[ASIDE]
    ahead, aside = dx * c + dy * s, dy * c - dx * s
    course = c, s
    c, s = measured.c * c + measured.s * s, measured.s * c - measured.c * s  # the errors' axes, in those of the course
    xx, xy, yy = along * c * c + across * s * s, (along - across) * c * s, along * s * s + across * c * c
    kernel = room.covariance
    if determinant_of(kernel, xx, xy, yy) < WIDE * WIDE * along * across:
        return 0.0
    kernel *= h * h
    fit, root, shrunk = room.product, math.sqrt(determinant_of(kernel, xx, xy, yy)), math.sqrt(1.0 - h * h)
    wider = math.sqrt(determinant_of(kernel, xx + put_off, xy, yy + put_off))
    scale, put_off = (1.0 - outlier) / (2.0 * math.pi * root), put_off / (root * root)
    xx, xy, yy = (
        (kernel[ASIDE, ASIDE] + yy) / root**2, -(kernel[AHEAD, ASIDE] + xy) / root**2,
        (kernel[AHEAD, AHEAD] + xx) / root**2,
    )  # fmt: skip
    beside, narrower = 0.0, root * root / (wider * wider)
    for p in range(fit.size):
        x, y = ahead - shrunk * state[AHEAD, p], aside - shrunk * state[ASIDE, p]
        q = xx * x * x + 2.0 * xy * x * y + yy * y * y
        fit[p] = scale * exp(-0.5 * q)
        beside += weight[p] * exp(-0.5 * narrower * (q + put_off * (x * x + y * y)))
    if not dot(weight, fit) >= max(least, leaves * beside / (2.0 * math.pi * wider)):
        return 0.0
    for p in range(fit.size):
        fit[p] += outlier * tail[p]
    density = dot(weight, fit)
    numbers, before = cloud.state[v].copy(), state.copy()
    random.fill_normals(room.normal, numbers)
    spread(room, h)
    for p in range(fit.size):
        weight[p] *= fit[p] / density
        if random.uniform(numbers) * fit[p] < outlier * tail[p]:
            for k in range(len(state)):
                state[k, p] = before[k, p]
        else:
            one, two = math.sqrt(along) * random.draw_normal(numbers), math.sqrt(across) * random.draw_normal(numbers)
            x, y = ahead - state[AHEAD, p] - one * c + two * s, aside - state[ASIDE, p] - one * s - two * c
            for k in range(len(state)):
                state[k, p] += (kernel[k, AHEAD] * xx + kernel[k, ASIDE] * xy) * x
                state[k, p] += (kernel[k, AHEAD] * xy + kernel[k, ASIDE] * yy) * y
    put(cloud, v, room, course[0], course[1])
    for word in range(numbers.size):  # a slice would compile numba's strings for its error
        cloud.state[v, word] = numbers[word]
    return float(density)


@pasted
def determinant_of(covariance: FloatArray, xx: float, xy: float, yy: float) -> float:
    """Of the places' covariance, with errors of another one."""
    across = covariance[AHEAD, ASIDE] + xy
    return float((covariance[AHEAD, AHEAD] + xx) * (covariance[ASIDE, ASIDE] + yy) - across * across)
