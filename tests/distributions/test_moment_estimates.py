"""Concentrations and shapes by moments, and what normalises them: against mpmath and scipy."""

import mpmath
import numpy as np
import pytest
from scipy import special

from dirprim_filter.distributions import _estimates, von_mises

CONCENTRATIONS = np.concatenate([np.geomspace(1e-8, 0.99e6, 80), [0.5, 1.15, 1.17, 19.999, 20.0, 20.001]])


@pytest.fixture(scope="module")
def exact():
    """A = I1 / I0 and 1 - A to double precision, from 50 digits."""
    with mpmath.workdps(50):
        ratio = [mpmath.besseli(1, k) / mpmath.besseli(0, k) for k in CONCENTRATIONS]
        return np.array([float(a) for a in ratio]), np.array([float(1 - a) for a in ratio])


def test_concentration_inverts_the_ratio_of_bessel_functions_to_its_ends(exact):
    resultant, variance = exact
    np.testing.assert_allclose(von_mises.circular_variance(CONCENTRATIONS), variance, rtol=0, atol=1e-15)
    # An error of one unit in the last place of R is one of 2 k 1e-16 in k.
    error = np.abs(von_mises.concentration_of(resultant) / CONCENTRATIONS - 1)
    assert (error < 1e-13 + 2e-15 * CONCENTRATIONS).all()
    assert von_mises.concentration_of(np.array([0.0, 1.0, 1.0 - 1e-16])).tolist() == [0.0, 1e6, 1e6]


def test_compiled_estimates_by_interpolation():
    resultant = np.concatenate([np.linspace(1e-6, 0.9999, 999), 1 - np.geomspace(1e-4, 1e-6, 50)])
    found = [_estimates.concentration_from(r) for r in resultant]
    np.testing.assert_allclose(found, von_mises.concentration_of(resultant), rtol=2e-9)
    assert _estimates.concentration_from(0.0) == 0.0
    shape = np.geomspace(1.0, 9e3, 999)
    spread = np.log(shape) - special.digamma(shape)
    np.testing.assert_allclose([_estimates.shape_from(s, 1e4) for s in spread], shape, rtol=1e-8)
    assert _estimates.shape_from(0.0, 1e4) == 1e4
    assert _estimates.shape_from(3.0, 1e4) == 1.0


def test_interpolated_normalisers_are_those_of_scipy():
    log_concentration, log_shape = np.linspace(0.0, np.log(1e6), 3001), np.linspace(0.0, np.log(1e4), 3001)
    k, shape = np.expm1(log_concentration), np.exp(log_shape)
    exact = np.log(2 * np.pi * special.i0e(k))
    np.testing.assert_allclose([_estimates.log_normaliser(u) for u in log_concentration], exact, rtol=0, atol=1e-8)
    exact = special.i1e(k) / special.i0e(k)
    np.testing.assert_allclose([_estimates.resultant_of(u) for u in log_concentration], exact, rtol=0, atol=1e-7)
    exact = special.gammaln(shape) - shape * (log_shape - 1)
    np.testing.assert_allclose([_estimates.gamma_remainder(s) for s in log_shape], exact, rtol=0, atol=1e-10)
