"""Two methods gap by gap: each vehicle is out of the sight of both for the same time, so they are compared there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.evaluation.experiment import MethodResult

N_REDRAWN = 2000
INTERVAL = (0.025, 0.975)
SEED = 0
"""Seed of the bootstrap: the same results give the same interval."""


class GapComparison(NamedTuple):
    """One method beside another.

    Attributes:
        n: gaps in which both had an estimate.
        nearer: share of them in which the first has the smaller root mean square error.
        less_m: metres by which its root mean square error over all of them is smaller.
        low_m: the same, the 95 % interval of the bootstrap over gaps (Efron 1979), from
        high_m: and to. Gaps of one group share its traffic: between groups the spread is wider.
    """

    n: int
    nearer: float
    less_m: float
    low_m: float
    high_m: float


def compare_gaps(first: MethodResult, other: MethodResult) -> GapComparison | None:
    """The first method beside the other, over all seeds; None where no gap can be compared."""
    a, b = (np.concatenate([report.gap_rmse for report in result.reports]) for result in (first, other))
    known = ~(np.isnan(a) | np.isnan(b))
    squared = np.stack([b[known], a[known]]) ** 2
    n = squared.shape[1]
    if n == 0:
        return None
    drawn = np.random.default_rng(SEED).integers(n, size=(N_REDRAWN, n))
    redrawn = np.sqrt(squared[:, drawn].mean(axis=-1))
    low, high = np.quantile(redrawn[0] - redrawn[1], INTERVAL)
    root = np.sqrt(squared.mean(axis=1))
    return GapComparison(n, float((squared[1] < squared[0]).mean()), float(root[0] - root[1]), float(low), float(high))
