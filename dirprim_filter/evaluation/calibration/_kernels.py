"""Compiled: the Kalman filter of `self_calibration`, which a likelihood asks for some two hundred times."""

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from tessellation._compiling import compiled, pasted


@compiled
def misfits(
    step_s: FloatArray, position: FloatArray, length: IntArray, held: FloatArray, kept: FloatArray, start: FloatArray,
    white: float, off: FloatArray, spread: FloatArray,
) -> None:  # fmt: skip
    """Filter place, speed, acceleration and lasting error of all pieces; the acceleration is held during a step.

    Args:
        step_s: (n, w) seconds since the row before, of each row of each piece.
        position: (n, w) metres.
        length: (w,) rows of each piece, descending.
        held: (n, w) share of an acceleration that a step keeps.
        kept: (n, w) share of a lasting error that it keeps.
        start: (k, 4) variances of the state, of as many filters.
        white: of white errors, m2.
        off: (n, k, w) is filled with what the prediction misses by.
        spread: (n, k, w) is filled with its variance.
    """
    n, w = position.shape
    room = np.empty((7, 4, w))
    x, c, shared, gain = room[0], room[1:5], room[5], room[6]
    for k in range(len(start)):
        room[:] = 0.0
        for a in range(4):
            c[a, a] = start[k, a]
        moving, lasting = start[k, 2], start[k, 3]
        for i in range(n):
            while w and length[w - 1] <= i:
                w -= 1
            if i:
                move_on(x, step_s[i], held[i], kept[i], w)
                for a in range(4):
                    move_on(c[:, a], step_s[i], held[i], kept[i], w)
                for a in range(4):
                    move_on(c[a], step_s[i], held[i], kept[i], w)
                for j in range(w):
                    c[2, 2, j] += moving * (1.0 - held[i, j] * held[i, j])
                    c[3, 3, j] += lasting * (1.0 - kept[i, j] * kept[i, j])
            for a in range(4):  # with the measurement: the place and the lasting error
                for j in range(w):
                    shared[a, j] = c[0, a, j] + c[3, a, j]
            for j in range(w):
                spread[i, k, j] = shared[0, j] + shared[3, j] + white
                off[i, k, j] = position[i, j] - x[0, j] - x[3, j]
            for a in range(4):
                for j in range(w):
                    gain[a, j] = shared[a, j] / spread[i, k, j]
                    x[a, j] += gain[a, j] * off[i, k, j]
            for a in range(4):
                for b in range(4):
                    for j in range(w):
                        c[a, b, j] -= gain[a, j] * shared[b, j]
        w = position.shape[1]


@pasted
def move_on(state: FloatArray, step_s: FloatArray, held: FloatArray, kept: FloatArray, w: int) -> None:
    """Move rows (4, w) of place, speed, acceleration and lasting error by a step."""
    for j in range(w):
        h = step_s[j]
        state[0, j] += h * state[1, j] + 0.5 * (h * h) * state[2, j]
        state[1, j] += h * state[2, j]
        state[2, j] *= held[j]
        state[3, j] *= kept[j]
