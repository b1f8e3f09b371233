"""Particles against measurements of more than a position: numpy and scipy as oracles."""

import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import ParticleFilter
from dirprim_filter.filtering.measurements import FASTEST, TAIL
from situations import one_cell_map

CONFIG = FilterConfig(n_particles=400, noise_m=0.7, outlier_probability=0.02)
COVARIANCE = np.array([[0.5, 0.2], [0.2, 0.9]])
SLOT = np.array([2, 0])


@pytest.fixture
def cloudy():
    """A filter with unequally weighted particles around (3, -2) and the origin."""
    made = ParticleFilter(one_cell_map(), CONFIG)
    rng = np.random.default_rng(0)
    cloud = made.cloud
    cloud.position[SLOT] = np.array([[3.0, -2.0], [0.0, 0.0]])[:, None] + rng.normal(0, 1.0, (2, 400, 2))
    cloud.direction[SLOT] = rng.vonmises(0.3, 20.0, (2, 400))
    cloud.speed[SLOT] = rng.gamma(20.0, 0.5, (2, 400))
    cloud.weight[SLOT] = rng.dirichlet(np.full(400, 0.5), size=2)
    return made


def measured(**known):
    return Detections(track_id=["", ""], time_ns=[0, 0], position=[[3.5, -1.5], [0.3, 0.4]], **known)


def fits(made, seen, row, *, outliers=True):
    """Natural log of each particle's weight and likelihood, by scipy."""
    cloud, s = made.cloud, SLOT[row]
    covariance = np.eye(2) * CONFIG.noise_m**2 if np.isnan(seen.covariance[row, 0, 0]) else seen.covariance[row]
    fit = stats.multivariate_normal(seen.position[row], covariance).logpdf(cloud.position[s])
    if outliers:
        e = CONFIG.outlier_probability
        tail = stats.multivariate_t(seen.position[row], TAIL**2 * covariance, df=2).logpdf(cloud.position[s])
        fit = np.logaddexp(np.log(1 - e) + fit, np.log(e) + tail)
    e = CONFIG.motion_outlier_probability
    if np.isfinite(seen.direction[row]) and not seen.speed[row] < 0.5:
        course = stats.vonmises(1 / CONFIG.direction_noise**2, loc=seen.direction[row]).pdf(cloud.direction[s])
        fit = fit + np.log(2 * np.pi * (1 - e) * course + e)
    if np.isfinite(seen.speed[row]):
        pace = stats.norm(seen.speed[row], CONFIG.speed_noise).pdf(cloud.speed[s])
        fit = fit + np.log(FASTEST * (1 - e) * pace + e)
    return np.log(cloud.weight[s]) + fit


KNOWN = {
    "a position": {},
    "a covariance": {"covariance": np.stack([COVARIANCE, np.full((2, 2), np.nan)])},
    "a direction": {"direction": [0.2, np.nan]},
    "direction and speed": {"direction": [0.2, 1.0], "speed": [9.0, 0.2]},
}


@pytest.mark.parametrize("known", KNOWN.values(), ids=KNOWN)
def test_weights_and_evidence_are_scipys(cloudy, known):
    seen = measured(**known)
    likelihood = cloudy.log_likelihood(SLOT, seen)
    expected = [fits(cloudy, seen, row) for row in (0, 1)]
    near = [logsumexp(fits(cloudy, seen, row, outliers=False)) for row in (0, 1)]
    np.testing.assert_allclose(likelihood, near, rtol=1e-9)
    evidence = cloudy.weigh(SLOT, seen)
    for row in (0, 1):
        assert evidence.log_density[row] == pytest.approx(logsumexp(expected[row]), rel=1e-9)
        np.testing.assert_allclose(
            np.log(cloudy.cloud.weight[SLOT[row]]), expected[row] - logsumexp(expected[row]), rtol=1e-7, atol=1e-7
        )
    assert not evidence.is_unexplained.any()


def test_what_stands_has_no_course(cloudy):
    here, there = (measured(direction=[course, course], speed=[0.1, 0.1]) for course in (0.3, -2.8))
    np.testing.assert_array_equal(cloudy.log_likelihood(SLOT, here), cloudy.log_likelihood(SLOT, there))
    moving = measured(direction=[-2.8, -2.8], speed=[9.0, 9.0])
    assert (cloudy.log_likelihood(SLOT, moving) != cloudy.log_likelihood(SLOT, here)).all()


@pytest.mark.parametrize("turned", [0.0, 0.8])
def test_a_birth_is_as_wide_as_its_measurement_says(turned):
    """Whatever the covariance, all particles weigh alike: they are drawn from it."""
    root = np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]]) @ np.diag([5.0, 0.1])
    covariance = root @ root.T
    made = ParticleFilter(one_cell_map(), FilterConfig(n_particles=20_000))
    made.begin(SLOT, np.array([1, 2], np.uint64), measured(covariance=np.stack([covariance, np.full((2, 2), np.nan)])))
    m = made.moments(SLOT)
    np.testing.assert_allclose(m[:, 9], 20_000)
    scale = np.linalg.inv(root)
    found = scale @ m[0, [2, 3, 3, 4]].reshape(2, 2) @ scale.T
    np.testing.assert_allclose(found, np.eye(2), atol=5 * np.sqrt(2 / 20_000))
    np.testing.assert_allclose(m[1, 2:5], [0.25, 0.0, 0.25], atol=0.25 * 5 * np.sqrt(2 / 20_000))
