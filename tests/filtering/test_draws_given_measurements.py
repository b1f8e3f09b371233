"""Where a measurement leaves few particles they are drawn given it: against a Kalman filter, of rows seconds apart."""

import numpy as np
import pytest

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import ParticleFilter, Tracker
from dirprim_filter.sensor import AxisError, Sensor
from situations import TRUSTING, gaussian_belief, one_cell_map

SLOT = np.array([0])
ROAD = one_cell_map(concentration=50.0, shape=60.0)
PRIOR = np.zeros((4, 4))
PRIOR[np.ix_([0, 2], [0, 2])] = [[25.0, 8.0], [8.0, 4.0]]  # metres and m/s east
PRIOR[np.ix_([1, 3], [1, 3])] = [[2.25, 0.48], [0.48, 0.16]]
MEAN = np.array([0.0, 0.0, 15.0, 0.0])
NOISE_M = 0.1
BIASED = Sensor(along=AxisError(spread_m=NOISE_M, bias_m=2.0), across=AxisError(spread_m=NOISE_M, bias_m=-1.0))


def weighed(seed, place, *, sensor=None, given=True, course=0.0):
    """A belief of Gaussian `PRIOR`, turned by `course`, after a measurement; -> the filter and its evidence."""
    turn = np.kron(np.eye(2), [[np.cos(course), -np.sin(course)], [np.sin(course), np.cos(course)]])
    bayes = gaussian_belief(
        ParticleFilter(ROAD, FilterConfig(noise_m=NOISE_M), sensor), seed, turn @ MEAN, turn @ PRIOR @ turn.T
    )
    if not given:
        bayes._noise = bayes._noise._replace(few=0.0)
    off = np.zeros(2) if sensor is None else [sensor.along.bias_m, sensor.across.bias_m]
    seen = Detections(track_id=["a"], time_ns=[0], position=[turn[:2, :2] @ (place + off)])
    return bayes, bayes.weigh(SLOT, seen)


def speed_errors(place, **given):
    """Of twelve beliefs' mean speeds, against the Kalman filter's; in its standard deviations of the speed."""
    innovation = PRIOR[:2, :2] + NOISE_M**2 * np.eye(2)
    gain = PRIOR[2:, :2] @ np.linalg.inv(innovation)
    exact, spread = MEAN[2:] + gain @ place, np.sqrt((PRIOR[2:, 2:] - gain @ PRIOR[:2, 2:])[0, 0])
    found = [weighed(seed, place, **given)[0].moments(SLOT)[0, 7] for seed in range(12)]
    return (np.array(found) - np.hypot(*exact)) / spread


@pytest.mark.parametrize("sensor", [None, BIASED], ids=["white", "biased"])
@pytest.mark.parametrize("course", [0.0, 0.9])
def test_a_precise_measurement_of_a_wide_belief_gives_the_kalman_filters_speed(course, sensor):
    """The root mean square over twelve beliefs is .07 to .09 deviations of speed; .6 to .8 of the few that are near;
    were each belief's error a normal one, the limits were passed once in a million runs."""
    found = speed_errors(np.array([4.0, -1.0]), course=course, sensor=sensor)
    assert np.sqrt(np.mean(found**2)) < 0.2
    without = speed_errors(np.array([4.0, -1.0]), course=course, sensor=sensor, given=False)
    assert np.sqrt(np.mean(without**2)) > 0.3


def test_the_evidence_is_the_density_of_the_measurement():
    place = np.array([4.0, -1.0])
    covariance = PRIOR[:2, :2] + NOISE_M**2 * np.eye(2)
    exact = -0.5 * place @ np.linalg.solve(covariance, place) - np.log(2 * np.pi * np.sqrt(np.linalg.det(covariance)))
    found = [weighed(seed, place)[1].log_density[0] for seed in range(12)]
    assert np.mean(found) == pytest.approx(exact, abs=0.15)
    assert not weighed(0, place)[1].is_unexplained[0]


def test_an_outlier_leaves_a_belief_as_it_was():
    bayes, evidence = weighed(0, np.array([0.0, 60.0]))
    before, _ = weighed(0, np.array([0.0, 1000.0]), given=False)
    assert evidence.is_unexplained[0]
    np.testing.assert_array_equal(bayes.cloud.position, before.cloud.position)
    np.testing.assert_array_equal(bayes.cloud.speed, before.cloud.speed)
    assert bayes.moments(SLOT)[0, 9] > 0.95 * bayes.n_particles


def speed_error(seed, *, given):
    """RMSE of speed of a vehicle that changes it slowly and is seen each three seconds, to a decimetre."""
    rng, times = np.random.default_rng(seed), np.arange(0.0, 90.0, 0.1)
    speed = 10.0 + 4.0 * np.sin(times / 9.0 + rng.uniform(0.0, 6.0))
    east = np.cumsum(0.1 * speed)
    bayes = ParticleFilter(ROAD, FilterConfig(noise_m=NOISE_M))
    if not given:
        bayes._noise = bayes._noise._replace(few=0.0)
    tracker, off = Tracker(bayes, config=bayes.config, tracking=TRUSTING, rng=rng), []
    for i in range(0, times.size, 30):
        seen = Detections(
            track_id=["a"], time_ns=[round(times[i] * 1e9)], position=[rng.normal([east[i], 0.0], NOISE_M)]
        )
        found = tracker.step(seen)
        off.append(found.speed[0] - speed[i] if len(found) else np.nan)  # a belief that has lost it may not exist
    return np.sqrt(np.nanmean(np.square(off[5:])))


def test_a_sensor_of_three_seconds_knows_speeds():
    """Of sixteen vehicles 0.23 m/s, with a deviation of 0.02; without the draws 0.66: means of six are beyond the
    first limit once in a hundred thousand runs."""
    assert np.mean([speed_error(seed, given=True) for seed in range(6)]) < 0.28
    assert np.mean([speed_error(seed, given=False) for seed in range(2)]) > 0.4
