"""Cues weigh what vehicles are about to do: Eq. 4 over the manoeuvres that they may drive."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from dirprim_filter import forecast
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import ConstantVelocityKalman, Tracker
from dirprim_filter.filtering.particle_filter import ParticleFilter
from dirprim_filter.primitives.cues import TURN_LEFT, TURN_RIGHT, Cue
from moving import motion_by_hand, squares
from situations import TRUSTING

SIDE, RADIUS = 400.0, 20.0
MIDDLE = (SIDE / 2, SIDE / 2)
TURNS = np.array([-np.pi / 2, 0.0, np.pi / 2])


def crossing(*, right, straight, left):
    """A cell in whose middle so many vehicles go each way: on curves of 20 m radius, or straight on."""
    amount = np.array([right, straight, left], float)
    bend = np.array([[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0]]) / RADIUS
    ways = motion_by_hand([0, 0, 0], visits=amount, seconds=amount, bend=bend, turn_ahead=TURNS)
    return squares(1, 1, ways, side=SIDE)


def turned_by(primitive_map, cue):
    """Shares of 4,000 rollouts that went right, straight on and left."""
    paths = forecast(
        primitive_map, position=MIDDLE, direction=0.0, speed=10.0, horizon_s=3.0, n_samples=4000, cue=cue,
        rng=np.random.default_rng(0),
    )  # fmt: skip
    north = paths[:, -1, 1] - SIDE / 2
    return np.array([(north < -5).mean(), (np.abs(north) <= 5).mean(), (north > 5).mean()])


@pytest.mark.parametrize("cue", [TURN_LEFT, TURN_RIGHT, Cue(turn=[0.0, np.pi / 2], concentration=[4.0, 1.0])])
def test_of_three_ways_each_is_taken_as_eq_4_says(cue):
    prior = np.array([0.2, 0.5, 0.3])
    ways = crossing(right=4, straight=10, left=6)
    np.testing.assert_allclose(turned_by(ways, None), prior, atol=4 * 0.5 / np.sqrt(4000))
    reported = cue.belief(0.0)
    density = sum(
        w * stats.vonmises(k, loc=m).pdf(TURNS)
        for w, m, k in zip(reported.weight, reported.mean_direction, reported.concentration, strict=True)
    )
    expected = prior * density / (prior @ density)
    np.testing.assert_allclose(turned_by(ways, cue), expected, atol=0.04)
    assert np.abs(expected - prior).max() > 0.1


@pytest.fixture
def started():
    """A filter of one vehicle in the middle of a crossing."""
    filter_ = ParticleFilter(crossing(right=2, straight=2, left=2), FilterConfig(n_particles=500))
    here = Detections(track_id=np.array(["a"]), time_ns=np.zeros(1, np.int64), position=np.array([MIDDLE]))
    filter_.begin(np.zeros(1, np.int64), np.array([3], np.uint64), here)
    return filter_


def test_a_particle_is_weighed_by_how_far_its_manoeuvre_turns(started):
    slot, cloud = np.zeros(1, np.int64), started.cloud
    weight = cloud.weight[0].copy()
    turn = np.array([*TURNS, 0.0, 0.0])[cloud.manoeuvre[0]]  # those of no place go straight on
    assert set(np.unique(cloud.manoeuvre[0])) >= {0, 1, 2}
    fit = stats.vonmises(2.5, loc=np.pi / 2).pdf(turn)
    assert started.weigh_by_cue(slot, TURN_LEFT)[0] == pytest.approx(np.log(weight @ fit))
    np.testing.assert_allclose(cloud.weight[0], weight * fit / (weight @ fit), rtol=1e-9)


def signalling(side, *, n_frames=8, off_from=99):
    """Particles after some frames of a vehicle on the crossing that signals from the third on; none is resampled."""
    still = {"resample_below": 0.0, "innovation_outlier_rate": 0.0, "noise_m": 20.0}
    tracker = Tracker(
        crossing(right=4, straight=10, left=6), config=FilterConfig(n_particles=400, **still), tracking=TRUSTING,
        rng=np.random.default_rng(3),
    )  # fmt: skip
    for i in range(n_frames):
        cue = [[np.nan, np.nan] if side is None or not 2 <= i < off_from else [side * np.pi / 2, 2.5]]
        place = [[MIDDLE[0] + i, MIDDLE[1]]]
        frame = tracker.track(Detections(track_id=["a"], time_ns=[i * 10**8], position=place, cue=cue))
    return frame.particles.thinned(1)


@pytest.mark.parametrize("side", [1, -1])
def test_through_the_tracker_a_signal_weighs_once_however_long_it_lasts_and_not_when_it_is_off(side):
    without, given = signalling(None), signalling(side)
    np.testing.assert_array_equal(given.manoeuvre, without.manoeuvre)
    turn = np.append(TURNS, np.zeros(20))[given.manoeuvre]
    expected = without.weight * stats.vonmises(2.5, loc=side * np.pi / 2).pdf(turn)
    np.testing.assert_allclose(given.weight, expected / expected.sum(), rtol=1e-9)
    its_side, other = (particles.weight[turn == side * np.pi / 2].sum() for particles in (given, without))
    assert its_side > 2 * other
    np.testing.assert_allclose(signalling(side, off_from=6).weight, without.weight, rtol=1e-9)


def test_a_filter_that_does_not_know_what_comes_next_takes_no_cue():
    seen = Detections(track_id=["a"], time_ns=[0], position=[[0.0, 0.0]], cue=[[1.0, 2.5]])
    tracker = Tracker(ConstantVelocityKalman(acceleration_density=1.0), tracking=TRUSTING, rng=np.random.default_rng(0))
    for i in range(3):
        found = tracker.step(replace(seen, time_ns=seen.time_ns + i))
    assert len(found) == 1
