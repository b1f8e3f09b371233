"""Compiled EM of a von Mises mixture: rows in blocks, a mode at a time, so that loops become vector instructions."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions import _kernels as density
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._arithmetic import fma, weighted_sums
from dirprim_filter.distributions._elementary import exp, squared_sine
from tessellation._compiling import COMPILED

AT_ONCE = 256  # rows whose numbers, for a dozen modes, stay in the cache


class Angles(NamedTuple):
    """Directions with what every iteration needs of them, and how often each counts."""

    direction: FloatArray
    cosine: FloatArray
    sine: FloatArray
    weight: FloatArray


class Mixture(NamedTuple):
    """The parameters of the modes, changed in place."""

    weight: FloatArray
    mean: FloatArray
    concentration: FloatArray


@njit(nogil=True, **COMPILED)
def start(angles: Angles, key: np.uint64, mixture: Mixture) -> None:
    """Means on rows far from each other, drawn by the square of their chord (Arthur and Vassilvitskii 2007)."""
    state = np.empty(4, np.uint64)
    random.seed_state(key, state)
    chance, k = angles.weight.copy(), mixture.weight.size
    for m in range(k):
        left, row = random.uniform(state) * chance.sum(), -1
        for i in range(chance.size):
            if chance[i] > 0.0:
                row = i
                left -= chance[i]
                if left < 0.0:
                    break
        row = max(row, 0)  # none is left where there are fewer angles than modes
        mixture.weight[m], mixture.mean[m] = 1.0 / k, angles.direction[row]
        mixture.concentration[m] = 1.0 * k * k
        for i in range(chance.size):
            chord = 1.0 - angles.cosine[i] * angles.cosine[row] - angles.sine[i] * angles.sine[row]
            chance[i] = min(chance[i], angles.weight[i] * max(chord, 0.0))


@njit(nogil=True, **COMPILED)
def expectation_maximisation(
    angles: Angles,
    max_concentration: float,
    prior_strength: float,
    tolerance: float,
    mixture: Mixture,
    trace: FloatArray,
) -> tuple[int, bool]:
    """EM from the mixture given, in place; fills `trace` with each iteration's objective.

    Returns how many there were, and whether the last raised the mean objective by less than `tolerance`.
    """
    k, total = mixture.weight.size, 0.0
    for w in angles.weight:
        total += w
    sums = np.empty((k, 3))
    for iteration in range(trace.size):
        trace[iteration] = expectation(angles, mixture, sums)
        for m in range(k):
            if prior_strength > 0.0:
                kappa = mixture.concentration[m]
                trace[iteration] -= prior_strength * (kappa + math.log(density.i0e(kappa)))
        if iteration > 0 and trace[iteration] - trace[iteration - 1] < tolerance * total:
            return iteration + 1, True
        if iteration + 1 < trace.size:
            maximisation(sums, total, max_concentration, prior_strength, mixture)
    return trace.size, False


@njit(nogil=True, **COMPILED)
def expectation(angles: Angles, mixture: Mixture, sums: FloatArray) -> float:
    """Fill `sums` (k, 3) with each mode's responsibility, cosine and sine; returns the log likelihood."""
    k, n = mixture.weight.size, angles.direction.size
    log_p, norm, top = np.empty((k, AT_ONCE)), np.empty(AT_ONCE), np.empty(AT_ONCE)
    sums[:] = 0.0
    log_likelihood = 0.0
    for begin in range(0, n, AT_ONCE):
        stop = min(begin + AT_ONCE, n)
        size = stop - begin
        top[:] = -np.inf
        norm[:] = 0.0
        for m in range(k):
            constant = -1e300  # a mode of weight 0
            if mixture.weight[m] > 0.0:
                constant = math.log(mixture.weight[m]) - density.log_normaliser(mixture.concentration[m])
            _log_densities(
                angles.direction[begin:stop], mixture.mean[m], 2.0 * mixture.concentration[m], constant, log_p[m], top
            )
        for m in range(k):
            _densities(log_p[m], top, norm, size)
        weight, cosine, sine = angles.weight[begin:stop], angles.cosine[begin:stop], angles.sine[begin:stop]
        for i in range(size):
            log_likelihood += weight[i] * (top[i] + math.log(norm[i]))
            norm[i] = weight[i] / norm[i]
        for m in range(k):
            p = log_p[m, :size]
            for i in range(size):
                p[i] *= norm[i]
            total, c, s = weighted_sums(p, (cosine, sine))
            sums[m, 0] += total
            sums[m, 1] += c
            sums[m, 2] += s
    return log_likelihood


@njit(**COMPILED)
def _log_densities(
    direction: FloatArray, mean: float, width: float, constant: float, log_p: FloatArray, top: FloatArray
) -> None:
    for i in range(direction.size):
        log_p[i] = fma(-width, squared_sine(0.5 * (direction[i] - mean)), constant)
        top[i] = max(top[i], log_p[i])


@njit(**COMPILED)
def _densities(log_p: FloatArray, top: FloatArray, norm: FloatArray, size: int) -> None:
    for i in range(size):
        log_p[i] = exp(log_p[i] - top[i])
        norm[i] += log_p[i]


@njit(**COMPILED)
def maximisation(
    sums: FloatArray, total: float, max_concentration: float, prior_strength: float, mixture: Mixture
) -> None:
    """New parameters: the prior adds `prior_strength` angles without a direction to each mode."""
    for m in range(mixture.weight.size):
        n = sums[m, 0]
        mixture.weight[m] = n / total
        if n < 1e-290:
            mixture.weight[m] = 0.0
            if prior_strength > 0.0:
                mixture.concentration[m] = 0.0
            continue
        mixture.mean[m] = math.atan2(sums[m, 2], sums[m, 1])
        resultant = math.hypot(sums[m, 1], sums[m, 2]) / (n + prior_strength)
        mixture.concentration[m] = min(density.concentration_of(resultant), max_concentration)
