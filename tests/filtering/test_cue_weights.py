"""Cues weigh what vehicles are about to do: Eq. 4 over the manoeuvres that they may drive."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from dirprim_filter import Tracks, forecast, learn_primitives
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import ConstantVelocityKalman, Tracker
from dirprim_filter.filtering.particle_filter import ParticleFilter
from dirprim_filter.primitives.cues import TURN_LEFT, TURN_RIGHT, Cue
from dirprim_filter.primitives.motion_table import under
from moving import motion_by_hand, squares
from situations import TRUSTING, tracks_of

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
    still = {"resample_below": 0.0, "innovation_outlier_rate": 0.0, "noise_m": 20.0}
    tracker = Tracker(
        crossing(right=4, straight=10, left=6), config=FilterConfig(n_particles=400, **still), tracking=TRUSTING,
        rng=np.random.default_rng(3),
    )  # fmt: skip
    for i in range(n_frames):
        cue = [[np.nan, np.nan] if side is None or i < 2 or i in off else [side * np.pi / 2, 2.5]]
        place = [[MIDDLE[0] + i, MIDDLE[1]]]
        frame = tracker.track(Detections(track_id=["a"], time_ns=[i * 10**8], position=place, cue=cue))
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


FORK_M, TURN_M, PACE = 150.0, 10.0, 8.0
"""Where a road forks into two that are driven as often, straight on and right by an arc; m/s."""


def forking(turns, *, from_m=0.0, to_m=300.0, dt_s=0.1, aside=0.0):
    """(n, 2), (n,) places and courses of a vehicle each `dt_s`."""
    way = np.arange(from_m, to_m, PACE * dt_s)
    angle = np.clip((way - FORK_M) / TURN_M, 0.0, np.pi / 2) * turns
    on = np.maximum(way - FORK_M - TURN_M * np.pi / 2, 0.0)
    east = np.where(turns, np.minimum(way, FORK_M) + TURN_M * np.sin(angle), way)
    return np.column_stack([east, aside - turns * (TURN_M * (1.0 - np.cos(angle)) + on)]), -angle


@pytest.fixture(scope="module")
def fork():
    """A map of forty vehicles, each second of which turns."""
    parts, rng = [], np.random.default_rng(0)
    for k in range(40):
        place, course = forking(k % 2, aside=rng.normal(0.0, 0.3))
        parts.append(tracks_of([place], track_id=f"v{k}", direction=course, speed=PACE))
    return learn_primitives(Tracks.concatenate(parts), tessellation="grid", cell_size=8.0, rng=rng)


def mean_north(fork, seen_to_m, cue, *, seconds=2.5):
    """Of a vehicle so long after it was last seen; without noise of measurements."""
    place, _ = forking(False, from_m=seen_to_m - 40.0, to_m=seen_to_m)
    tracker = Tracker(fork, tracking=TRUSTING, rng=np.random.default_rng(1))
    signal = [[np.nan, np.nan] if cue is None else [cue, 2.5]]
    for i, z in enumerate(place):
        tracker.step(Detections(track_id=["a"], time_ns=[i * 10**8], position=[z], cue=signal))
    later_ns = (len(place) - 1) * 10**8 + round(seconds * 1e9)
    return tracker.step(Detections.none(), time_ns=later_ns).position[0, 1]


def test_past_the_fork_the_signal_is_not_forgotten(fork):
    """All that turn are as far south as `right`; of two ways as usual Eq. 4 gives exp(2.5) to 1 that it turns."""
    for seen_to in (FORK_M, FORK_M - 15.0):
        seconds = 2.5 + (FORK_M - seen_to) / PACE
        right = forking(True, to_m=FORK_M + 2.5 * PACE)[0][-1, 1]
        cues = (None, -np.pi / 2, np.pi / 2)
        without, given, wrong = (mean_north(fork, seen_to, cue, seconds=seconds) for cue in cues)
        assert 0.3 * right > without > 0.75 * right
        assert given < 0.8 * right
        assert wrong > 0.4 * right


def test_a_filter_that_does_not_know_what_comes_next_takes_no_cue():
    seen = Detections(track_id=["a"], time_ns=[0], position=[[0.0, 0.0]], cue=[[1.0, 2.5]])
    tracker = Tracker(ConstantVelocityKalman(acceleration_density=1.0), tracking=TRUSTING, rng=np.random.default_rng(0))
    for i in range(3):
        found = tracker.step(replace(seen, time_ns=seen.time_ns + i))
    assert len(found) == 1
