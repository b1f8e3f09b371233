import numpy as np
import pytest
from scipy.special import logsumexp

from dirprim_filter.distributions import VonMisesMixture
from dirprim_filter.distributions.product import multiply_mixtures
from oracles import kuiper_p_value, sample_by_rejection

FALSE_ALARM = 1e-4  # of each statistical test below; seeds are fixed
CIRCLE = np.linspace(-np.pi, np.pi, 8193)[:-1]
STEP = CIRCLE[1] - CIRCLE[0]


def mixture(*modes):
    weight, mean, concentration = map(np.array, zip(*modes, strict=True))
    return VonMisesMixture(weight=weight, mean_direction=mean, concentration=concentration)


JUNCTION = mixture((0.5, np.deg2rad(-45), 20.0), (0.3, 0.0, 20.0), (0.2, np.deg2rad(45), 20.0))
TURN_RIGHT = mixture((1.0, np.deg2rad(-90), 2.5))
PAIRS = [
    (JUNCTION, TURN_RIGHT),
    (JUNCTION, mixture((0.6, 3.1, 50.0), (0.4, -1.0, 0.0))),
    (mixture((1.0, 0.0, 600.0)), mixture((1.0, np.pi, 600.0))),  # antipodal: the product is nearly flat, and tiny
]


@pytest.mark.parametrize(("prior", "belief"), PAIRS)
def test_the_product_is_that_of_the_densities_and_its_evidence_their_integral(prior, belief):
    product, log_evidence = multiply_mixtures(prior, belief)
    pointwise = prior.log_density(CIRCLE) + belief.log_density(CIRCLE)
    assert log_evidence == pytest.approx(logsumexp(pointwise) + np.log(STEP), abs=1e-9)
    np.testing.assert_allclose(product.log_density(CIRCLE), pointwise - log_evidence, atol=1e-8)


def test_order_does_not_matter_the_uniform_changes_nothing_and_nothing_overflows():
    a, b = multiply_mixtures(JUNCTION, TURN_RIGHT), multiply_mixtures(TURN_RIGHT, JUNCTION)
    np.testing.assert_allclose(a.mixture.log_density(CIRCLE), b.mixture.log_density(CIRCLE), atol=1e-12)
    same, log_evidence = multiply_mixtures(JUNCTION, mixture((1.0, 0.0, 0.0)))
    np.testing.assert_allclose(same.log_density(CIRCLE), JUNCTION.log_density(CIRCLE), atol=1e-12)
    assert log_evidence == pytest.approx(-np.log(2 * np.pi))
    product, log_evidence = multiply_mixtures(mixture((1.0, 0.0, 1e6)), mixture((1.0, 1e-3, 1e6)))
    assert product.concentration[0] == pytest.approx(2e6, rel=1e-5)
    assert np.isfinite(log_evidence)


def cumulative(log_density):
    edges = np.append(CIRCLE, np.pi) - 0.5 * STEP
    steps = np.concatenate([[0.0], np.cumsum(np.exp(log_density(CIRCLE))) * STEP])
    return lambda theta: np.interp(theta, edges, steps)


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
