"""Compiled weighing where a vehicle did what no particle did: the transition model has outliers too.

A particle that stands two metres beyond where its vehicle stopped stays there, and so do all others: they are equally
far off, so none is preferred. But now and then a vehicle leaves its motion model: its place is off by a Gaussian of
`PLACE_M` in each axis, and its speed by one of `SPEED` that goes with how far it is ahead. A particle is weighed by the
mixture of both, (1 - e) N(z; x, R) + e N(z; x, R + PLACE_M^2), and by their shares either stays, or is drawn from the
Gaussian of the outlier given the measurement. A belief that is sure and wrong then takes a few measurements to mend.

Source: Fox, Outliers in time series, 1972, for innovation outliers, against additive ones, which are a sensor's; Liu
and Chen, Sequential Monte Carlo methods for dynamic systems, 1998, for drawing from a transition given the measurement.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._elementary import cos, exp, sin, wrap
from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.filtering._kernels import Cloud
from dirprim_filter.filtering._measuring import DIRECTION, SPEED, XX, XY, YY, Noise, X, Y, weigh_motion
from dirprim_filter.primitives._manoeuvres import STANDING_BELOW

PLACE_M, SPEED_OFF, TOGETHER = 1.0, 2.0, 0.7
"""Metres, m/s, and their correlation: an acceleration of 2 m/s^2 beside the model's, for a second."""
DENSEST = 1.0 / (2.0 * math.pi * PLACE_M**2)
"""Per square metre, of a measurement under an outlier at most."""
LEAST_SHARE = 0.01
"""Of the particles, that outliers explain: of beliefs in which fewer do they are left out."""


class Astray(NamedTuple):
    """What a measurement of covariance R says about an outlier: gain G = K (K + R)^-1 of K = PLACE_M^2 I."""

    scale: float  # 1/m2, density of no distance
    gxx: float
    gxy: float
    gyy: float
    lxx: float  # root of K - G K
    lyx: float
    lyy: float


@njit(cache=True, nogil=True)
def weigh(
    cloud: Cloud, vehicle: IntArray, before: FloatArray, measured: FloatArray, share: FloatArray, noise: Noise
) -> None:  # fmt: skip
    """Weigh each vehicle's particles, of weights `before` (V, P), a `share` (V,) of which are outliers a priori."""
    for i in range(vehicle.size):
        v, z, e, k = vehicle[i], measured[i], share[i], PLACE_M * PLACE_M
        weight, position, astray = cloud.weight[v], cloud.position[v], outlier_of(z)
        scale, state = noise.kept * math.sqrt(z[XX] * z[YY] - z[XY] * z[XY]) / (2.0 * math.pi), cloud.state[v].copy()
        for p in range(weight.size):
            x, y = z[X] - position[p, 0], z[Y] - position[p, 1]
            fit = (1.0 - e) * (scale * exp(-0.5 * (x * (z[XX] * x + 2.0 * z[XY] * y) + z[YY] * y * y)) + noise.outlier)
            east, north = astray.gxx * x + astray.gxy * y, astray.gxy * x + astray.gyy * y
            far = e * noise.kept * astray.scale * exp(-0.5 * (x * east + y * north) / k)
            both = fit + far
            weight[p] = before[i, p] * both if both < np.inf else 0.0  # it has run off to where there are no numbers
            if random.uniform(state) * both < far:
                one, two = random.draw_normal(state), random.draw_normal(state)
                displace(cloud, v, p, east + astray.lxx * one, north + astray.lyx * one + astray.lyy * two, state)
        for word in range(state.size):
            cloud.state[v, word] = state[word]
        weigh_motion(cloud, v, z[DIRECTION], z[SPEED], noise)


@njit(cache=True)
def outlier_of(z: FloatArray) -> Astray:
    """Of a measurement."""
    k, determinant = PLACE_M * PLACE_M, z[XX] * z[YY] - z[XY] * z[XY]
    xx, xy, yy = k + z[YY] / determinant, -z[XY] / determinant, k + z[XX] / determinant
    wide = xx * yy - xy * xy
    gxx, gxy, gyy = k * yy / wide, -k * xy / wide, k * xx / wide
    lxx = math.sqrt(k - gxx * k)
    lyx = -gxy * k / lxx
    return Astray(
        1.0 / (2.0 * math.pi * math.sqrt(wide)), gxx, gxy, gyy, lxx, lyx, math.sqrt(max(k - gyy * k - lyx * lyx, 0.0))
    )


@njit(cache=True)
def displace(cloud: Cloud, v: int, p: int, east: float, north: float, state: UIntArray) -> None:
    """Move a particle, and draw its velocity given by how far. Who stands keeps standing."""
    cloud.position[v, p, 0] += east
    cloud.position[v, p, 1] += north
    theta, pace = cloud.direction[v, p], cloud.speed[v, p]
    if pace >= STANDING_BELOW:
        c, s, alone = cos(theta), sin(theta), math.sqrt(1.0 - TOGETHER * TOGETHER)
        ahead = SPEED_OFF * (TOGETHER * (east * c + north * s) / PLACE_M + alone * random.draw_normal(state))
        aside = SPEED_OFF * (TOGETHER * (north * c - east * s) / PLACE_M + alone * random.draw_normal(state))
        cloud.direction[v, p] = wrap(theta + aside / (pace + SPEED_OFF))
        cloud.speed[v, p] = max(pace + ahead, 0.0)
