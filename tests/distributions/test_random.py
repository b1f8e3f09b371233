"""The compiled samplers against the laws that they are to follow."""

import numpy as np
import pytest
from numba import njit
from scipy import stats

from dirprim_filter.distributions import _random
from dirprim_filter.distributions._elementary import wrap

FALSE_ALARM = 1e-4  # of each statistical test below; seeds are fixed


@njit
def draws(kind, n, a, envelope, state):
    q, b = envelope
    out = np.empty(n)
    for i in range(n):
        if kind == 0:
            out[i] = _random.uniform(state)
        elif kind == 1:
            out[i] = _random.draw_normal(state)
        elif kind == 2:
            out[i] = _random.draw_gamma(a, state)
        else:
            out[i] = wrap(_random.draw_turn(a, q, b, state))
    return out


def drawn(kind, n, a=0.0, key=11):
    state = np.zeros(4, np.uint64)
    _random.seed_state(np.uint64(key), state)
    return draws(kind, n, float(a), tuple(float(each) for each in _random.wrapped_cauchy(np.float64(a))), state)


@pytest.mark.parametrize(
    ("kind", "a", "law"),
    [
        (0, 0, stats.uniform()),
        (1, 0, stats.norm()),
        (2, 0.3, stats.gamma(0.3)),
        (2, 1.0, stats.gamma(1.0)),
        (2, 250.0, stats.gamma(250.0)),
        (3, 0.0, stats.uniform(-np.pi, 2 * np.pi)),
        (3, 1e-7, stats.uniform(-np.pi, 2 * np.pi)),
        (3, 0.5, stats.vonmises(0.5)),
        (3, 9e3, stats.vonmises(9e3)),
        (3, 1e6, stats.norm(scale=1e-3)),
        (3, 1e300, stats.norm(scale=1e-150)),
    ],
)
def test_samplers_follow_their_law_and_no_neighbouring_one(kind, a, law):
    sample = drawn(kind, 50_000, a)
    assert stats.kstest(sample, law.cdf).pvalue > FALSE_ALARM
    assert stats.kstest(sample + 0.05 * law.std(), law.cdf).pvalue < FALSE_ALARM


def test_a_key_fixes_the_draws_and_another_changes_them():
    np.testing.assert_array_equal(drawn(0, 10, key=5), drawn(0, 10, key=5))
    assert not np.array_equal(drawn(0, 10, key=5), drawn(0, 10, key=6))
