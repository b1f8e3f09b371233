"""The compiled twins against scipy."""

import numpy as np
import pytest
from numba import njit
from scipy import special, stats

from dirprim_filter.distributions import _kernels, _random, von_mises

FALSE_ALARM = 1e-4  # of each statistical test below; seeds are fixed


@njit
def draws(kind, n, a, b, state):
    out = np.empty(n)
    for i in range(n):
        if kind == 0:
            out[i] = _random.uniform(state)
        elif kind == 1:
            out[i] = _random.draw_normal(state)
        elif kind == 2:
            out[i] = _random.draw_gamma(a, state)
        elif kind == 3:
            out[i] = _random.draw_poisson(a, state)
        else:
            out[i] = _kernels.wrap(_random.draw_von_mises(a, b, state))
    return out


def drawn(kind, n, a=0.0, b=0.0, key=11):
    state = np.zeros(4, np.uint64)
    _random.seed_state(np.uint64(key), state)
    return draws(kind, n, float(a), float(b), state)


@pytest.mark.parametrize(
    ("ours", "theirs", "lowest"),
    [
        (_kernels.i0e, special.i0e, 1e-6),
        (_kernels.i1e, special.i1e, 1e-3),
        (_kernels.digamma, special.digamma, 1e-3),
        (_kernels.trigamma, lambda x: special.polygamma(1, x), 1e-3),
    ],
)
def test_special_functions(ours, theirs, lowest):
    x = np.logspace(np.log10(lowest), 6, 500)
    np.testing.assert_allclose([ours(v) for v in x], theirs(x), rtol=1e-12, atol=1e-13)


def test_concentration_and_its_numpy_twin():
    resultant = np.concatenate([[0.0], np.linspace(1e-6, 1 - 1e-9, 300), [1.0]])
    twin = von_mises.concentration_of(resultant)
    np.testing.assert_allclose([_kernels.concentration_of(r) for r in resultant], twin, rtol=1e-7)


def test_gamma_shape_inverts_its_spread():
    shape = np.logspace(-1, 3.9, 200)
    spread = np.log(shape) - special.digamma(shape)
    np.testing.assert_allclose([_kernels.gamma_shape(s, 1e-2, 1e4) for s in spread], shape, rtol=1e-8)


def test_gamma_shape_is_bounded_without_spread_and_with_too_much():
    assert _kernels.gamma_shape(0.0, 1.0, 1e3) == 1e3
    assert _kernels.gamma_shape(50.0, 1.0, 1e3) == 1.0


@pytest.mark.parametrize(
    ("kind", "a", "b", "law"),
    [
        (0, 0, 0, stats.uniform()),
        (1, 0, 0, stats.norm()),
        (2, 0.3, 0, stats.gamma(0.3)),
        (2, 1.0, 0, stats.gamma(1.0)),
        (2, 250.0, 0, stats.gamma(250.0)),
        (4, 1.0, 0.0, stats.uniform(-np.pi, 2 * np.pi)),
        (4, 0.0, 0.5, stats.vonmises(0.5)),
        (4, 0.0, 50.0, stats.vonmises(50.0)),
        (4, 0.0, 9e3, stats.vonmises(9e3)),
        (4, 0.0, 5e4, stats.norm(scale=5e4**-0.5)),
    ],
)
def test_samplers_follow_their_law_and_no_neighbouring_one(kind, a, b, law):
    sample = drawn(kind, 50_000, a, b)
    assert stats.kstest(sample, law.cdf).pvalue > FALSE_ALARM
    assert stats.kstest(sample + 0.05 * law.std(), law.cdf).pvalue < FALSE_ALARM


@pytest.mark.parametrize("mean", [0.5, 9.9, 10.1, 900.0])
def test_poisson_sampler(mean):
    def p_value(sample):
        expected = sample.size * stats.poisson(mean).pmf(np.arange(int(sample.max()) + 1))
        seen = np.bincount(sample.astype(int))
        common = expected > 20
        return stats.chi2.sf((((seen - expected)[common] ** 2) / expected[common]).sum(), common.sum() - 1)

    assert p_value(drawn(3, 50_000, mean)) > FALSE_ALARM
    assert p_value(drawn(3, 50_000, mean * 1.1)) < FALSE_ALARM


def test_a_key_fixes_the_draws_and_another_changes_them():
    np.testing.assert_array_equal(drawn(0, 10, key=5), drawn(0, 10, key=5))
    assert not np.array_equal(drawn(0, 10, key=5), drawn(0, 10, key=6))
