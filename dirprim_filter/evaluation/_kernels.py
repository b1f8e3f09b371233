"""Compiled scores of sampled forecasts: every pair of samples is looked at."""

import math

import numpy as np

from dirprim_filter.arrays import FloatArray
from tessellation._compiling import compiled


@compiled
def score_samples(sample: FloatArray, truth: FloatArray, out: FloatArray) -> None:
    """Fills (n, 2) with energy score and rank of the truth, (n, S, 2) samples, (n, 2) truths.

    The energy score is E|X - y| - E|X - X'| / 2 without bias. The rank is the share of samples where density is higher
    than at the truth: if that is below a probability, the truth lies in the highest-density region of it. Density is
    that of the k-th nearest neighbour (Loftsgaarden and Quesenberry 1965), k the root of S, so it needs no bandwidth.
    Truth and samples are each other's neighbours alike: a truth drawn as the samples are has any rank equally often.
    """
    n = sample.shape[1]
    k = round(math.sqrt(n))
    apart = np.zeros((n + 1, n + 1))  # the last is the truth; to itself each is at 0, so the k-th nearest is at [k]
    for i in range(sample.shape[0]):
        between = 0.0
        for a in range(n):
            for b in range(a):
                dx, dy = sample[i, a, 0] - sample[i, b, 0], sample[i, a, 1] - sample[i, b, 1]
                apart[a, b] = apart[b, a] = math.sqrt(dx * dx + dy * dy)
                between += apart[a, b]
            apart[a, n] = apart[n, a] = math.hypot(sample[i, a, 0] - truth[i, 0], sample[i, a, 1] - truth[i, 1])
        out[i, 0] = apart[n].sum() / n - between / (n * (n - 1.0))
        of_truth = np.partition(apart[n], k)[k]
        denser = 0
        for a in range(n):
            denser += np.partition(apart[a], k)[k] < of_truth
        out[i, 1] = denser / n
