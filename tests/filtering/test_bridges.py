"""Ways through gaps: straight on they are a Kalman smoother's, by the map they follow the road; none is left out."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import ParticleFilter
from dirprim_filter.filtering.kalman import WanderingKalman
from dirprim_filter.filtering.smoothing import bridge
from dirprim_filter.filtering.smoothing.bridge import Ends, Gaussian, without
from filtering.test_smoothing import smoothed
from moving import ring_road
from situations import gaussian_belief, one_cell_map

EAST = one_cell_map(concentration=400.0, shape=100.0)
CONFIG = FilterConfig(noise_m=0.3, n_particles=500)


def driven(*times, speed=10.0, name="a"):
    """A vehicle eastwards, with half a metre of swing."""
    time_s = np.array(times)
    place = np.column_stack([speed * time_s, 0.5 * np.sin(time_s)])
    return Detections(track_id=[name] * len(times), time_ns=np.round(1e9 * time_s).astype(np.int64), position=place)


def asked(until_s, every_s=0.5):
    return [round(1e9 * every_s * i) for i in range(int(until_s / every_s) + 1)]


@pytest.mark.parametrize("out_s", [8.0, 100.0])
@pytest.mark.parametrize("name", ["a", ""])
def test_who_is_named_and_seen_again_is_estimated_at_every_instant_between_however_long_its_belief_lasts(out_s, name):
    """Beliefs end after five seconds; the control is a vehicle without an id, of which nobody knows that it is it."""
    before, after = np.arange(0.0, 3.0, 0.5), np.arange(3.0 + out_s, 6.0 + out_s, 0.5)
    for model in (EAST, EAST.without_places()):
        later = smoothed(
            driven(*before, *after, name=name), model=model, times=asked(5.5 + out_s), config=CONFIG
        )[1]  # fmt: skip
        answered = np.isin(asked(5.5 + out_s), later.time_ns).mean()
        assert answered == 1.0 if name else answered < 0.95
        if name:
            assert np.abs(later.position[:, 0] - 1e-8 * later.time_ns).max() < 20.0


def test_a_vehicle_of_which_is_heard_each_ten_minutes_is_waited_for_for_hours():
    """But not for days: the control is the same name, seen again in another week."""
    before, slow = 600.0 * np.arange(9), replace(CONFIG, max_gap_s=1000.0, step_s=30.0)
    for away_s, is_known in ((3 * 3600.0, True), (5 * 86400.0, False)):
        seen = driven(*before, *(before[-1] + away_s + before[:3]), speed=0.5)
        times = [*asked(before[-1] + away_s, every_s=(before[-1] + away_s) / 200)]
        later = smoothed(seen, model=EAST.without_places(), times=times, config=slow)[1]
        assert (np.isin(times, later.time_ns).mean() == 1.0) == is_known


def test_stretches_of_less_than_a_second_know_that_an_acceleration_lasts():
    """So its density over a tenth of one is that over a second; over five it is that of what lasts longer, too."""
    kalman = WanderingKalman(np.array([0.1, 0.1]), np.array([[4.0, 4.0], [2.0, 2.0]]))
    np.testing.assert_allclose(kalman.density(0.1), kalman.density(1.0))
    assert (np.diagonal(kalman.density(5.0)) > 1.5 * np.diagonal(kalman.density(1.0))).all()


def test_a_false_name_far_away_is_another_vehicle():
    seen = Detections.concatenate([driven(*np.arange(0.0, 3.0, 0.5)), driven(*np.arange(8.0, 10.0, 0.5), speed=300.0)])
    later = smoothed(seen, model=EAST, times=asked(9.5), config=CONFIG)[1]
    assert (later.position[later.time_ns < 7.5e9, 0] < 80.0).all()


def test_without_a_map_the_way_is_the_kalman_smoothers_of_the_backgrounds_acceleration():
    times = [*np.arange(0.0, 4.0, 0.5), *np.arange(10.0, 13.0, 0.5)]
    model = EAST.without_places()
    kalman = WanderingKalman(*model.motion.wander(), config=CONFIG)
    found, exact = (
        smoothed(driven(*times), model=of, times=asked(12.5), config=CONFIG)[1] for of in (model, kalman)
    )  # fmt: skip
    np.testing.assert_array_equal(found.time_ns, exact.time_ns)
    gap = (found.time_ns > 3.5e9) & (found.time_ns < 1e10)
    np.testing.assert_allclose(found.position[gap], exact.position[gap], atol=0.05)
    np.testing.assert_allclose(found.covariance[gap], exact.covariance[gap], rtol=0.05, atol=1e-6)


def test_what_was_learned_since_is_the_quotient_of_densities():
    rng = np.random.default_rng(0)
    before, since = (Gaussian(rng.normal(size=4), (root := rng.normal(size=(4, 4))) @ root.T + np.eye(4)) for _ in "ab")
    gain = before.covariance @ np.linalg.inv(before.covariance + since.covariance)
    known = Gaussian(before.mean + gain @ (since.mean - before.mean), before.covariance - gain @ before.covariance)
    found = without(known, before)
    np.testing.assert_allclose(found.mean, since.mean, atol=1e-8)
    np.testing.assert_allclose(found.covariance, since.covariance, atol=1e-8)


def test_a_way_by_the_map_follows_the_road_also_where_few_would_arrive_and_is_likelier_than_the_straight_one():
    """A ring of 20 m; the vehicle is back where one sample in a thousand would be: a tenth faster than all others."""
    road = ring_road(20.0, pace=8.0, swing=0.0, back=0.5, shape=2000.0)
    road = replace(road, motion=replace(road.motion, push=np.full(len(road.motion), 0.5)))
    particles = ParticleFilter(road, FilterConfig(n_particles=1000, own_way_rate=0.0))

    def at(angle):
        return np.array([20 * np.cos(angle), 20 * np.sin(angle), -8 * np.sin(angle), 8 * np.cos(angle)])

    start = Gaussian(at(0.0), np.diag([0.04, 0.04, 0.04, 0.04]))
    samples = gaussian_belief(particles, 3, *start)
    model = particles.straight()
    ends = Ends.of(model, 0, start, 5 * 10**9, Gaussian(at(2.2), 0.1 * np.eye(4)))
    time_ns = np.arange(1, 10) * 500_000_000
    way = bridge.across(particles, model, ends, samples.states(np.zeros(1, np.int64)), time_ns, key=5)
    assert np.abs(np.hypot(*way.mean[:, :2].T) - 20.0).max() < 0.7
    assert np.abs(np.hypot(*bridge.straight(model, ends, time_ns).mean[:, :2].T) - 20.0).max() > 2.0
    evidence = bridge.log_density(particles, model, ends, samples.states(np.zeros(1, np.int64)), key=5)
    assert evidence > bridge.log_evidence(ends) + 1.0
