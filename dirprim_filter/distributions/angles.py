"""Angles are float64 radians; direction is counter-clockwise from east. Wrapping is a function."""

import numpy as np

from dirprim_filter.arrays import FloatArray

TWO_PI = 2.0 * np.pi


def wrap(angle: FloatArray) -> FloatArray:
    """The same angle in (-pi, pi], exact for angles that are there already. (...) -> (...).

    `arctan2(sin, cos)` and `mod(a + pi, 2 pi) - pi` give -pi for some inputs, and round inside the interval.
    """
    angle = np.asarray(angle, dtype=np.float64)
    inside = (angle > -np.pi) & (angle <= np.pi)
    if inside.all():
        return angle.copy()
    turned = np.pi - np.mod(np.pi - angle, TWO_PI)
    turned = np.where(turned <= -np.pi, np.pi, turned)
    return np.where(inside, angle, turned)


def difference(a: FloatArray, b: FloatArray) -> FloatArray:
    """The turn from `b` to `a` in (-pi, pi], radians. Broadcasts."""
    return wrap(np.asarray(a) - np.asarray(b))
