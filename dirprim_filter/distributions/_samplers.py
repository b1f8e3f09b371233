"""Compiled draws from arrays of distributions, a stream of random numbers for each block of rows."""

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._blocks import ROWS
from dirprim_filter.distributions._kernels import wrap
from dirprim_filter.distributions._random import UIntArray
from tessellation._compiling import COMPILED


@njit(nogil=True, **COMPILED)
def draw_von_mises(mean: FloatArray, concentration: FloatArray, key: UIntArray, out: FloatArray) -> None:
    """Fill `out` (n,) with a draw from each von Mises, radians in (-pi, pi]."""
    state = np.empty(4, np.uint64)
    for i in range(out.size):
        if i % ROWS == 0:
            random.seed_state(key[i // ROWS], state)
        out[i] = wrap(random.draw_von_mises(mean[i], concentration[i], state))


@njit(nogil=True, **COMPILED)
def draw_mixtures(
    weight: FloatArray,
    mean: FloatArray,
    concentration: FloatArray,
    start: int,
    key: UIntArray,
    direction: FloatArray,
    mode: IntArray,
) -> None:
    """Fill `direction` and `mode` (n,); the mixtures (K, M) take turns, from number `start` modulo K on."""
    state = np.empty(4, np.uint64)
    n_mixtures, n_modes = weight.shape
    q, b = np.empty((n_mixtures, n_modes)), np.empty((n_mixtures, n_modes))
    for c in range(n_mixtures):
        for m in range(n_modes):
            q[c, m], b[c, m] = random.wrapped_cauchy(concentration[c, m])
    c = start % n_mixtures
    for i in range(direction.size):
        if i % ROWS == 0:
            random.seed_state(key[i // ROWS], state)
        left, m = random.uniform(state), 0
        for candidate in range(n_modes):  # rounding may leave a sliver over: it goes to the last mode that has weight
            if weight[c, candidate] > 0.0:
                m = candidate
                left -= weight[c, candidate]
                if left < 0.0:
                    break
        direction[i] = wrap(mean[c, m] + random.draw_turn(concentration[c, m], q[c, m], b[c, m], state))
        mode[i] = m
        c = c + 1 if c + 1 < n_mixtures else 0
