"""The baseline against filterpy's filter."""

import numpy as np
import pytest
from scipy import stats

from dirprim_filter.config import FilterConfig
from dirprim_filter.filtering import ConstantVelocityKalman
from dirprim_filter.filtering.kalman import FIRST_SPEED_STD, acceleration_density
from oracles import filterpy_constant_velocity
from situations import seen_at, tracks_of


def test_the_density_of_known_white_acceleration_is_found():
    rng = np.random.default_rng(5)
    n, dt_s, density = 20_000, 0.2, 1.5
    velocity = [20.0, 0.0] + rng.normal(0, np.sqrt(density * dt_s), (n, 2)).cumsum(axis=0) * 1.0
    course, time_ns = np.arctan2(velocity[:, 1], velocity[:, 0]), np.arange(n) * 200_000_000
    tracks = tracks_of(np.zeros((1, n, 2)), time_ns=time_ns, direction=course, speed=np.hypot(*velocity.T))
    five_errors = 5 / np.sqrt(n)  # of a chi squared of 2 n degrees of freedom, relative
    assert acceleration_density(tracks) == pytest.approx(density, rel=five_errors)
    assert acceleration_density(tracks) != pytest.approx(1.1 * density, rel=five_errors)


def test_the_density_needs_two_rows_of_a_vehicle_near_in_time(ring):
    with pytest.raises(ValueError, match="two rows at most 2 s apart"):
        acceleration_density(ring[ring.time_ns == 0])


def test_predictions_corrections_and_evidence_are_filterpys():
    """The evidence is the density of the place under what was predicted."""
    rng, slot, time_s = np.random.default_rng(4), np.zeros(1, np.int64), 0.5 * np.arange(40)
    place = np.column_stack([8.0 * time_s, 0.8 * time_s**2]) + rng.normal(0.0, 0.7, (40, 2))
    given = {"density": 2.0, "noise_m": 0.7, "first_speed_std": FIRST_SPEED_STD}
    (mean, covariance), _ = filterpy_constant_velocity(place, time_s, **given)
    ours = ConstantVelocityKalman(acceleration_density=2.0, config=FilterConfig(noise_m=0.7, outlier_probability=0.0))
    ours.reserve(1)
    ours.begin(slot, slot.astype(np.uint64), seen_at(0.0, place[:1]))
    for k, (x, p) in enumerate(zip(mean[1:], covariance[1:], strict=True), start=1):
        ours.predict(slot, np.full(1, 0.5))
        expected, seen = ours.moments(slot)[0], seen_at(time_s[k], place[k : k + 1])
        likelihood, evidence = ours.log_likelihood(slot, seen), ours.weigh(slot, seen).log_density
        found = ours.moments(slot)[0]
        np.testing.assert_allclose(found[:5], [*x[:2], p[0, 0], p[0, 1], p[1, 1]], atol=1e-5)
        assert found[7] == pytest.approx(np.hypot(*x[2:]), abs=1e-5)
        of_place = stats.multivariate_normal(expected[:2], expected[[2, 3, 3, 4]].reshape(2, 2) + 0.49 * np.eye(2))
        assert evidence == pytest.approx(likelihood, rel=1e-9)
        assert evidence == pytest.approx(of_place.logpdf(place[k]), abs=1e-5)
