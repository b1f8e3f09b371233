"""Cues weigh what vehicles are about to do: Eq. 4 over the manoeuvres that they may drive."""

import numpy as np
import pytest
from scipy import stats

from dirprim_filter import forecast
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering.particle_filter import ParticleFilter
from dirprim_filter.primitives.cues import TURN_LEFT, TURN_RIGHT, Cue
from dirprim_filter.primitives.motion_table import under
from moving import motion_by_hand, squares
from situations import TRUSTING, seen_at, tracker_of

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
    filter_.begin(np.zeros(1, np.int64), np.array([3], np.uint64), seen_at(0.0, [MIDDLE], ids=["a"]))
    return filter_


def test_a_particle_is_weighed_by_how_far_its_manoeuvre_turns(started):
    slot, cloud = np.zeros(1, np.int64), started.cloud
    weight = cloud.weight[0].copy()
    turn = np.array([*TURNS, 0.0, 0.0])[cloud.manoeuvre[0]]  # those of no place go straight on
    assert set(np.unique(cloud.manoeuvre[0])) >= {0, 1, 2}
    fit = stats.vonmises(2.5, loc=np.pi / 2).pdf(turn)
    assert started.weigh_by_cue(slot, TURN_LEFT)[0] == pytest.approx(np.log(weight @ fit))
    np.testing.assert_allclose(cloud.weight[0], weight * fit / (weight @ fit), rtol=1e-9)


def test_a_cue_sharper_than_any_turn_weighs_too_and_one_that_fits_no_turn_says_nothing(started):
    slot, cloud = np.zeros(1, np.int64), started.cloud
    cloud.weight[0, cloud.manoeuvre[0] == 2] = 0.0
    cloud.weight[0] /= cloud.weight[0].sum()
    assert np.isfinite(started.weigh_by_cue(slot, Cue(turn=np.pi / 2, concentration=1e4)))
    assert np.isfinite(cloud.weight[0]).all()
    assert cloud.weight[0, (cloud.manoeuvre[0] != 0) & (cloud.manoeuvre[0] != 2)].sum() == pytest.approx(1.0)
    favour = under(started._table, Cue(turn=np.pi / 2, concentration=1e4)).favour
    assert favour[2] == 1.0
    assert 0.0 < favour[0] == favour[1] < 1e-20


def signalling(side, *, n_frames=8, off=()):
    """Particles after some frames of a vehicle on the crossing that signals from the third on; none is resampled."""
    still = {"n_particles": 400, "resample_below": 0.0, "innovation_outlier_rate": 0.0, "noise_m": 20.0}
    tracker = tracker_of(crossing(right=4, straight=10, left=6), tracking=TRUSTING, seed=3, **still)
    for i in range(n_frames):
        cue = [[np.nan, np.nan] if side is None or i < 2 or i in off else [side * np.pi / 2, 2.5]]
        frame = tracker.track(seen_at(0.1 * i, [(MIDDLE[0] + i, MIDDLE[1])], ids=["a"], cue=cue))
    return frame.particles.thinned(1)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("off", [(), (6, 7), (3, 5, 7)], ids=["lasts", "ends", "blinks"])
def test_through_the_tracker_a_signal_weighs_once_at_its_onset(side, off):
    without, given = signalling(None), signalling(side, off=off)
    np.testing.assert_array_equal(given.manoeuvre, without.manoeuvre)
    turn = np.append(TURNS, np.zeros(20))[given.manoeuvre]
    expected = without.weight * stats.vonmises(2.5, loc=side * np.pi / 2).pdf(turn)
    np.testing.assert_allclose(given.weight, expected / expected.sum(), rtol=1e-9)
    its_side, other = (particles.weight[turn == side * np.pi / 2].sum() for particles in (given, without))
    assert its_side > 2 * other


@pytest.mark.parametrize("before_m", [1.0, 15.0])
def test_past_a_fork_the_signal_is_not_forgotten(before_m):
    """In the second of two cells each other vehicle turns right; this one was last seen so far before it.

    By Eq. 4 it is exp(2.5) to 1 that it turns, a share of 0.92, or 0.08 to the other side. Later some take up another
    way: six seeds show 0.87, 0.46 without a signal and 0.07, with deviations of 0.01. The limits are five away.
    """
    bend, course = np.array([[0.0, 0.0], [0.0, 0.0], [-1.0 / RADIUS, 0.0]]), [0.0, 0.0, -0.5 * SIDE / RADIUS]
    driven = {"bend": bend, "course": course, "turn_ahead": TURNS[[1, 1, 0]]}
    ways = motion_by_hand([0, 1, 1], **driven, transitions=[(0, 1, 1.0), (0, 2, 1.0)])

    def share_that_turns(*cue):
        tracker = tracker_of(squares(2, 1, ways, side=SIDE), tracking=TRUSTING, n_particles=2000, noise_m=0.1)
        for i in range(20):
            tracker.step(seen_at(0.1 * i, [(SIDE - before_m - 19.0 + i, SIDE / 2)], ids=["a"], cue=[cue]))
        later_ns = round(1e9 * (3.9 + 0.1 * before_m))
        found = tracker.track(Detections.none(), time_ns=later_ns).particles.thinned(1)
        straight, right = (found.weight[found.manoeuvre == way].sum() for way in (1, 2))
        return right / (straight + right)

    assert share_that_turns(-np.pi / 2, 2.5) > 0.8
    assert 0.35 < share_that_turns(np.nan, np.nan) < 0.55
    assert share_that_turns(np.pi / 2, 2.5) < 0.15


def test_a_filter_that_does_not_know_what_comes_next_takes_no_cue():
    tracker = tracker_of(None, tracking=TRUSTING)
    for i in range(3):
        found = tracker.step(seen_at(0.1 * i, [(0.0, 0.0)], ids=["a"], cue=[[1.0, 2.5]]))
    assert len(found) == 1
