"""The baseline against filterpy's filter."""

import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import ConstantVelocityKalman
from dirprim_filter.filtering.kalman import FIRST_SPEED_STD, acceleration_density
from situations import tracks_of


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
    rng, slot, dt_s = np.random.default_rng(4), np.zeros(1, np.int64), 0.5
    ours = ConstantVelocityKalman(acceleration_density=2.0, config=FilterConfig(noise_m=0.7, outlier_probability=0.0))
    theirs = KalmanFilter(dim_x=4, dim_z=2)
    theirs.F[0, 2] = theirs.F[1, 3] = dt_s
    theirs.P = np.diag([0.49, 0.49, FIRST_SPEED_STD**2, FIRST_SPEED_STD**2])
    theirs.H, theirs.R = np.eye(2, 4), 0.49 * np.eye(2)
    theirs.Q = np.kron(Q_continuous_white_noise(2, dt_s, 2.0), np.eye(2))
    ours.reserve(1)
    for i in range(40):
        place = np.array([4.0 * i, 0.2 * i**2]) + rng.normal(0.0, 0.7, 2) * (i > 0)
        seen = Detections(track_id=[""], time_ns=[i], position=[place])
        if i == 0:
            ours.begin(slot, slot.astype(np.uint64), seen)
            continue
        ours.predict(slot, np.full(1, dt_s))
        likelihood, evidence = ours.log_likelihood(slot, seen), ours.weigh(slot, seen).log_density
        theirs.predict()
        theirs.update(place)
        found = ours.moments(slot)[0]
        np.testing.assert_allclose(found[:2], theirs.x[:2, 0], atol=1e-5)
        np.testing.assert_allclose(found[[2, 3, 4]], theirs.P[[0, 0, 1], [0, 1, 1]], atol=1e-5)
        assert found[7] == pytest.approx(np.hypot(*theirs.x[2:4, 0]), abs=1e-5)
        assert evidence == pytest.approx(likelihood, rel=1e-9)
        assert evidence == pytest.approx(theirs.log_likelihood, abs=1e-5)
