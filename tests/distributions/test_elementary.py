"""The vectorisable functions against numpy."""

import numpy as np
import pytest
from numba import njit

from dirprim_filter.distributions import _elementary


@njit
def applied(which, x):
    out = np.empty(x.size)
    for i in range(x.size):
        if which == 0:
            out[i] = _elementary.exp(x[i])
        elif which == 1:
            out[i] = _elementary.log(x[i])
        elif which == 2:
            out[i] = _elementary.squared_sine(x[i])
        elif which == 3:
            out[i] = _elementary.sin(x[i])
        else:
            out[i] = _elementary.cos(x[i])
    return out


NEAR_ONE = np.nextafter(1.0, [0.0, 2.0])


@pytest.mark.parametrize(
    ("which", "x", "expected"),
    [
        (0, np.linspace(-649.9, 708.9, 20_001), np.exp),
        (0, np.array([0.0, -0.0, 1e-300, np.log(2) / 2, -np.log(2) / 2]), np.exp),
        (1, np.geomspace(2.3e-308, 1.7e308, 20_001), np.log),
        (1, np.array([1.0, 0.5, 2.0, np.sqrt(0.5), np.sqrt(2.0), *NEAR_ONE]), np.log),
    ],
)
def test_relative_error_is_below_1e_15(which, x, expected):
    np.testing.assert_allclose(applied(which, x), expected(x), rtol=1e-15, atol=0)


def test_the_squared_sine_errs_by_less_than_1e_15_even_after_many_turns():
    x = np.concatenate([np.linspace(-7.0, 7.0, 20_001), np.linspace(-1e6, 1e6, 999), np.pi * np.arange(-9, 10) / 2])
    np.testing.assert_allclose(applied(2, x), np.sin(x) ** 2, atol=1e-15)
    small = np.geomspace(1e-150, 1e-3, 99)
    np.testing.assert_allclose(applied(2, small), np.sin(small) ** 2, rtol=1e-14)


@pytest.mark.parametrize(("which", "expected"), [(3, np.sin), (4, np.cos)])
def test_sine_and_cosine_err_by_less_than_1e_15_even_after_many_turns(which, expected):
    quarters = np.pi / 2 * np.arange(-9, 10)
    x = np.concatenate([np.linspace(-7.0, 7.0, 20_001), np.linspace(-1e6, 1e6, 999), quarters])
    np.testing.assert_allclose(applied(which, x), expected(x), rtol=0, atol=1e-15)


def test_the_exponential_is_clamped_where_doubles_end():
    np.testing.assert_array_equal(applied(0, np.array([-1e300, -np.inf])), applied(0, np.array([-650.0, -650.0])))
    assert applied(0, np.array([-650.0]))[0] < 1e-280
