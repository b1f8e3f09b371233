"""Compiled: what lasts of a sensor's errors, which particles carry, and where their axes are; see `_measuring`."""

import math
from typing import NamedTuple

from numba import njit

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions._arithmetic import dot
from dirprim_filter.filtering._kernels import Carried, Cloud

X, Y, COURSE, PACE, AXIS, WHITE = range(6)
"""Columns of a measurement: metres; radians and m/s, NaN where not measured; the direction of the first axis, NaN where
it is each particle's own; the variances of white errors along both, m2, two columns."""
COSINE, SINE = 2, 3
"""Rows of `off`, the unit vector of the first axis, below metres along both axes."""
COURSE_FROM, COURSE_UNTIL = 0.95, 0.7
"""Resultants of a belief's directions from which on it has a course, and below which it has none any more.

Were the bias in the axes of each particle for good, it would be a lever: what it swings across would measure directions
far better than the motion's noise in them allows, for a body's heading is smooth.
"""


class Errors(NamedTuple):
    """A sensor's errors along both axes, beside white ones."""

    bias: tuple[float, float]  # m
    lasting: tuple[float, float]  # m2, variance of what lasts
    forgets: tuple[float, float]  # 1/s


@njit(cache=True, inline="always")
def lasting_share(z: FloatArray, errors: Errors, a: int) -> float:
    """Of the variance along an axis."""
    return float(errors.lasting[a] / (errors.lasting[a] + z[WHITE + a]))


@njit(cache=True, inline="always")
def lasting_variance(carried: Carried, v: int, errors: Errors, a: int) -> float:
    """Of the carried error by now: a Gauss-Markov process has kept a share."""
    kept = math.exp(-2.0 * carried.since_s[v] * errors.forgets[a])
    return float(kept * carried.variance[v, a] + (1.0 - kept) * errors.lasting[a])


@njit(cache=True, nogil=True)
def learn(
    cloud: Cloud, carried: Carried, v: int, z: FloatArray, errors: Errors, off: FloatArray, is_explained: bool
) -> None:
    """The carried error at the measurement's time, and corrected by what is left of it where the belief explains it."""
    for a in range(2):
        if errors.lasting[a] > 0.0:
            kept, variance = math.exp(-carried.since_s[v] * errors.forgets[a]), lasting_variance(carried, v, errors, a)
            gain = variance / (variance + z[WHITE + a]) if is_explained else 0.0
            carried.variance[v, a] = (1.0 - gain) * variance
            for p in range(off.shape[1]):
                carried.mean[v, p, a] = kept * carried.mean[v, p, a] + gain * off[a, p]
    if errors.bias[0] != 0.0 or errors.bias[1] != 0.0:
        update_course(cloud, carried, v, errors, off)


@njit(cache=True)
def course_of(weight: FloatArray, off: FloatArray) -> tuple[float, float]:
    """The unit vector of the belief's course; off (4, P) as `residuals` fills it."""
    c, s = dot(weight, off[COSINE]), dot(weight, off[SINE])
    length = max(math.hypot(c, s), 1e-9)
    return c / length, s / length


@njit(cache=True)
def update_course(cloud: Cloud, carried: Carried, v: int, errors: Errors, off: FloatArray) -> None:
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
        place[p, 0] += errors.bias[0] * dc - errors.bias[1] * ds
        place[p, 1] += errors.bias[0] * ds + errors.bias[1] * dc
