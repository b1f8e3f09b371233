"""How bodies are turned: unit quaternions (x, y, z, w), which turn a vector of the body's axes into its frame's.

Body axes: x forward, y left, z up (REP 103); the heading is the direction of x on the plane.
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import FloatArray

STANDING_SPEED = 1e-3
"""Below this speed, m/s, the direction of a velocity is rounding error."""


def rotated(orientation: FloatArray, vector: FloatArray) -> FloatArray:
    """(n, 3) vectors of the bodies' axes in the axes of their frame.

    Args:
        orientation: (n, 4) quaternions of any length; one of length 0, which is not set, turns nothing.
        vector: (n, 3).
    """
    length = np.sqrt(np.square(orientation).sum(axis=-1))
    unset = length == 0
    x, y, z, w = orientation.T / np.where(unset, 1.0, length)
    w = np.where(unset, 1.0, w)
    a, b, c = vector.T
    # v + 2 u x (u x v + w v), written out: numpy's cross is slow
    p, q, r = y * c - z * b + w * a, z * a - x * c + w * b, x * b - y * a + w * c
    return np.stack([a + 2 * (y * r - z * q), b + 2 * (z * p - x * r), c + 2 * (x * q - y * p)], axis=-1)


def heading(orientation: FloatArray) -> FloatArray:
    """(n,) direction of the body's x axis, radians; NaN where the orientation is not set or points up."""
    x, y, z, w = orientation.T
    east, north = w * w + x * x - y * y - z * z, 2 * (x * y + w * z)
    return np.where((east == 0) & (north == 0), np.nan, np.arctan2(north, east))


def course(velocity: FloatArray, standing: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n,) direction and (n,) speed of velocities (n, 3); who stands has no course, `standing` stands in."""
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    direction = np.arctan2(velocity[:, 1], velocity[:, 0])
    return np.where(speed < STANDING_SPEED, standing, direction), speed
