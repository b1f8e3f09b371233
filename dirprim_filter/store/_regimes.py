"""Compiled regimes: for each cell a weight for each period that the present one may have begun in."""

import math

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from tessellation._compiling import COMPILED


@njit(nogil=True, **COMPILED)
def still_so(
    first: IntArray, mode: IntArray, period: IntArray, n_modes: int, n_periods: int, change: float, prior: float,
    alike: float,
) -> FloatArray:  # fmt: skip
    """(n,) see `regimes.still_so`; rows of cell k are from `first[k]` to `first[k + 1]`."""
    found, seen, holds = np.ones(mode.size), np.empty((n_periods, n_modes)), np.empty(n_periods)
    for k in range(first.size - 1):
        rows = range(first[k], first[k + 1])
        seen[:] = 0.0
        several = False
        for i in rows:
            seen[period[i], mode[i]] += 1.0
            several |= mode[i] != mode[first[k]]
        if not several:
            continue
        for p in range(n_periods):
            n = seen[p].sum()
            seen[p] /= 1.0 + max(n - 1.0, 0.0) * alike
        _held(seen, change, prior / n_modes, holds)
        for i in rows:
            found[i] = holds[period[i]]
    return found


@njit(**COMPILED)
def _held(seen: FloatArray, change: float, prior: float, holds: FloatArray) -> None:
    """Fills (n_periods,) the probability that the regime of the last period held in each. Counts (n_periods, m).

    A regime that began in period s has weight w[s]: its probability, and that of all that was seen since the first
    period. It goes on, or any of them is followed by one that begins; either foretells what is seen next.
    """
    n_periods, m = seen.shape
    log_w, since = np.zeros(n_periods), np.zeros((n_periods, m))
    for p in range(n_periods):
        if p > 0:
            most = log_w[:p].max()
            log_w[p] = most + math.log(np.exp(log_w[:p] - most).sum()) + math.log(change)
            log_w[:p] += math.log1p(-change)
        n = seen[p].sum()
        if n == 0.0:
            continue
        for s in range(p + 1):
            before = since[s].sum() + m * prior
            log_w[s] += math.lgamma(before) - math.lgamma(before + n)
            for j in range(m):
                if seen[p, j] > 0.0:
                    a = since[s, j] + prior
                    log_w[s] += math.lgamma(a + seen[p, j]) - math.lgamma(a)
                    since[s, j] += seen[p, j]
    w = np.exp(log_w - log_w.max())
    total = w.sum()
    held = 0.0
    for p in range(n_periods):
        held += w[p]
        holds[p] = held / total
