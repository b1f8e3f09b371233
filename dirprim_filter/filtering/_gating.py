"""Compiled: which detections lie in the gates of tracks."""

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from tessellation._compiling import compiled


@compiled
def nearest_in_gates(
    mean: FloatArray, covariance: FloatArray, position: FloatArray, noise: FloatArray, gate: float, out: IntArray
) -> None:
    """Fills (t, k): of each track the nearest k detections inside its ellipse, the nearest first, -1 where none is.

    The others are as of `association.gated`.
    """
    most, away = out.shape[1], np.empty(out.shape[1])
    for t in range(mean.shape[0]):
        n = 0
        for d in range(position.shape[0]):
            x, y = position[d, 0] - mean[t, 0], position[d, 1] - mean[t, 1]
            xx, yy = covariance[t, 0, 0] + noise[d, 0, 0], covariance[t, 1, 1] + noise[d, 1, 1]
            if not (x * x <= gate * xx and y * y <= gate * yy):  # the box about the ellipse
                continue
            xy = covariance[t, 0, 1] + noise[d, 0, 1]
            if not yy * x * x - 2.0 * xy * x * y + xx * y * y <= gate * (xx * yy - xy * xy):
                continue
            squared, place = x * x + y * y, n
            while place > 0 and away[place - 1] > squared:
                place -= 1
            if place == most:
                continue
            n = min(n + 1, most)
            for later in range(n - 1, place, -1):
                away[later], out[t, later] = away[later - 1], out[t, later - 1]
            away[place], out[t, place] = squared, d
        out[t, n:] = -1
