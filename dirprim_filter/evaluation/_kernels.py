"""Compiled scores of sampled forecasts: every pair of samples is looked at."""

import math

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray
from tessellation._compiling import COMPILED

MIN_BANDWIDTH_M = 0.1
"""Of the kernel density: logs are not exact to the centimetre, and a method that is must not win without bound."""
ASTRAY, ASTRAY_M = 0.01, 20.0
"""Of every method's density so large a share is spread so widely: a method that is sure of one point, as of a vehicle
that waits, and wrong once in a hundred times, must not lose without bound either."""


@njit(nogil=True, **COMPILED)
def score_samples(sample: FloatArray, truth: FloatArray, out: FloatArray) -> None:
    """Fills (n, 3) with energy score, negative log density and rank of the truth, (n, S, 2) samples, (n, 2) truths.

    The energy score is E|X - y| - E|X - X'| / 2 without bias. The density is a Gaussian kernel estimate with the
    samples' covariance times S^(-1/3) (Scott 1992) plus a square of `MIN_BANDWIDTH_M`; `ASTRAY` of it has kernels of
    `ASTRAY_M` instead. The rank is the share of samples
    denser than the truth, each by the kernels of all others: the truth lies in the highest-density region of that
    probability.
    """
    n_samples = sample.shape[1]
    for i in range(sample.shape[0]):
        of_sample = np.zeros(n_samples)
        xx, xy, yy = _inverse_bandwidth(sample[i])
        log_normaliser = math.log(2.0 * math.pi) - 0.5 * math.log(xx * yy - xy * xy)
        precision = 1.0 / ASTRAY_M**2
        near = far = density = 0.0
        for a in range(n_samples):
            dx, dy = sample[i, a, 0] - truth[i, 0], sample[i, a, 1] - truth[i, 1]
            near += math.hypot(dx, dy)
            density += math.exp(-0.5 * (xx * dx * dx + 2.0 * xy * dx * dy + yy * dy * dy))
            for b in range(a):
                dx, dy = sample[i, a, 0] - sample[i, b, 0], sample[i, a, 1] - sample[i, b, 1]
                far += math.sqrt(dx * dx + dy * dy)
                kernel = math.exp(-0.5 * (xx * dx * dx + 2.0 * xy * dx * dy + yy * dy * dy))
                of_sample[a] += kernel
                of_sample[b] += kernel
        out[i, 0] = near / n_samples - far / (n_samples * (n_samples - 1.0))
        fit = math.log1p(-ASTRAY) - log_normaliser + _log_mean(sample[i], truth[i], xx, xy, yy)
        astray = math.log(ASTRAY * precision / (2.0 * math.pi))
        astray += _log_mean(sample[i], truth[i], precision, 0.0, precision)
        high, low = max(fit, astray), min(fit, astray)
        out[i, 1] = -high - math.log1p(math.exp(low - high))
        mean = density / n_samples
        denser = 0
        for a in range(n_samples):
            denser += of_sample[a] / (n_samples - 1.0) > mean
        out[i, 2] = denser / n_samples


@njit(**COMPILED)
def _inverse_bandwidth(sample: FloatArray) -> tuple[float, float, float]:
    n = sample.shape[0]
    x = y = xx = xy = yy = 0.0
    for a in range(n):
        x += sample[a, 0] / n
        y += sample[a, 1] / n
    for a in range(n):
        dx, dy = sample[a, 0] - x, sample[a, 1] - y
        xx += dx * dx
        xy += dx * dy
        yy += dy * dy
    factor = n ** (-1.0 / 3.0) / (n - 1.0)
    xx, xy, yy = xx * factor + MIN_BANDWIDTH_M**2, xy * factor, yy * factor + MIN_BANDWIDTH_M**2
    determinant = xx * yy - xy * xy
    return yy / determinant, -xy / determinant, xx / determinant


@njit(**COMPILED)
def _log_mean(sample: FloatArray, truth: FloatArray, xx: float, xy: float, yy: float) -> float:
    """Log of the mean kernel at the truth, without its normaliser; finite however far away the samples are."""
    n = sample.shape[0]
    exponent = np.empty(n)
    top = -np.inf
    for a in range(n):
        dx, dy = sample[a, 0] - truth[0], sample[a, 1] - truth[1]
        exponent[a] = -0.5 * (xx * dx * dx + 2.0 * xy * dx * dy + yy * dy * dy)
        top = max(top, exponent[a])
    total = 0.0
    for a in range(n):
        total += math.exp(exponent[a] - top)
    return top + math.log(total / n)
