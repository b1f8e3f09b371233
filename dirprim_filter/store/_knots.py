"""Compiled choice of knots: of a way, the steps between which splines give all others back."""

import math

import numpy as np
from numba import njit

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.primitives._filling import _between, _wrapped
from tessellation._compiling import COMPILED


@njit(nogil=True, **COMPILED)
def knots_of(
    ends: BoolArray, lasts_ns: IntArray, position: FloatArray, direction: FloatArray, speed: FloatArray,
    within: FloatArray, most: int,
) -> BoolArray:  # fmt: skip
    """Where knots are: from the first step of each way on, each as far as the steps in between are given back.

    Args:
        ends: (n,) the last step of each way.
        lasts_ns: (n,) nanoseconds to the next.
        position: (n, 2) metres.
        direction: (n,) radians.
        speed: (n,) m/s.
        within: (3,) metres, radians and m/s.
        most: steps from a knot to the next.
    """
    chosen = np.zeros(ends.size, np.bool_)
    a = 0
    while a < ends.size:
        chosen[a] = True
        b = a + 1
        if not ends[a]:
            while not ends[b] and b - a < most and _given_back(a, b + 1, lasts_ns, position, direction, speed, within):
                b += 1
        a = b
    return chosen


@njit(**COMPILED)
def _given_back(
    a: int, b: int, lasts_ns: IntArray, position: FloatArray, direction: FloatArray, speed: FloatArray,
    within: FloatArray,
) -> bool:  # fmt: skip
    """Whether the steps between two are, by the spline."""
    state = np.empty(4)
    for i in range(b - 1, a, -1):
        _between(a, b, (b - a) * lasts_ns[a] * 1e-9, (i - a) * lasts_ns[a] * 1e-9, position, direction, speed, state)
        off = math.hypot(state[0] - position[i, 0], state[1] - position[i, 1])
        turned = abs(_wrapped(state[2] - direction[i]))
        if off > within[0] or turned > within[1] or abs(state[3] - speed[i]) > within[2]:
            return False
    return True
