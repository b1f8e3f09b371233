"""Angles, densities of directions and speeds, their products and samples: against scipy, scikit-learn and mpmath."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import special, stats
from sklearn.cluster import DBSCAN

from dirprim_filter.distributions import Gamma, VonMisesMixture, _elementary, _estimates, von_mises
from dirprim_filter.distributions.angles import difference, wrap
from dirprim_filter.distributions.modes import NOISE, dbscan
from dirprim_filter.distributions.product import multiply_mixtures
from oracles import circular_distance, kuiper_p_value, sample_by_rejection, von_mises_mixture_density

ODD_PI = np.array([np.nextafter(k * np.pi, s * np.inf) for k in range(-9, 10) for s in (-1, 1)] + [-np.pi, np.pi])
CIRCLE = np.linspace(-np.pi, np.pi, 8193)[:-1]
STEP = CIRCLE[1] - CIRCLE[0]
FALSE_ALARM = 1e-4  # of each statistical test below; seeds are fixed


def mixture(*modes):
    """Of modes (weight, mean direction, concentration)."""
    weight, mean, concentration = map(np.array, zip(*modes, strict=True))
    return VonMisesMixture(weight=weight, mean_direction=mean, concentration=concentration)


FIG_2 = (0.5, np.deg2rad(-45), 20.0), (0.3, 0.0, 20.0), (0.2, np.deg2rad(45), 20.0)
JUNCTION, TURN_RIGHT = mixture(*FIG_2), mixture((1.0, np.deg2rad(-90), 2.5))


@settings(deadline=None)
@given(st.floats(-1e6, 1e6))
def test_wrap_keeps_the_angle_and_the_interval_at_every_edge(angle):
    angles = np.append(ODD_PI, angle)
    wrapped = wrap(angles)
    assert ((wrapped > -np.pi) & (wrapped <= np.pi)).all()
    assert (np.abs(np.exp(1j * wrapped) - np.exp(1j * angles)) < 1e-8).all()
    np.testing.assert_array_equal(wrap(wrapped), wrapped)
    np.testing.assert_array_equal([_elementary.wrap(each) for each in angles], wrapped)  # the compiled twin
    assert wrap(np.array(-np.pi)) == np.pi
    assert np.isclose(difference(np.array(-3.1), np.array(3.1)), 2 * np.pi - 6.2)


@pytest.mark.parametrize("seed", range(8))
def test_labels_are_those_of_scikit_learn(seed):
    rng = np.random.default_rng(seed)
    around = [rng.vonmises(rng.uniform(-np.pi, np.pi), rng.choice([1, 20, 300]), rng.integers(1, 60)) for _ in range(2)]
    theta = np.concatenate([*around, rng.uniform(-np.pi, np.pi, rng.integers(0, 10))])
    if seed % 3 == 0:
        theta = np.round(theta, 1)  # repeated angles
    for angles in (theta, theta[:1]):
        distance = circular_distance(angles[:, None], angles[None])
        for eps in (0.021, 0.13, 0.77, 3.2):
            for min_samples in (1, 2, 6):
                expected = DBSCAN(eps=eps, min_samples=min_samples, metric="precomputed").fit(distance).labels_
                np.testing.assert_array_equal(dbscan(angles, eps=eps, min_samples=min_samples), expected)
    across = dbscan(np.array([3.1, -3.1, 3.12, -3.13, 0.0]), eps=0.1, min_samples=2)
    assert across.tolist() == [0, 0, 0, 0, NOISE]


def test_the_mixture_of_figure_2():
    np.testing.assert_allclose(
        np.exp(JUNCTION.log_density(CIRCLE)), von_mises_mixture_density(CIRCLE, *zip(*FIG_2, strict=True)), rtol=1e-10
    )


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


def cumulative(log_density):
    edges = np.append(CIRCLE, np.pi) - 0.5 * STEP
    steps = np.concatenate([[0.0], np.cumsum(np.exp(log_density(CIRCLE))) * STEP])
    return lambda theta: np.interp(theta, edges, steps)


def test_samples_of_a_mixture_follow_it_and_not_another():
    two = mixture((0.6, 3.0, 30.0), (0.4, -1.0, 2.0))
    drawn, mode = two[None][np.zeros(20_000, np.int64)].sample(rng=np.random.default_rng(3))
    assert stats.kstest(drawn, cumulative(two.log_density)).pvalue > FALSE_ALARM
    assert stats.kstest(drawn + 0.05, cumulative(two.log_density)).pvalue < FALSE_ALARM
    assert stats.binomtest(int((mode == 0).sum()), 20_000, 0.6).pvalue > FALSE_ALARM


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
    as_mixture = mixture((1.0, mean, concentration)).log_density(np.array(direction))
    np.testing.assert_allclose([ours, as_mixture], theirs, atol=1e-10, rtol=1e-10)


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
    one = mixture((1.0, 0.0, 1.0))
    assert np.isnan(one.log_density(np.array(np.nan)))
    assert one.log_density(np.empty(0)).shape == (0,)
    speeds = Gamma(shape=np.array([0.5, 1.0, 2.0]), rate=np.ones(3))
    assert speeds.log_density(np.array(0.0)).tolist() == [np.inf, 0.0, -np.inf]
    assert (speeds.log_density(np.array(-1.0)) == -np.inf).all()
    assert np.isnan(speeds.log_density(np.array(np.nan))).all()


def test_concentration_inverts_the_ratio_of_bessel_functions_to_its_ends():
    """A = I1 / I0 and 1 - A to double precision, from 50 digits."""
    concentration = np.concatenate([np.geomspace(1e-8, 0.99e6, 80), [0.5, 1.15, 1.17, 19.999, 20.0, 20.001]])
    with mpmath.workdps(50):
        ratio = [mpmath.besseli(1, k) / mpmath.besseli(0, k) for k in concentration]
        resultant, variance = np.array([[float(a), float(1 - a)] for a in ratio]).T
    np.testing.assert_allclose(von_mises.circular_variance(concentration), variance, rtol=0, atol=1e-15)
    # An error of one unit in the last place of R is one of 2 k 1e-16 in k.
    error = np.abs(von_mises.concentration_of(resultant) / concentration - 1)
    assert (error < 1e-13 + 2e-15 * concentration).all()
    assert von_mises.concentration_of(np.array([0.0, 1.0, 1.0 - 1e-16])).tolist() == [0.0, 1e6, 1e6]


def test_compiled_estimates_by_interpolation():
    resultant = np.concatenate([np.linspace(1e-6, 0.9999, 999), 1 - np.geomspace(1e-4, 1e-6, 50)])
    found = [_estimates.concentration_from(r) for r in resultant]
    np.testing.assert_allclose(found, von_mises.concentration_of(resultant), rtol=2e-9)
    assert _estimates.concentration_from(0.0) == 0.0
    shape = np.geomspace(1.0, 9e3, 999)
    spread = np.log(shape) - special.digamma(shape)
    np.testing.assert_allclose([_estimates.shape_from(s, 1e4) for s in spread], shape, rtol=1e-8)
    assert [_estimates.shape_from(s, 1e4) for s in (0.0, 3.0)] == [1e4, 1.0]
    u, log_shape = np.linspace(0.0, np.log(1e6), 3001), np.linspace(0.0, np.log(1e4), 3001)
    k, shape = np.expm1(u), np.exp(log_shape)
    remainder = special.gammaln(shape) - shape * (log_shape - 1)
    for normaliser, given_at, exact, atol in (
        (_estimates.log_normaliser, u, np.log(2 * np.pi * special.i0e(k)), 1e-8),
        (_estimates.resultant_of, u, special.i1e(k) / special.i0e(k), 1e-7),
        (_estimates.gamma_remainder, log_shape, remainder, 1e-10),
    ):
        np.testing.assert_allclose([normaliser(at) for at in given_at], exact, rtol=0, atol=atol)


@pytest.mark.parametrize(
    ("prior", "belief"),
    [
        (JUNCTION, TURN_RIGHT),
        (TURN_RIGHT, JUNCTION),
        (JUNCTION, mixture((0.6, 3.1, 50.0), (0.4, -1.0, 0.0))),
        (JUNCTION, mixture((1.0, 0.0, 0.0))),  # the uniform, which changes nothing
        (mixture((1.0, 0.0, 600.0)), mixture((1.0, np.pi, 600.0))),  # antipodal: the product is nearly flat, and tiny
    ],
)
def test_the_product_is_that_of_the_densities_and_its_evidence_their_integral(prior, belief):
    product, log_evidence = multiply_mixtures(prior, belief)
    pointwise = prior.log_density(CIRCLE) + belief.log_density(CIRCLE)
    assert log_evidence == pytest.approx(special.logsumexp(pointwise) + np.log(STEP), abs=1e-9)
    np.testing.assert_allclose(product.log_density(CIRCLE), pointwise - log_evidence, atol=1e-11)


def test_a_product_of_the_sharpest_densities_does_not_overflow():
    product, log_evidence = multiply_mixtures(mixture((1.0, 0.0, 1e6)), mixture((1.0, 1e-3, 1e6)))
    assert product.concentration[0] == pytest.approx(2e6, rel=1e-5)
    assert np.isfinite(log_evidence)


def test_the_papers_rejection_sampler_agrees_with_the_closed_form_and_with_nothing_else():
    product = multiply_mixtures(JUNCTION, TURN_RIGHT).mixture
    accepted = sample_by_rejection(
        lambda theta: JUNCTION.log_density(theta) + TURN_RIGHT.log_density(theta), mixture((1.0, np.deg2rad(-60), 1.0)),
        log_envelope=np.log(6.0), n=500_000, rng=np.random.default_rng(2),
    )  # fmt: skip
    assert accepted.size > 10_000
    exact, _ = product.sample(n_samples=20_000, rng=np.random.default_rng(3))
    for drawn in (accepted[:20_000], exact):
        assert kuiper_p_value(cumulative(product.log_density)(drawn)) > FALSE_ALARM
        assert kuiper_p_value(cumulative(JUNCTION.log_density)(drawn)) < FALSE_ALARM
        assert kuiper_p_value(cumulative(product.log_density)(drawn + 0.02)) < FALSE_ALARM
