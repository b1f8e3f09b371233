"""Intervals over clusters against the paired t test, a slow loop, and their own coverage."""

import numpy as np
import pytest
from scipy import stats

from dirprim_filter.evaluation.intervals import (
    Interval,
    clustered,
    difference_of_means,
    interval,
    mean,
    reduction_of_mean,
    reduction_of_rmse,
)


def test_of_a_mean_of_paired_differences_it_is_the_paired_t_test_and_of_one_cluster_none():
    a, b = np.random.default_rng(0).normal(size=(2, 9))
    ones = np.ones(9)
    found = interval(np.column_stack([a, ones, b, ones]), difference_of_means)
    expected = stats.ttest_rel(a, b).confidence_interval(0.95)
    assert found.value == pytest.approx((a - b).mean())
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))
    found = interval(np.array([[2.0, 1.0, 1.0, 1.0]]), difference_of_means)
    assert found.value == 1.0
    assert np.isnan(found.low)
    assert not found.is_apart
    assert found.ends(".0f", unit=" %") == "no interval"
    assert Interval(-1.0, -1.5, -0.25, 3).ends(".0f", -100.0, " %") == "25 to 150 %"
    assert Interval(1.0, 0.5, 1.5, 3).is_apart
    assert Interval(-1.0, -1.5, -0.5, 3).is_apart
    assert not Interval(1.0, -0.5, 2.5, 3).is_apart


def test_sums_are_of_clusters_and_the_statistics_are_what_a_loop_says():
    rng = np.random.default_rng(1)
    cluster = rng.integers(5, size=60).astype(str)
    error, other = rng.gamma(2.0, 1.0, (2, 60))
    ones = np.ones(60)
    sums = clustered(cluster, [error**2, ones, other**2, ones])
    for name, row in zip(np.unique(cluster), sums, strict=True):
        own = cluster == name
        assert row == pytest.approx([(error[own] ** 2).sum(), own.sum(), (other[own] ** 2).sum(), own.sum()])
    rmse, of_other = np.sqrt((error**2).mean()), np.sqrt((other**2).mean())
    assert interval(sums, reduction_of_rmse).value == pytest.approx(1 - rmse / of_other)
    assert interval(sums, reduction_of_mean).value == pytest.approx(1 - (rmse / of_other) ** 2)
    assert interval(sums[:, :2], mean).value == pytest.approx(rmse**2)


def coverage(n_clusters, *, by_row, n_trials=400):
    """Share of 95 % intervals that hold the true difference of 0, of rows that share their cluster's deviation."""
    rng = np.random.default_rng(2)
    held = 0
    for _ in range(n_trials):
        n = 10 * n_clusters
        cluster = np.repeat(np.arange(n_clusters), 10)
        off = rng.normal(size=n_clusters)[cluster] + 0.3 * rng.normal(size=n)
        named = np.arange(n) if by_row else cluster
        found = interval(clustered(named, [off, np.ones(n), np.zeros(n), np.ones(n)]), difference_of_means)
        held += not found.is_apart
    return held / n_trials


@pytest.mark.parametrize("n_clusters", [4, 30])
def test_nineteen_of_twenty_intervals_hold_the_truth_and_by_rows_far_fewer(n_clusters):
    # 400 trials at .95: standard deviation .011; 4 of them below is a false alarm of 1 in 30,000
    assert coverage(n_clusters, by_row=False) > 0.95 - 4 * 0.011
    assert coverage(n_clusters, by_row=True) < 0.7  # the negative control: rows of a cluster are not independent
