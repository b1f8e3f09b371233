"""Weighted maximum likelihood of each distribution, against mpmath, scipy and a direct maximiser."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import special, stats

from dirprim_filter.distributions import VonMisesMixture, _kernels, gamma, von_mises
from dirprim_filter.distributions.mixture_fit import fit_mixture

CONCENTRATIONS = np.concatenate([np.geomspace(1e-8, 0.99e6, 80), [0.5, 1.15, 1.17, 19.999, 20.0, 20.001]])
JUNCTION = VonMisesMixture(
    weight=np.array([0.5, 0.3, 0.2]), mean_direction=np.deg2rad([-45.0, 0.0, 45.0]), concentration=np.full(3, 20.0)
)
ANGLES = st.lists(st.floats(-np.pi, np.pi), min_size=1, max_size=30)


@pytest.fixture(scope="module")
def exact():
    """A = I1 / I0 and 1 - A to double precision, from 50 digits."""
    with mpmath.workdps(50):
        ratio = [mpmath.besseli(1, k) / mpmath.besseli(0, k) for k in CONCENTRATIONS]
        return np.array([float(a) for a in ratio]), np.array([float(1 - a) for a in ratio])


def test_concentration_inverts_the_ratio_of_bessel_functions_to_1e_13(exact):
    resultant, variance = exact
    np.testing.assert_allclose(von_mises.circular_variance(CONCENTRATIONS), variance, rtol=1e-13)
    low = CONCENTRATIONS < 1.0
    np.testing.assert_allclose(von_mises.concentration_of(resultant)[low], CONCENTRATIONS[low], rtol=1e-13)
    np.testing.assert_allclose(von_mises.concentration_of_variance(variance)[~low], CONCENTRATIONS[~low], rtol=1e-13)
    # From R alone an error of one unit in its last place is one of 2 k 1e-16 in k.
    error = np.abs(von_mises.concentration_of(resultant) / CONCENTRATIONS - 1)
    assert (error < 1e-13 + 4e-16 * CONCENTRATIONS).all()


def test_concentration_is_bounded_and_its_ends_are_exact():
    assert von_mises.concentration_of(np.array([0.0, 1.0, 1.0 - 1e-16])).tolist() == [0.0, 1e6, 1e6]
    assert von_mises.concentration_of_variance(np.array([0.0, 1.0])).tolist() == [1e6, 0.0]


@pytest.mark.parametrize("concentration", [0.3, 4.0, 900.0])
def test_von_mises_fit_is_scipys_and_counts_weights_as_repetitions(concentration):
    rng = np.random.default_rng(0)
    theta = rng.vonmises(3.0, concentration, 400)
    mean, kappa = von_mises.fit(theta)
    theirs, loc, _ = stats.vonmises.fit(theta, fscale=1)
    np.testing.assert_allclose([mean, kappa], [loc, theirs], rtol=1e-6)
    weight = rng.integers(0, 4, 400)
    once = von_mises.fit(theta, weight=weight)
    np.testing.assert_allclose(once, von_mises.fit(np.repeat(theta, weight)), rtol=1e-9)


def test_a_fit_of_concentrated_angles_keeps_its_digits():
    turn = 1e-3 * np.array([-1.0, 1.0])
    with mpmath.workdps(50):
        variance = 1 - mpmath.cos(mpmath.mpf(1e-3))
        kappa = mpmath.findroot(lambda k: 1 - mpmath.besseli(1, k) / mpmath.besseli(0, k) - variance, 1e6)
    found = von_mises.fit(turn, max_concentration=1e6)[1]
    assert found == pytest.approx(min(float(kappa), 1e6), rel=1e-12)
    np.testing.assert_allclose(von_mises.fit(1.001e-3 / 1e-3 * turn)[1] * 1.001**2, float(kappa), rtol=1e-5)


def test_von_mises_fit_of_few_angles():
    assert von_mises.fit(np.array([2.0])) == (2.0, von_mises.MAX_CONCENTRATION)
    assert von_mises.fit(np.full(9, -3.0), max_concentration=50.0) == (-3.0, 50.0)
    _, kappa = von_mises.fit(np.array([0.5, 0.5 + np.pi]))
    assert kappa == pytest.approx(0.0, abs=1e-15)
    mean, kappa = von_mises.fit(np.array([[1.0, 9.0], [2.0, -4.0]]), weight=np.array([1.0, 0.0]))
    assert mean.tolist() == [1.0, 2.0]
    assert (kappa == von_mises.MAX_CONCENTRATION).all()


@pytest.mark.parametrize(
    "fit", [von_mises.fit, gamma.fit, lambda x, **w: fit_mixture(x, n_modes=1, rng=np.random.default_rng(0), **w)]
)
@pytest.mark.parametrize(
    ("value", "weight", "message"),
    [
        (np.empty(0), None, "at least one"),
        (np.array([1.0, np.nan]), None, "finite"),
        (np.array([1.0, 2.0]), np.array([1.0, -1.0]), "weight: expected no negative"),
        (np.array([1.0, 2.0]), np.zeros(2), "zeros alone"),
        (np.array([1.0, 2.0]), np.array([np.nan, 1.0]), "weight: expected finite"),
    ],
)
def test_what_cannot_be_fitted_is_refused(fit, value, weight, message):
    with pytest.raises(ValueError, match=message):
        fit(value, weight=weight)


@pytest.mark.parametrize("value", [-0.5, 0.0])
def test_a_gamma_has_no_likelihood_at_speeds_that_are_not_positive(value):
    with pytest.raises(ValueError, match=r"positive numbers, got .* at \(1,\)"):
        gamma.fit(np.array([1.0, value, 3.0]))
    counted = gamma.fit(np.array([1.0, value, 3.0, 2.0, 2.5]), weight=np.array([1.0, 0.0, 1.0, 1.0, 1.0]))
    assert counted.shape == pytest.approx(float(gamma.fit(np.array([1.0, 3.0, 2.0, 2.5])).shape))


@pytest.mark.parametrize("shape", [0.4, 3.0, 800.0])
def test_gamma_fit_is_scipys_with_the_bias_reduced(shape):
    rng = np.random.default_rng(0)
    speed = rng.gamma(shape, 2.0, 60)
    likeliest, _, _ = stats.gamma.fit(speed, floc=0)
    found = gamma.fit(speed, min_shape=0.01)
    assert found.shape == pytest.approx(likeliest * 57 / 60 + 2 / 180, rel=1e-6)
    assert found.mean == pytest.approx(speed.mean())
    weight = rng.integers(0, 4, 60)
    np.testing.assert_allclose(
        gamma.fit(speed, weight=weight).shape, gamma.fit(np.repeat(speed, weight)).shape, rtol=1e-9
    )


def test_the_reduced_shape_is_unbiased_and_the_likeliest_is_not():
    # Standard error of the mean of 4000 shapes of relative deviation 0.75: 0.012; 4.5 of it: a false alarm of 7e-6.
    speed = np.random.default_rng(1).gamma(5.0, 1.0, (4000, 10))
    reduced = gamma.fit(speed, min_shape=1e-3).shape
    assert reduced.mean() == pytest.approx(5.0, rel=0.055)
    likeliest = (reduced - 2 / 30) * 10 / 7
    assert likeliest.mean() > 5.0 * 1.2


def test_gamma_fit_of_few_values_is_bounded():
    for values in ([7.0], [7.0, 8.0], [7.0, 7.0, 7.0]):
        found = gamma.fit(np.array(values))
        assert found.shape == 1.0
        assert found.mean == pytest.approx(np.mean(values))
    assert gamma.fit(np.full(10, 7.0), max_shape=1e4).shape == pytest.approx(7e3, rel=1e-3)


def test_log_less_digamma_keeps_its_digits():
    x = np.geomspace(1e-3, 1e8, 60)
    with mpmath.workdps(40):
        expected = [float(mpmath.log(v) - mpmath.digamma(v)) for v in x]
    np.testing.assert_allclose([_kernels.log_less_digamma(v) for v in x], expected, rtol=1e-13)


@settings(max_examples=40, deadline=None)
@given(
    ANGLES,
    st.integers(1, 4),
    st.sampled_from([0.0, 0.02, 1.0]),
    st.sampled_from([10.0, 1e4, 1e6]),
    st.integers(0, 2**32),
)
def test_the_objective_of_em_never_falls(angles, n_modes, prior_strength, max_concentration, seed):
    rng = np.random.default_rng(seed)
    weight = rng.uniform(0.0, 2.0, len(angles)) + 1e-3
    found = fit_mixture(
        np.array(angles), weight=weight, n_modes=n_modes, n_starts=2, max_iterations=200, prior_strength=prior_strength,
        max_concentration=max_concentration, rng=rng,
    )  # fmt: skip
    # What rounding may take: a few units in the last place of the largest exponent, a sum over the rows.
    slack = 1e-13 * (1 + np.abs(found.trace)).max() + 1e-15 * max_concentration * weight.sum()
    assert (np.diff(found.trace) >= -slack).all()
    assert found.mixture.weight.sum() == pytest.approx(1.0)
    assert (found.mixture.concentration <= max_concentration).all()
    kappa = found.mixture.concentration
    penalty = prior_strength * (kappa + np.log(special.i0e(kappa))).sum()
    own = (weight * found.mixture.log_density(np.array(angles))).sum()
    assert found.log_likelihood == pytest.approx(own, rel=1e-9, abs=1e-9)
    if found.converged:
        assert found.trace[-1] == pytest.approx(own - penalty, rel=1e-9, abs=1e-9)


def test_em_finds_the_junction_and_a_better_likelihood_than_the_truth():
    theta, _ = JUNCTION.sample(n_samples=5000, rng=np.random.default_rng(1))
    found = fit_mixture(theta, n_modes=3, rng=np.random.default_rng(2))
    assert found.converged
    np.testing.assert_allclose(found.mixture.weight, JUNCTION.weight, atol=0.03)
    np.testing.assert_allclose(found.mixture.mean_direction, JUNCTION.mean_direction, atol=0.05)
    np.testing.assert_allclose(found.mixture.concentration, 20.0, rtol=0.15)
    assert found.log_likelihood > JUNCTION.log_density(theta).sum()
    assert fit_mixture(theta, n_modes=3, max_iterations=2, rng=np.random.default_rng(2)).converged is False


def test_weights_count_as_repetitions_and_rows_of_weight_0_not_at_all():
    rng = np.random.default_rng(3)
    theta, _ = JUNCTION.sample(n_samples=300, rng=rng)
    weight = rng.integers(0, 3, 300).astype(float)
    options = {"n_modes": 1, "tolerance": 0.0}
    weighted = fit_mixture(theta, weight=weight, rng=np.random.default_rng(0), **options)
    repeated = fit_mixture(np.repeat(theta, weight.astype(int)), rng=np.random.default_rng(0), **options)
    assert weighted.log_likelihood == pytest.approx(repeated.log_likelihood, rel=1e-12)
    np.testing.assert_allclose(weighted.mixture.concentration, repeated.mixture.concentration, rtol=1e-9)


def test_em_on_degenerate_angles_has_a_stated_result():
    one = fit_mixture(np.array([2.0]), n_modes=1, rng=np.random.default_rng(0)).mixture
    assert (one.mean_direction[0], one.concentration[0]) == (2.0, 1e4)
    same = fit_mixture(np.full(20, -1.0), n_modes=3, rng=np.random.default_rng(0)).mixture
    assert (same.concentration[same.weight > 0] == 1e4).all()
    shrunk = fit_mixture(np.full(20, -1.0), n_modes=1, prior_strength=1.0, rng=np.random.default_rng(0)).mixture
    assert shrunk.concentration[0] == pytest.approx(float(von_mises.concentration_of(np.array(20 / 21))))
    antipodal = fit_mixture(np.tile([0.5, 0.5 - np.pi], 10), n_modes=2, rng=np.random.default_rng(0)).mixture
    np.testing.assert_allclose(np.sort(antipodal.mean_direction), [0.5 - np.pi, 0.5], atol=1e-12)
    np.testing.assert_allclose(antipodal.weight, 0.5)


@pytest.mark.parametrize(
    "option",
    [{"n_modes": 0}, {"n_starts": 0}, {"max_iterations": 0}, {"max_concentration": 1e7}, {"prior_strength": -1.0}],
)
def test_options_out_of_range_are_refused_by_name(option):
    with pytest.raises(ValueError, match=next(iter(option))):
        fit_mixture(np.zeros(3), **{"n_modes": 1, "rng": np.random.default_rng(0)} | option)
