"""Compiled elementary functions and estimates against numpy and scipy."""

import numpy as np
import pytest
from numba import njit
from scipy import special

from dirprim_filter.distributions import von_mises
from dirprim_filter.primitives import _elementary, _maximisation


@njit
def each(which, x):
    out = np.empty(x.size)
    for i in range(x.size):
        if which == 0:
            out[i] = _elementary.exp_of(x[i])
        elif which == 1:
            out[i] = _elementary.log_of(x[i])
        elif which == 2:
            out[i] = _elementary.sin_of(x[i])
        else:
            out[i] = _elementary.cos_of(x[i])
    return out


@pytest.mark.parametrize(
    ("which", "theirs", "x"),
    [
        (0, np.exp, np.concatenate([np.linspace(-700, 700, 5001), [0.0, 1e-300, -1e-17]])),
        (1, np.log, np.concatenate([np.geomspace(1e-300, 1e300, 5001), np.linspace(0.9, 1.1, 999), [1.0]])),
        (2, np.sin, np.concatenate([np.linspace(-10, 10, 5001), [1e5, -1e5, np.pi, -np.pi]])),
        (3, np.cos, np.concatenate([np.linspace(-10, 10, 5001), [1e5, -1e5, np.pi, -np.pi]])),
    ],
)
def test_elementary_functions(which, theirs, x):
    tight = {"rtol": 5e-14, "atol": 1e-300} if which == 0 else {"rtol": 4e-16, "atol": 4e-16}
    loose = {"rtol": 0.0, "atol": 3e-11 if np.abs(x).max() > 1e4 else 3e-15}
    np.testing.assert_allclose(each(which, x), theirs(x), **(tight if which < 2 else loose))


def test_below_its_range_the_exponential_is_next_to_nothing():
    assert 0.0 <= each(0, np.array([-1e3, -1e300, -np.inf])).max() < 1e-300


def test_estimates_by_interpolation():
    resultant = np.concatenate([np.linspace(1e-6, 0.9999, 999), 1 - np.geomspace(1e-4, 1e-6, 50)])
    found = [_maximisation.concentration_from(r) for r in resultant]
    np.testing.assert_allclose(found, von_mises.concentration_of(resultant), rtol=2e-9)
    assert _maximisation.concentration_from(0.0) == 0.0
    shape = np.geomspace(1.0, 9e3, 999)
    spread = np.log(shape) - special.digamma(shape)
    np.testing.assert_allclose([_maximisation.shape_from(s, 1e4) for s in spread], shape, rtol=1e-8)
    assert _maximisation.shape_from(0.0, 1e4) == 1e4
    assert _maximisation.shape_from(3.0, 1e4) == 1.0
