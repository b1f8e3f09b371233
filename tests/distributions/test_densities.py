"""Von Mises and gamma laws against scipy and mpmath: densities, samples, normalisers, parameters by moments."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import special, stats

from dirprim_filter.distributions import Gamma, VonMisesMixture, _estimates, von_mises
from oracles import von_mises_mixture_density

CIRCLE = np.linspace(-np.pi, np.pi, 4097)[:-1]


def test_the_mixture_of_figure_2():
    weight, mean, concentration = np.array([0.5, 0.3, 0.2]), np.deg2rad([-45.0, 0.0, 45.0]), np.full(3, 20.0)
    mixture = VonMisesMixture(weight=weight, mean_direction=mean, concentration=concentration)
    expected = von_mises_mixture_density(CIRCLE, weight, mean, concentration)
    np.testing.assert_allclose(np.exp(mixture.log_density(CIRCLE)), expected, rtol=1e-10)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"weight": np.array([0.5, 0.4])}, "sum to one"),
        ({"weight": np.array([1.5, -0.5])}, "negative"),
        ({"concentration": np.array([1.0, np.nan])}, "finite"),
        ({"mean_direction": np.zeros(3)}, "one shape"),
    ],
)
def test_a_mixture_that_is_none_is_refused(changes, message):
    good = {"weight": np.array([0.5, 0.5]), "mean_direction": np.zeros(2), "concentration": np.ones(2)}
    with pytest.raises(ValueError, match=message):
        VonMisesMixture(**(good | changes))


# False alarm rate of each of the following: 1e-4, by the fixed seed either never or always.


def test_samples_of_a_mixture_follow_it_and_not_another():
    mixture = VonMisesMixture(
        weight=np.array([0.6, 0.4]), mean_direction=np.array([3.0, -1.0]), concentration=np.array([30.0, 2.0])
    )
    rows = VonMisesMixture(
        weight=np.tile(mixture.weight, (20_000, 1)),
        mean_direction=np.tile(mixture.mean_direction, (20_000, 1)),
        concentration=np.tile(mixture.concentration, (20_000, 1)),
    )
    drawn, mode = rows.sample(rng=np.random.default_rng(3))
    cumulative = np.concatenate([[0.0], np.cumsum(np.exp(mixture.log_density(CIRCLE))) * (CIRCLE[1] - CIRCLE[0])])
    edges = np.append(CIRCLE, np.pi) - 0.5 * (CIRCLE[1] - CIRCLE[0])
    assert stats.kstest(drawn, lambda d: np.interp(d, edges, cumulative)).pvalue > 1e-4
    assert stats.kstest(drawn + 0.05, lambda d: np.interp(d, edges, cumulative)).pvalue < 1e-4
    assert stats.binomtest(int((mode == 0).sum()), 20_000, 0.6).pvalue > 1e-4


@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from([np.pi, -np.pi, 0.0, np.nextafter(np.pi, 0), np.nextafter(-np.pi, 0), 1e-3]) | st.floats(-3.2, 3.2),
    st.sampled_from([np.pi, -np.pi, 0.0]) | st.floats(-3.2, 3.2),
    st.sampled_from([0.0, 1e-300, 1e-9, 1e6]) | st.floats(0.0, 1e6),
)
def test_von_mises_is_scipys_at_every_edge(direction, mean, concentration):
    """Within 1e-10, absolute or relative, whichever is more: at 1e6 the log density opposite the mean is -2e6."""
    theirs = stats.vonmises.logpdf(direction, max(concentration, 1e-200), loc=mean)
    ours = von_mises.log_density(np.array(direction), mean, concentration)
    np.testing.assert_allclose(ours, theirs, atol=1e-10, rtol=1e-10)
    one = VonMisesMixture(weight=np.ones(1), mean_direction=np.array([mean]), concentration=np.array([concentration]))
    np.testing.assert_allclose(one.log_density(np.array(direction)), theirs, atol=1e-10, rtol=1e-10)


@settings(max_examples=300, deadline=None)
@given(st.just(0.0) | st.floats(1e-290, 1e3), st.floats(1e-3, 1e6), st.floats(1e-3, 1e6))
def test_gamma_is_scipys_at_every_edge(value, shape, rate):
    """Within 1e-10, absolute or relative, and 1e-14 of the terms that cancel; scipy errs below 1e-300."""
    theirs = stats.gamma.logpdf(value, shape, scale=1 / rate)
    ours = Gamma(shape=np.array(shape), rate=np.array(rate)).log_density(np.array(value))
    terms = (
        shape * abs(np.log(rate)) + shape * abs(np.log(value)) + rate * value + shape * np.log1p(shape) if value else 1
    )
    np.testing.assert_allclose(ours, theirs, atol=1e-10 + 1e-14 * terms, rtol=1e-10)


def test_what_is_not_a_number_stays_none_and_what_is_impossible_has_no_density():
    one = VonMisesMixture(weight=np.ones(1), mean_direction=np.zeros(1), concentration=np.ones(1))
    assert np.isnan(one.log_density(np.array(np.nan)))
    speeds = Gamma(shape=np.array([0.5, 1.0, 2.0]), rate=np.ones(3))
    assert speeds.log_density(np.array(0.0)).tolist() == [np.inf, 0.0, -np.inf]
    assert (speeds.log_density(np.array(-1.0)) == -np.inf).all()
    assert np.isnan(speeds.log_density(np.array(np.nan))).all()
    assert one.log_density(np.empty(0)).shape == (0,)


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
