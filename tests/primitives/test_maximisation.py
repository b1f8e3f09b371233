"""The estimates that the compiled EM looks up, against the ones that iterate."""

import numpy as np
from scipy import special

from dirprim_filter.distributions import von_mises
from dirprim_filter.primitives import _maximisation


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


def test_interpolated_normalisers_are_those_of_scipy():
    log_concentration, log_shape = np.linspace(0.0, np.log(1e6), 3001), np.linspace(0.0, np.log(1e4), 3001)
    exact = np.log(2 * np.pi * special.i0e(np.expm1(log_concentration)))
    np.testing.assert_allclose([_maximisation.log_normaliser(u) for u in log_concentration], exact, rtol=0, atol=1e-8)
    shape = np.exp(log_shape)
    exact = special.gammaln(shape) - shape * (log_shape - 1)
    np.testing.assert_allclose([_maximisation.gamma_remainder(s) for s in log_shape], exact, rtol=0, atol=1e-10)
