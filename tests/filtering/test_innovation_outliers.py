"""Vehicles that leave their motion model: the mixture's posterior against its closed form, a driver who stops dead."""

import numpy as np
import pytest

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import ParticleFilter, Tracker, _measuring
from dirprim_filter.sensor import AxisError, Sensor
from situations import TRUSTING, gaussian_belief, one_cell_map

N, RATE, DT_S = 40_000, 0.5, 0.1
MEASURED = np.array([[0.36, 0.1], [0.1, 0.2]])
"""A covariance that is neither round nor along an axis."""


def weighed(place, *, pace, rate=RATE, sensor=None, n=N):
    """Particles that are all at the origin and go east, given a measurement; -> weights, places and velocities."""
    config = FilterConfig(n_particles=n, innovation_outlier_rate=rate, outlier_probability=1e-9)
    road = one_cell_map(concentration=5.0, shape=10.0)
    bayes = gaussian_belief(ParticleFilter(road, config, sensor), 0, np.zeros(4), np.zeros((4, 4)))
    cloud, slot = bayes.cloud, np.array([0])
    cloud.speed[0], cloud.direction[0], bayes.cloud.since_s[0] = pace, 0.0, DT_S
    seen = Detections(track_id=["a"], time_ns=[0], position=[place], covariance=[MEASURED])
    evidence = bayes.weigh(slot, seen)
    assert evidence.is_moved[0] == (cloud.position[0] != 0.0).any()
    velocity = cloud.speed[0, :, None] * np.column_stack([np.cos(cloud.direction[0]), np.sin(cloud.direction[0])])
    return cloud.weight[0], cloud.position[0], velocity


def normal(off, covariance):
    return float(
        np.exp(-0.5 * off @ np.linalg.solve(covariance, off)) / (2 * np.pi * np.sqrt(np.linalg.det(covariance)))
    )


SENSOR = Sensor(along=AxisError(spread_m=0.6), across=AxisError(spread_m=0.4))


@pytest.mark.parametrize("sensor", [None, SENSOR])
@pytest.mark.parametrize("place", [(1.2, -0.4), (2.2, 0.5)])
def test_particles_follow_the_posterior_of_the_mixture(place, sensor):
    """Its share, mean and covariance in closed form; each is estimated to five standard errors, of which one in a
    million is exceeded.
    """
    z, prior = np.array(place), _measuring.PLACE_M**2 * np.eye(2)
    noise = MEASURED if sensor is None else np.diag([0.36, 0.16])
    share = RATE * DT_S
    ordinary, outlying = (1.0 - share) * normal(z, noise), share * normal(z, noise + prior)
    expected = outlying / (ordinary + outlying)
    weight, moved, _ = weighed(place, pace=10.0, sensor=sensor)
    is_moved = (moved != 0.0).any(axis=1)
    np.testing.assert_allclose(weight, 1.0 / N, rtol=1e-6)
    assert is_moved.mean() == pytest.approx(expected, abs=5.0 * np.sqrt(expected * (1.0 - expected) / N))
    gain, n = prior @ np.linalg.inv(prior + noise), is_moved.sum()
    exact, spread = gain @ z, prior - gain @ prior
    assert n > 100
    error = 5.0 * np.sqrt(np.diag(spread) / n)
    assert (np.abs(moved[is_moved].mean(axis=0) - exact) < error).all()
    assert (np.abs(moved[is_moved].mean(axis=0) - z) > error).any()  # the control: the measurement itself is farther
    found = np.cov(moved[is_moved].T)
    assert np.abs(found - spread).max() < 5.0 * spread.max() * np.sqrt(2.0 / n)


def test_who_is_behind_is_slower_and_who_is_aside_turns_but_not_who_stands():
    _, moved, velocity = weighed((-2.0, 0.0), pace=10.0)
    is_moved = (moved != 0.0).any(axis=1)
    assert velocity[is_moved, 0].mean() < 9.0
    assert velocity[~is_moved, 0].mean() > 9.9
    _, moved, velocity = weighed((0.0, 2.0), pace=10.0)
    assert velocity[(moved != 0.0).any(axis=1), 1].mean() > 0.5
    _, moved, velocity = weighed((-2.0, 0.0), pace=0.0)
    assert (moved != 0.0).any()
    assert (velocity == 0.0).all()


def worst_of_who_stops(seed, **given):
    """Drives at 8 m/s, stops within a second and stands for four; -> metres, the worst error once it has stood one."""
    rng, times = np.random.default_rng(seed), 0.1 * np.arange(80)
    speed = np.interp(times, [0.0, 3.0, 3.6, 8.0], [8.0, 8.0, 0.0, 0.0])
    east = np.append(0.0, np.cumsum(0.05 * (speed[1:] + speed[:-1])))
    tracker = Tracker(
        one_cell_map(concentration=50.0, shape=60.0), config=FilterConfig(n_particles=300, **given), tracking=TRUSTING,
        rng=rng,
    )  # fmt: skip
    error = []
    for t, x in zip(times, east, strict=True):
        seen = Detections(track_id=["a"], time_ns=[round(t * 1e9)], position=[rng.normal([x, 0.0], 0.5)])
        error.append(np.hypot(*(tracker.step(seen).position[0] - [x, 0.0])))
    return max(error[49:])


def test_a_driver_who_stops_dead_is_not_lost():
    """Over twenty logs the worst error is 1.0 m, with a deviation of 0.16: the mean of ten exceeds 1.25 m less than
    once in 10,000 times. Where no driver leaves the motion model it is 3.7 m, with a deviation of 0.33."""
    assert np.mean([worst_of_who_stops(seed) for seed in range(10)]) < 1.25
    assert np.mean([worst_of_who_stops(seed, innovation_outlier_rate=0.0) for seed in range(10)]) > 3.0
