"""The baselines against filterpy's filters."""

import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import IMMEstimator, KalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.filtering import ConstantVelocityKalman, Tracker
from dirprim_filter.filtering.kalman import (
    FIRST_SPEED_STD,
    FIRST_TURN_STD,
    ConstantTurn,
    InteractingModels,
    KalmanBank,
    acceleration_density,
    turned,
)
from situations import TRUSTING, tracks_of


def run(frames, **settings):
    config = FilterConfig(noise_m=0.7, outlier_probability=1e-13, **settings)
    kalman = ConstantVelocityKalman(acceleration_density=2.0, config=config)
    tracker = Tracker(kalman, config=config, tracking=TRUSTING, rng=np.random.default_rng(0))
    return Estimates.concatenate([tracker.step(frame) for frame in frames])


def test_after_the_gap_it_restarts_and_before_it_it_does_not():
    def at(time_s, x):
        return Detections(track_id=["a"], time_ns=[round(time_s * 1e9)], position=[[x, 0.0]])

    usual = [at(t, 10.0 * t) for t in range(4)]
    found = run([*usual, at(8.0, 80.0), at(13.5, 500.0), at(14.5, 510.0)], max_gap_s=5.0)
    assert (found.log_evidence == 0).tolist() == [True, False, False, False, False, True, False]
    np.testing.assert_array_equal(found.position[5], [500.0, 0.0])
    np.testing.assert_allclose(found.covariance[5], 0.49 * np.eye(2))
    fresh = run([at(13.5, 500.0), at(14.5, 510.0)])
    np.testing.assert_array_equal(found.position[5:], fresh.position)


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


MODELS = {
    "constant velocity": lambda config: ConstantVelocityKalman(acceleration_density=2.0, config=config),
    "constant turn": lambda config: KalmanBank([ConstantTurn(1.0, 0.1)], config),
    "both": lambda config: InteractingModels(straight=0.5, acceleration_density=1.0, turn_density=0.1, config=config),
}


@pytest.mark.parametrize("model", MODELS)
def test_the_likelihood_of_a_measurement_is_the_evidence_that_weighing_gives(model):
    made = MODELS[model](FilterConfig(outlier_probability=1e-13))
    made.reserve(1)
    slot, key = np.zeros(1, np.int64), np.zeros(1, np.uint64)
    for i, dt_s in enumerate((0.0, 0.5, 0.5)):
        seen = Detections(track_id=[""], time_ns=[i], position=[[5.0 * i, 0.7 * i**2]])
        if i:
            made.predict(slot, np.full(1, dt_s))
        likelihood = made.log_likelihood(slot, seen) if i else None
        evidence = made.weigh(slot, seen).log_density if i else made.begin(slot, key, seen)
    np.testing.assert_allclose(likelihood, evidence, rtol=1e-6)


def filterpys(name, density, turn_density, straight, dt_s):
    """The models of `MODELS` as filterpy has them, of one vehicle that is seen every `dt_s`."""
    first = np.diag([0.49, 0.49, FIRST_SPEED_STD**2, FIRST_SPEED_STD**2, FIRST_TURN_STD**2])
    line = KalmanFilter(dim_x=5, dim_z=2)
    line.F = np.diag([1.0, 1.0, 1.0, 1.0, 0.0])
    line.F[0, 2] = line.F[1, 3] = dt_s
    points = MerweScaledSigmaPoints(5, alpha=0.3, beta=2.0, kappa=0.0)
    turn = UnscentedKalmanFilter(5, 2, dt_s, hx=lambda x: x[:2], fx=turned, points=points)
    for one, white, last in ((line, straight, FIRST_TURN_STD**2), (turn, density, turn_density * dt_s)):
        one.x, one.P, one.H, one.R, one.Q = (
            np.zeros(5),
            first,
            np.eye(2, 5),
            0.49 * np.eye(2),
            np.diag([0.0] * 4 + [last]),
        )
        one.Q[:4, :4] += np.kron(Q_continuous_white_noise(2, dt_s, white), np.eye(2))
    stays = 0.5 + 0.5 * np.exp(-2.0 * 0.5 * dt_s)
    both = IMMEstimator([line, turn], [0.5, 0.5], np.array([[stays, 1.0 - stays], [1.0 - stays, stays]]))
    return {"constant velocity": line, "constant turn": turn, "both": both}[name]


@pytest.mark.parametrize("model", MODELS)
def test_predictions_and_corrections_are_filterpys(model):
    rng, slot = np.random.default_rng(4), np.zeros(1, np.int64)
    ours = MODELS[model](FilterConfig(noise_m=0.7, outlier_probability=0.0))
    theirs = filterpys(model, 1.0, 0.1, 2.0 if model == "constant velocity" else 0.5, 0.5)
    ours.reserve(1)
    for i in range(40):
        place = np.array([4.0 * i, 0.2 * i**2]) + rng.normal(0.0, 0.7, 2) * (i > 0)
        seen = Detections(track_id=[""], time_ns=[i], position=[place])
        if i == 0:
            ours.begin(slot, slot.astype(np.uint64), seen)
            continue
        ours.predict(slot, np.full(1, 0.5))
        evidence = ours.weigh(slot, seen).log_density
        theirs.predict()
        if model == "constant turn":
            theirs.sigmas_f = theirs.points_fn.sigma_points(theirs.x, theirs.P)  # not those before the noise
        theirs.update(place)
        found = ours.moments(slot)[0]
        np.testing.assert_allclose(found[:2], theirs.x[:2], atol=1e-5)
        np.testing.assert_allclose(found[[2, 3, 4]], theirs.P[[0, 0, 1], [0, 1, 1]], atol=1e-5)
        assert found[7] == pytest.approx(np.hypot(*theirs.x[2:4]), abs=1e-5)
        if model != "both":
            assert evidence == pytest.approx(theirs.log_likelihood, abs=1e-5)
