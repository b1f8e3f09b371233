"""How sure is a difference? Intervals over what is independent: vehicles, groups, drives or seeds, never rows.

A figure of two methods is a function of sums: of squared errors and their numbers, of scores, of densities. The sums
are kept for each cluster, the same cluster for both methods, so that every comparison is paired. Its interval is the
delete-one jackknife's over clusters with Student's t: for a mean of paired differences that is the paired t test, and
it holds for the few clusters of real data, where a bootstrap's interval is too narrow.

Source: Efron and Stein, The Jackknife Estimate of Variance, 1981; MacKinnon, Nielsen and Webb, Fast and reliable
jackknife and bootstrap methods for cluster-robust inference, 2023.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from dirprim_filter.arrays import AnyArray, FloatArray

PROBABILITY = 0.95
Statistic = Callable[[FloatArray], FloatArray]
"""Totals (..., k) -> (...): a figure as a function of sums."""


class Interval(NamedTuple):
    """A figure with its 95 % interval; NaN where fewer than two clusters leave none.

    Attributes:
        value: the figure of all clusters together.
        low: from,
        high: and to.
        n_clusters: that it was computed over.
    """

    value: float
    low: float
    high: float
    n_clusters: int

    @property
    def is_apart(self) -> bool:
        """Whether 0 lies beyond the interval: two methods are statistically distinguishable."""
        return self.low > 0.0 or self.high < 0.0

    def ends(self, form: str, scale: float = 1.0, unit: str = "") -> str:
        """Both times a scale, in this form, the lesser first."""
        if np.isnan(self.low):
            return "no interval"
        low, high = sorted((scale * self.low, scale * self.high))
        return f"{low:{form}} to {high:{form}}{unit}"

    @property
    def half_width(self) -> float:
        """Of the interval."""
        return 0.5 * (self.high - self.low)


def clustered(cluster: AnyArray, columns: Sequence[FloatArray] | FloatArray) -> FloatArray:
    """(c, k) sums of columns, k of (n,), over the rows of each cluster (n,), in ascending order of its name."""
    _, number = np.unique(cluster, return_inverse=True)
    return np.stack([np.bincount(number, column) for column in columns], axis=-1)


def interval(sums: FloatArray, statistic: Statistic) -> Interval:
    """The figure of all clusters, and its interval over them.

    Args:
        sums: (c, k) of each cluster.
        statistic: of totals.
    """
    n = len(sums)
    total = sums.sum(axis=0)
    value = float(statistic(total))
    without = statistic(total - sums)
    without = without[np.isfinite(without)]
    if n < 2 or without.size < n:
        return Interval(value, float("nan"), float("nan"), n)
    deviation = np.sqrt((n - 1.0) / n * ((without - without.mean()) ** 2).sum())
    half = float(student.ppf(0.5 + 0.5 * PROBABILITY, n - 1) * deviation)
    return Interval(value, value - half, value + half, n)


def mean_over(cluster: AnyArray, value: FloatArray) -> Interval:
    """The mean over rows (n,) with its interval over their clusters (n,); NaN of none."""
    return interval(clustered(cluster, [value, np.ones_like(value)]), mean)


def paired(cluster: AnyArray, first: FloatArray, other: FloatArray, statistic: Statistic) -> Interval:
    """One method beside another at the rows that both have (not NaN). (n,) each; the statistic is one of the next."""
    both = np.isfinite(first) & np.isfinite(other)
    ones = np.ones(int(both.sum()))
    return interval(clustered(cluster[both], [first[both], ones, other[both], ones]), statistic)


def difference_of_means(total: FloatArray) -> FloatArray:
    """Totals (..., 4) of a value and a number of one method and of another -> the first's mean less the other's."""
    return np.asarray(_ratio(total[..., 0], total[..., 1]) - _ratio(total[..., 2], total[..., 3]))


def reduction_of_mean(total: FloatArray) -> FloatArray:
    """Totals (..., 4), likewise -> the share by which the first's mean is below the other's."""
    return np.asarray(1.0 - _ratio(_ratio(total[..., 0], total[..., 1]), _ratio(total[..., 2], total[..., 3])))


def reduction_of_rmse(total: FloatArray) -> FloatArray:
    """Totals (..., 4) of squared errors and numbers, likewise -> the same of root mean squares."""
    return np.asarray(1.0 - np.sqrt(1.0 - reduction_of_mean(total)))


def mean(total: FloatArray) -> FloatArray:
    """Totals (..., 2) of a value and its number -> the mean."""
    return np.asarray(_ratio(total[..., 0], total[..., 1]))


def _ratio(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.divide(a, b, out=np.full(np.shape(a), np.nan), where=np.asarray(b) != 0), np.float64)
