"""Since when vehicles share themselves out as now: as all histories together say, and the worth of knowing it."""

from itertools import product

import numpy as np
import pytest
from scipy.special import gammaln

from dirprim_filter.store import regimes
from dirprim_filter.store.regimes import ALIKE, N_PERIODS, PRIOR, Periods, still_so

DAY_S = 24 * 3600.0


def of_all_histories(seen, change):
    """(periods,) the probability that the last regime held: every set of periods in which one may begin, by itself."""
    n, m = seen.shape
    total, holds = 0.0, np.zeros(n)
    for begins in product([False, True], repeat=n - 1):
        starts = [0, *(1 + i for i, new in enumerate(begins) if new)]
        p = change ** sum(begins) * (1 - change) ** (n - 1 - sum(begins))
        for a, b in zip(starts, [*starts[1:], n], strict=True):
            k = seen[a:b].sum(axis=0)
            p *= np.exp(gammaln(PRIOR) - gammaln(PRIOR + k.sum()) + (gammaln(k + PRIOR / m) - gammaln(PRIOR / m)).sum())
        total += p
        holds[starts[-1] :] += p
    return holds / total


def test_it_is_what_all_histories_together_say():
    rng = np.random.default_rng(0)
    for change in (0.02, 0.4):
        n = rng.integers(0, 4, (2, 7, 3))
        cell, period, mode = (np.repeat(index.ravel(), n.ravel()) for index in np.indices(n.shape))
        found = still_so(cell, mode, period + N_PERIODS - 7, change=change, n_modes=3)
        for k in range(2):
            of_day = n[k].sum(axis=1, keepdims=True)
            known = of_all_histories(n[k] / (1 + np.maximum(of_day - 1, 0) * ALIKE), change)
            # What nothing was seen in before changes nothing: the first regime began then or later.
            np.testing.assert_allclose(found[cell == k], known[period[cell == k]], rtol=1e-9)


def excess(day, mode, half_life_s, truth, weigh):
    """Nat that the shares of two modes by weighted vehicles lose on the true ones, 120 days having gone by."""
    count = np.bincount(mode, weigh(day, mode, half_life_s), 2) + 0.5
    return float((truth * np.log(truth / (count / count.sum()))).sum())


def by_regimes(day, mode, half_life_s):
    periods = Periods.of(24 * (119 - day), half_life_s)
    return still_so(np.zeros(day.size, int), mode, periods.of_vehicle, change=periods.change, n_modes=2)


def by_age(day, mode, half_life_s):
    return 0.5 ** ((119 - day) * DAY_S / half_life_s)


def by_all(day, mode, half_life_s):
    return np.ones(day.size)


def by_last_day(day, mode, half_life_s):
    return (day == 119).astype(float)


def lost(share, weigh, seed, *, rate=6, half_life_days=10):
    rng = np.random.default_rng(seed)
    day = np.repeat(np.arange(120), rng.poisson(rate, 120))
    mode = (rng.random(day.size) < share[day]).astype(int)
    return excess(day, mode, half_life_days * DAY_S, np.array([1 - share[-1], share[-1]]), weigh)


@pytest.mark.parametrize("half_life_days", [10, 30])
def test_a_street_that_turned_around_is_known_from_its_first_vehicles_on(half_life_days):
    """Twenty seeds each; days alone, all of them, and age lose more."""
    share = np.where(np.arange(120) >= 110, 0.99, 0.01)
    of = {
        weigh: np.mean([lost(share, weigh, seed, half_life_days=half_life_days) for seed in range(20)])
        for weigh in (by_regimes, by_age, by_all, by_last_day)
    }
    assert of[by_regimes] < 0.05
    assert of[by_age] > of[by_regimes] + 0.4
    assert of[by_all] > of[by_regimes] + 1.0
    assert of[by_last_day] > of[by_regimes] + 0.02


@pytest.mark.parametrize("rate", [6, 300])
def test_where_nothing_changes_next_to_nothing_is_forgotten(rate):
    """Not where days differ by more than chance either, nor by the week."""
    usual = np.full(120, 0.3)
    noisy = np.clip(0.3 + 0.1 * np.random.default_rng(1).standard_normal(120), 0.05, 0.95)
    week = np.where(np.arange(120) % 7 >= 5, 0.5, 0.22)
    for share in (usual, np.append(noisy[:-1], 0.3), np.append(week[:-1], 0.3)):
        cost = [lost(share, by_regimes, seed, rate=rate) - lost(share, by_all, seed, rate=rate) for seed in range(20)]
        assert np.mean(cost) < 0.02


def test_in_a_cell_of_one_mode_there_is_nothing_to_forget():
    day = np.arange(120)
    np.testing.assert_array_equal(by_regimes(day, np.ones(120, int), 10 * DAY_S), 1.0)
    two = by_regimes(day, (day >= 60).astype(int), 10 * DAY_S)
    assert two[0] < 1e-6 < two[-1]


def test_periods_are_counted_back_from_now():
    periods = Periods.of(np.array([0, 23, 24, 10**6, -5]), 10 * DAY_S)
    np.testing.assert_array_equal(N_PERIODS - 1 - periods.of_vehicle, [0, 0, 1, N_PERIODS - 1, 0])
    assert (1 - periods.change) ** 10 == pytest.approx(0.5)
    long = Periods.of(np.array([47, 48]), 32 * DAY_S)
    np.testing.assert_array_equal(N_PERIODS - 1 - long.of_vehicle, [0, 1])
    assert (1 - long.change) ** regimes.PER_HALF_LIFE == pytest.approx(0.5)
