"""Compiled arithmetic against exact oracles and numpy, samplers against their laws; nothing is rounded otherwise."""

import re
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError
from scipy import stats

from dirprim_filter.distributions import _arithmetic, _elementary, _random

ROOT = Path(__file__).parents[2]


@njit
def fused(a, b, c):
    return _arithmetic.fma(a, b, c)


@njit
def cubic(x):
    return _arithmetic.polynomial(x, (0.3, -0.7, 1.1, 0.9))


@njit
def sums(weight, one, two):
    return _arithmetic.weighted_sums(weight, (one, two))


def in_lanes(terms, n_lanes):
    """The slow way: each lane by itself, the lanes in pairs, the rows left over one by one."""
    whole = terms.size - terms.size % n_lanes
    lanes, rest = np.zeros(n_lanes), 0.0
    for row in terms[:whole].reshape(-1, n_lanes):
        lanes = lanes + row
    while lanes.size > 1:
        lanes = lanes[: lanes.size // 2] + lanes[lanes.size // 2 :]
    for term in terms[whole:]:
        rest += term
    return lanes[0] + rest


def test_a_fused_product_is_rounded_once_and_a_polynomial_is_horners_scheme_of_them():
    rng = np.random.default_rng(0)
    for a, b, far in rng.normal(size=(2000, 3)) * 10.0 ** rng.integers(-6, 6, size=(2000, 3)):
        c = far - a * b * rng.integers(2)  # where nearly all cancels, rounding twice shows
        assert fused(a, b, c) == float(Fraction(a) * Fraction(b) + Fraction(c))
    assert fused(1.0 + 2.0**-30, 1.0 - 2.0**-30, -1.0) == -(2.0**-60)  # and 0 if the product is rounded first
    for x in rng.normal(size=100):
        assert cubic(x) == fused(fused(fused(0.3, x, -0.7), x, 1.1), x, 0.9)


@pytest.mark.parametrize("n", [0, 1, 7, 8, 9, 16, 31, 32, 1000])
def test_sums_are_those_of_lanes_to_the_last_bit(n):
    weight, one, two = np.random.default_rng(n).normal(size=(3, n))
    expected = [in_lanes(terms, _arithmetic.LANES) for terms in (weight, weight * one, weight * two)]
    assert list(sums(weight, one, two)) == expected
    few = 2 * _arithmetic.LANES
    assert _arithmetic.total_of(weight) == in_lanes(weight, few)
    assert _arithmetic.dot(weight, one) == in_lanes(weight * one, few)


def test_only_contiguous_columns_are_taken():
    rows = np.zeros((20, 2))
    with pytest.raises(TypingError, match="expected contiguous columns"):
        _arithmetic.dot(rows[:, 0], rows[:, 1])


def test_no_kernel_lets_the_compiler_round_as_it_likes():
    """By `fastmath` results depend on what is inlined, hence on whether a run compiles or loads its kernels."""
    allowed = re.compile(r"""\bfastmath["']?\s*[=:]\s*(?!\s|False\b)""")
    assert all(allowed.search(said) for said in ("njit(fastmath=True)", "{'fastmath': {'contract'}}"))
    files = [*ROOT.glob("dirprim_filter/**/*.py"), *ROOT.glob("tessellation/**/*.py")]
    assert [path.name for path in files if allowed.search(path.read_text())] == []


def applied(function, x):
    return np.array([function(at) for at in x])


QUARTERS = np.pi / 2 * np.arange(-9, 10)
TURNS = np.concatenate([np.linspace(-7.0, 7.0, 20_001), np.linspace(-1e6, 1e6, 999), QUARTERS])
SMALL = np.geomspace(1e-150, 1e-3, 99)
NEAR_ONE = np.nextafter(1.0, [0.0, 2.0])


@pytest.mark.parametrize(
    ("function", "x", "expected", "rtol", "atol"),
    [
        (_elementary.exp, np.linspace(-649.9, 708.9, 20_001), np.exp, 1e-15, 0),
        (_elementary.exp, [0.0, -0.0, 1e-300, np.log(2) / 2, -np.log(2) / 2], np.exp, 1e-15, 0),
        (_elementary.log, np.geomspace(2.3e-308, 1.7e308, 20_001), np.log, 1e-15, 0),
        (_elementary.log, [1.0, 0.5, 2.0, np.sqrt(0.5), np.sqrt(2.0), *NEAR_ONE], np.log, 1e-15, 0),
        (_elementary.sin, TURNS, np.sin, 0, 1e-15),
        (_elementary.cos, TURNS, np.cos, 0, 1e-15),
        (_elementary.squared_sine, TURNS, lambda x: np.sin(x) ** 2, 0, 1e-15),
        (_elementary.squared_sine, SMALL, lambda x: np.sin(x) ** 2, 1e-14, 0),
    ],
)
def test_functions_err_by_less_than_1e_15_even_after_many_turns(function, x, expected, rtol, atol):
    np.testing.assert_allclose(applied(function, x), expected(np.asarray(x)), rtol=rtol, atol=atol)


def test_the_exponential_is_clamped_where_doubles_end():
    least = _elementary.exp(-650.0)
    assert applied(_elementary.exp, [-1e300, -np.inf]).tolist() == [least, least]
    assert least < 1e-280


FALSE_ALARM = 1e-4  # of each statistical test below; seeds are fixed


def drawn(sampler, n, *parameters, key=11):
    state = np.zeros(4, np.uint64)
    _random.seed_state(np.uint64(key), state)
    return np.array([sampler(*parameters, state) for _ in range(n)])


def turn(k):
    return k, *(float(number) for number in _random.wrapped_cauchy(np.float64(k)))


@pytest.mark.parametrize(
    ("sampler", "parameters", "law"),
    [
        (_random.uniform, (), stats.uniform()),
        (_random.draw_normal, (), stats.norm()),
        (_random.draw_gamma, (0.3,), stats.gamma(0.3)),
        (_random.draw_gamma, (1.0,), stats.gamma(1.0)),
        (_random.draw_gamma, (250.0,), stats.gamma(250.0)),
        (_random.draw_turn, turn(0.0), stats.uniform(-np.pi, 2 * np.pi)),
        (_random.draw_turn, turn(1e-7), stats.uniform(-np.pi, 2 * np.pi)),
        (_random.draw_turn, turn(0.5), stats.vonmises(0.5)),
        (_random.draw_turn, turn(9e3), stats.vonmises(9e3)),
        (_random.draw_turn, turn(1e6), stats.norm(scale=1e-3)),
        (_random.draw_turn, turn(1e300), stats.norm(scale=1e-150)),
    ],
)
def test_samplers_follow_their_law_and_no_neighbouring_one(sampler, parameters, law):
    sample = drawn(sampler, 50_000, *parameters)
    assert stats.kstest(sample, law.cdf).pvalue > FALSE_ALARM
    assert stats.kstest(sample + 0.05 * sample.std(), law.cdf).pvalue < FALSE_ALARM


def test_a_key_fixes_the_draws_and_another_changes_them():
    one, again, other = (drawn(_random.uniform, 10, key=key) for key in (5, 5, 6))
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, other)
