"""Weighing where few particles come near: against the exact update of a Gaussian, and of one with two arms."""

import numpy as np
import pytest

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import ParticleFilter
from situations import one_cell_map

N, NOISE_M, SEEDS = 1000, 0.5, range(20)
FAR = 3.7  # standard deviations of the belief's place: two of ten thousand particles get there


def filter_of(**knobs):
    model = one_cell_map(concentration=5.0, shape=10.0)
    made = ParticleFilter(model, FilterConfig(n_particles=N, noise_m=NOISE_M, outlier_probability=1e-12, **knobs))
    made.reserve(len(SEEDS))
    return made


@pytest.fixture(scope="module")
def bayes():
    """One filter for all tests: each places beliefs of its own."""
    return filter_of()


def believe(bayes, mean, covariance, *, seeds):
    """A Gaussian of x, y and their rates in a slot for each seed; -> the particles."""
    n = len(seeds)
    bayes.place(np.arange(n), np.array(seeds, np.uint64), np.tile(mean, (n, 1)), np.tile(covariance, (n, 1, 1)))
    return bayes.belief.cloud


def weigh(bayes, place, *, n=1):
    seen = Detections(track_id=[f"{i}" for i in range(n)], time_ns=np.zeros(n, np.int64), position=[place] * n)
    return bayes.weigh(np.arange(n), seen)


def moments(cloud, slot):
    """Of x and speed, by weight: mean (2,), covariance (2, 2)."""
    state = np.column_stack([cloud.position[slot, :, 0], cloud.speed[slot]])
    weight = cloud.weight[slot]
    return np.average(state, axis=0, weights=weight), np.cov(state.T, aweights=weight, ddof=0)


def after_a_gap():
    """A belief of x and its rate as after three seconds out of sight, and its exact update by a place FAR off."""
    covariance = np.diag([0.0, 0.04, 0.0, 1e-4])
    covariance[np.ix_([0, 2], [0, 2])] = [[16.0, 7.0], [7.0, 4.0]]
    mean, z = np.array([0.0, 0.0, 12.0, 0.0]), FAR * 4.0
    gain = np.array([16.0, 7.0]) / (16.0 + NOISE_M**2)
    exact = np.array([[16.0, 7.0], [7.0, 4.0]]) - np.outer(gain, [16.0, 7.0])
    return mean, covariance, z, np.array([0.0, 12.0]) + gain * z, exact


def updated(bayes):
    mean, covariance, z, *_ = after_a_gap()
    cloud = believe(bayes, mean, covariance, seeds=SEEDS)
    weigh(bayes, [z, 0.0], n=len(SEEDS))
    return [np.array(column) for column in zip(*(moments(cloud, s) for s in range(len(SEEDS))), strict=True)]


def test_a_vehicle_found_where_hardly_a_particle_is_has_the_belief_that_bayes_says(bayes):
    *_, exact_mean, exact = after_a_gap()

    def nees(of):
        """Mean squared error of the means in units of the stated and the exact covariance: 2 more than exact."""
        means, covariances = updated(of)
        off = means - exact_mean
        stated = np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariances + 1e-9 * np.eye(2)), off)
        return float(np.median(stated)), float(np.median(covariances[:, 1, 1] / exact[1, 1]))

    error, spread = nees(bayes)
    assert error < 1.5  # half of what an error drawn from the belief has
    assert 0.5 < spread < 1.5
    error, spread = nees(filter_of(widen_below=0.0, innovation_outlier_rate=0.0))
    assert error > 3.0
    assert spread < 0.5


def test_where_many_particles_come_near_none_is_moved(bayes):
    mean, covariance, *_ = after_a_gap()
    cloud = believe(bayes, mean, covariance / 25.0, seeds=[0])
    before = cloud.position[0].copy()
    assert not weigh(bayes, [0.5, 0.0]).is_moved.any()
    np.testing.assert_array_equal(cloud.position[0], before)


def test_of_a_belief_with_two_arms_the_other_arm_gets_no_particle(bayes):
    mean, covariance, *_ = after_a_gap()
    cloud = believe(bayes, mean, covariance / 16.0, seeds=[3])
    cloud.position[0, :, 1] += np.where(np.arange(N) % 2 == 0, 8.0, -8.0)
    cloud.direction[0] += np.where(np.arange(N) % 2 == 0, 0.8, -0.8)
    assert weigh(bayes, [3.2, 8.0]).is_moved.all()
    near = cloud.weight[0] > 0.1 / N
    assert near.sum() >= bayes.config.widen_below * N
    assert (cloud.position[0, near, 1] > 5.0).all()
    assert (cloud.direction[0, near] > 0.4).all()


def test_an_outlier_and_a_measurement_that_nothing_explains_move_nothing(bayes):
    mean, covariance, *_ = after_a_gap()
    cloud = believe(bayes, mean, covariance, seeds=[4])
    before = cloud.position[0].copy()
    evidence = weigh(bayes, [300.0, 0.0])
    assert evidence.is_unexplained.all()
    assert not evidence.is_moved.any()
    np.testing.assert_array_equal(cloud.position[0], before)


def test_who_stands_keeps_standing(bayes):
    mean, covariance, *_ = after_a_gap()
    cloud = believe(bayes, mean, covariance, seeds=[5])
    cloud.speed[0, ::2] = 0.0
    before = cloud.direction[0].copy()
    assert weigh(bayes, [10.0, 0.0]).is_moved.all()
    assert (cloud.speed[0, ::2] == 0.0).all()
    np.testing.assert_array_equal(cloud.direction[0, ::2], before[::2])
    assert (cloud.speed[0] >= 0.0).all()
