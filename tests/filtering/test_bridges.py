"""Gaps: ways through them are a Kalman smoother's, or follow the map's road; pieces of tracks are joined or left."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import ConstantVelocityKalman, ParticleFilter
from dirprim_filter.filtering.kalman import WanderingKalman
from dirprim_filter.filtering.smoothing import bridge
from dirprim_filter.filtering.smoothing.bridge import Ends, Gaussian, without
from filtering.test_smoothing import smoothed
from moving import ring_road
from situations import gaussian_belief, one_cell_map, seen_at

EAST = one_cell_map(concentration=400.0, shape=100.0)
CONFIG = FilterConfig(noise_m=0.3, n_particles=500)


def driven(*times, speed=10.0, name="a"):
    """A vehicle eastwards, with half a metre of swing."""
    time_s = np.array(times)
    place = np.column_stack([speed * time_s, 0.5 * np.sin(time_s)])
    return Detections(track_id=[name] * len(times), time_ns=np.round(1e9 * time_s).astype(np.int64), position=place)


def asked(until_s, every_s=0.5):
    return [round(1e9 * every_s * i) for i in range(int(until_s / every_s) + 1)]


@pytest.mark.parametrize(("name", "out_s"), [("a", 8.0), ("a", 100.0), ("", 8.0)])
def test_who_is_named_and_seen_again_is_estimated_at_every_instant_between_however_long_its_belief_lasts(out_s, name):
    """Beliefs end after five seconds; the control is a vehicle without an id, of which nobody knows that it is it."""
    before, after = np.arange(0.0, 3.0, 0.5), np.arange(3.0 + out_s, 6.0 + out_s, 0.5)
    seen, times = driven(*before, *after, name=name), asked(5.0 + out_s, every_s=1.0)
    for model in (EAST, EAST.without_places()):
        later = smoothed(seen, model=model, times=times, config=CONFIG)[1]
        answered = np.isin(times, later.time_ns).mean()
        assert answered == 1.0 if name else answered < 0.95
        if name:
            assert np.abs(later.position[:, 0] - 1e-8 * later.time_ns).max() < 20.0


def test_a_vehicle_of_which_is_heard_each_ten_minutes_is_waited_for_for_hours():
    """But not for days: the control is the same name, seen again in another week."""
    before, slow = 600.0 * np.arange(9), replace(CONFIG, max_gap_s=1000.0, step_s=30.0)
    for away_s, is_known in ((3 * 3600.0, True), (5 * 86400.0, False)):
        seen = driven(*before, *(before[-1] + away_s + before[:3]), speed=0.5)
        times = asked(before[-1] + away_s, every_s=(before[-1] + away_s) / 50)
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
    found, exact = (smoothed(driven(*times), model=of, times=asked(12.5), config=CONFIG)[1] for of in (model, kalman))
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


PIECES = FilterConfig(n_particles=500)
N_FRAMES, SIDE_M = 80, 12.0


def side_by_side(*, ahead_m):
    """Two vehicles at 8 m/s, out of sight from 2 to 5 s, then so far ahead of where they would have been."""
    east = {i: 0.8 * i + (ahead_m if i >= 50 else 0.0) for i in [*range(20), *range(50, N_FRAMES)]}
    return [seen_at(0.1 * i, [(x, 0.0), (x, SIDE_M)], ids=["a", "b"]) for i, x in east.items()]


def pieced(seen, *, lag_s=None, scale=1.0):
    """What the filter says without ids, and what the smoother says; of a scene so many times as large."""
    seen, config = Detections.concatenate(seen), replace(PIECES, noise_m=scale * PIECES.noise_m)
    usual = TrackingConfig()
    densities = ("clutter_density", "birth_density", "vehicle_density")
    return smoothed(
        replace(seen, position=scale * seen.position),
        model=ConstantVelocityKalman(acceleration_density=0.2 * scale**2, config=config), with_ids=False,
        times=asked(0.1 * (N_FRAMES - 1), every_s=0.1), config=config, lag_s=lag_s,
        tracking=replace(usual, **{name: getattr(usual, name) / scale**2 for name in densities}),
    )  # fmt: skip


def test_pieces_of_a_vehicle_become_one_track_that_leads_through_the_gap():
    found, later = pieced(side_by_side(ahead_m=6.0))
    assert np.unique(found.track_id).size == 4  # the tracker lost both
    assert sorted(set(later.track_id.tolist())) == ["track-1", "track-2"]
    assert len(later) == 2 * N_FRAMES
    for name in ("track-1", "track-2"):
        way = later[later.track_id == name].position
        assert np.ptp(way[:, 1]) < 1.0  # neither took up the other's
        assert (np.diff(way[:, 0]) > 0.5).all()


@pytest.mark.parametrize(
    ("ahead_m", "scale", "lag_s", "n_tracks"),
    [(6.0, 0.2, None, 2), (7.5, 1.0, None, 4), (7.5, 0.2, None, 4), (6.0, 1.0, 1.0, 4)],
)
def test_people_are_joined_as_cars_are_nobody_who_is_too_far_away_and_with_a_lag_none(ahead_m, scale, lag_s, n_tracks):
    """In a scene a fifth as large, with everything that has a length, what appears is a fifth as fast."""
    assert np.unique(pieced(side_by_side(ahead_m=ahead_m), scale=scale, lag_s=lag_s)[1].track_id).size == n_tracks


def test_a_false_detection_long_after_the_last_is_cut_off_and_a_vehicle_seen_again_is_not():
    def times(again):
        return pieced([seen_at(0.1 * i, [(0.8 * i, 0.0)], ids=["a"]) for i in again])[1].time_ns // 100_000_000

    assert times([*range(20), 30]).max() == 19
    assert times([*range(20), *range(30, 35)]).max() == 34


@pytest.mark.parametrize("interval_s", [0.1, 0.5, 2.0])
def test_of_a_vehicle_without_a_name_all_rows_are_kept_however_seldom_the_sensor_looks(interval_s):
    time_s = interval_s * np.arange(40)
    rows = [seen_at(t, [(8.0 * t, 0.0)], ids=["a"]) for i, t in enumerate(time_s) if i % 5 != 4]
    model, times = ConstantVelocityKalman(acceleration_density=0.2, config=PIECES), asked(time_s[-1], interval_s)
    later = smoothed(Detections.concatenate(rows), model=model, with_ids=False, times=times, config=PIECES)[1]
    assert later.time_ns.tolist() == times[:-1]


def ends_of(model, off):
    """A gap of a second, after which a vehicle is so far ahead of what straight motion expects."""
    start = Gaussian(np.array([5.0, 1.0, 8.0, 0.5]), np.diag([0.2, 0.1, 0.3, 0.3]))
    return Ends.of(model, 0, start, 10**9, Gaussian(np.array([13.0 + off, 1.5, 8.0, 0.5]), 0.1 * np.eye(4)))


def test_the_evidence_of_a_gap_is_exact_for_constant_velocity_and_of_particles_that_move_alike_the_same():
    kalman = ConstantVelocityKalman(acceleration_density=0.5, config=PIECES)
    f = np.eye(4)
    f[0, 2] = f[1, 3] = 1.0
    for off in (0.0, 2.0):
        ends = ends_of(kalman, off)
        q = np.kron([[1 / 3, 1 / 2], [1 / 2, 1.0]], 0.5 * np.eye(2))
        p = f @ ends.start.covariance @ f.T + q + 0.1 * np.eye(4)
        exact = stats.multivariate_normal(cov=p).logpdf([off, 0.0, 0.0, 0.0])
        assert bridge.log_evidence(ends) == pytest.approx(exact, abs=1e-6)
    road = one_cell_map(mean=0.06, concentration=300.0, speed=8.0, shape=60.0)
    particles = gaussian_belief(ParticleFilter(road, PIECES), 0, *ends_of(kalman, 0.0).start)
    start = particles.states(np.zeros(1, np.int64))
    near, far = (
        bridge.log_density(particles, particles.straight(), ends_of(kalman, off), start, key=1) for off in (0.0, 2.0)
    )
    assert near > far + 1.0
