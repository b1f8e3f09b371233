"""The motion model: left alone it settles on the primitive, however time is cut, and turns with its bends."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from dirprim_filter import forecast
from dirprim_filter.config import FilterConfig
from dirprim_filter.filtering.particle_filter import ParticleFilter, longest_step_s
from moving import motion_by_hand, moved, only_places, squares
from situations import one_cell_map, seen_at

FALSE_ALARM = 1e-4  # of each statistical test below; seeds are fixed


def test_left_alone_direction_and_speed_settle_on_the_primitive():
    mode = {"mean": 0.3, "concentration": 400.0, "speed": 10.0, "shape": 1000.0}  # nearly normal, as the motion is
    found = moved(only_places(one_cell_map(**mode)), 40.0, n=40_000, direction=-0.2, speed=13.0)
    for wrong, accepted in ((1.0, True), (1.1, False)):
        direction = stats.vonmises(400.0 / wrong**2, loc=0.3)
        speed = stats.gamma(1000.0 / wrong**2, scale=10.0 / 1000.0 * wrong**2)
        assert (stats.kstest(found.direction, direction.cdf).pvalue > FALSE_ALARM) == accepted
        assert (stats.kstest(found.speed, speed.cdf).pvalue > FALSE_ALARM) == accepted
    soon = moved(only_places(one_cell_map(**mode)), 0.5, direction=-0.2, speed=13.0)
    assert soon.speed.mean() > 12.0  # not settled yet
    assert soon.direction.mean() < 0.2


def laws(primitive_map, *, seconds=4.0, **cut):
    """Samples of east, north, direction and speed some seconds after a start off the mode."""
    found = moved(primitive_map, seconds, direction=0.25, speed=7.0, **cut)
    return *found.position.T, found.direction, found.speed


def p_values(some, others):
    return [stats.ks_2samp(mine, theirs).pvalue for mine, theirs in zip(some, others, strict=True)]


def test_motion_is_the_same_however_time_is_cut():
    curved = one_cell_map(concentration=150.0, shape=30.0, side=200.0, bend=(0.01, -0.005))
    once = laws(curved, key=1)
    for key, cut in enumerate(({"n_calls": 40}, {"step_s": 0.05}, {"n_calls": 7}), start=2):
        assert min(p_values(once, laws(curved, key=key, **cut))) > FALSE_ALARM
    assert max(p_values(once, laws(curved, key=5, seconds=5.0))) < FALSE_ALARM


@pytest.mark.parametrize("seconds", [1.0, 10.0, 60.0])
def test_beliefs_moved_in_the_longest_steps_that_a_map_allows_are_those_of_fine_steps(seconds):
    """After the next measurement of a sensor that looks so seldom; steps of most of a minute are the control."""
    wide = one_cell_map(concentration=150.0, shape=30.0, side=4000.0, bend=(2e-4, -1e-4))
    config = FilterConfig(n_particles=4000, noise_m=2.0)

    def moved_in(step_s, key):
        found, slot = ParticleFilter(wide, config), np.zeros(1, np.int64)
        found.begin(slot, np.array([key], np.uint64), seen_at(0.0, [(0.0, 0.0)]))
        found.predict(slot, np.array([seconds]), None, np.array([step_s]))
        cloud = found.cloud
        drives = cloud.speed[0] > 1.0  # those that creep do so for a step
        return *cloud.position[0].T, cloud.direction[0], cloud.speed[0, drives]

    fine, longest, coarse = moved_in(0.05, 1), moved_in(longest_step_s(wide), 2), moved_in(40.0, 3)
    assert min(p_values(fine, longest)) > FALSE_ALARM
    if seconds > 1.0:
        assert min(p_values(fine, coarse)) < FALSE_ALARM


def test_the_quick_pass_less_than_half_a_cell_in_the_longest_step():
    for side, step_s in ((4.0, 0.4 * 4.0 / 10.0), (10.0, 0.4), (4000.0, 0.5)):
        assert longest_step_s(one_cell_map(side=side)) == pytest.approx(step_s)
    assert longest_step_s(one_cell_map().without_places()) == 0.5


def test_where_no_place_tells_vehicles_go_on_at_constant_velocity_with_noise():
    """Speed is pushed by an Ornstein-Uhlenbeck process of 1 m/s^2 and rate 0.5/s, direction diffuses by 0.2 rad."""
    t, free = 2.0, one_cell_map().without_places()
    found = moved(free, t, step_s=0.02)
    assert (found.cell == -1).all()
    of_speed = np.sqrt(2 / 0.5**2 * (0.5 * t - 1 + np.exp(-0.5 * t)))
    of_direction = 0.2 * np.sqrt(t)
    for wrong, accepted in ((1.0, True), (1.1, False)):
        speed, direction = stats.norm(10.0, wrong * of_speed), stats.norm(0.0, wrong * of_direction)
        assert (stats.kstest(found.speed, speed.cdf).pvalue > FALSE_ALARM) == accepted
        assert (stats.kstest(found.direction, direction.cdf).pvalue > FALSE_ALARM) == accepted
    straight_on = 10.0 * (1 - np.exp(-(0.2**2) * t / 2)) / (0.2**2 / 2)  # the mean of a cosine, over the way
    assert stats.ttest_1samp(found.position[:, 0], straight_on).pvalue > FALSE_ALARM
    assert stats.ttest_1samp(found.position[:, 0], 0.99 * straight_on).pvalue < FALSE_ALARM
    assert stats.ttest_1samp(found.position[:, 1], 0.0).pvalue > FALSE_ALARM


def test_a_cell_without_manoeuvres_of_its_own_is_no_place():
    here = one_cell_map(side=100.0)
    emptied = replace(here, motion=here.motion.without_places())
    of_nowhere, of_cell, placed = (moved(m, 3.0, n=200) for m in (here.without_places(), emptied, here))
    for name in ("position", "direction", "speed", "push"):
        np.testing.assert_array_equal(getattr(of_nowhere, name), getattr(of_cell, name))
        assert not np.array_equal(getattr(of_nowhere, name), getattr(placed, name)) or name == "push"


def test_vehicles_in_motion_leave_the_map_at_their_rate_and_go_on_by_the_noise_of_the_background():
    """On one cell, into which none enters again, an exponential waiting time."""
    n, t, rate = 20_000, 2.0, 0.3
    road = only_places(one_cell_map(side=2000.0, concentration=1e4, shape=1e4))
    runs = [moved(road, t, n=n, own_way_rate=rate, key=key) for key in range(8)]
    left = sum(int((run.manoeuvre != 0).sum()) for run in runs)
    assert stats.binomtest(left, 8 * n, 1 - np.exp(-rate * t)).pvalue > FALSE_ALARM
    assert stats.binomtest(left, 8 * n, 1 - np.exp(-1.03 * rate * t)).pvalue < FALSE_ALARM  # 3 % more often
    found, left = runs[0], runs[0].manoeuvre != 0
    assert found.direction[left].std() > 5 * found.direction[~left].std()
    assert (moved(road, t, n=n).manoeuvre == 0).all()


def test_a_vehicle_that_stands_starts_at_its_rate():
    n, rate = 20_000, 0.5
    waits = motion_by_hand([0, 0], start_rate=[rate, 0.0], acceleration=[[0.0] * 4, [2.0, 0, 0, -0.2]])
    for t in (0.5, 1.0, 3.0):
        found = moved(squares(1, 1, waits, side=200.0), t, n=n, step_s=0.01, place=(100.0, 100.0), speed=0.0)
        started = found.speed >= 0.3
        assert stats.binomtest(int(started.sum()), n, 1 - np.exp(-rate * t)).pvalue > FALSE_ALARM
        assert stats.binomtest(int(started.sum()), n, 1 - np.exp(-1.1 * rate * t)).pvalue < FALSE_ALARM
        assert (found.manoeuvre == started).all()
        np.testing.assert_array_equal(found.position[~started], 100.0)
        # Speed since the start shows when that was: 10 - 9.69 exp(-0.2 age).
        age = 5.0 * np.log(9.69 / (10.0 - found.speed[started]))
        law = stats.truncexpon(rate * t, scale=1 / rate)
        assert stats.kstest(t - age, law.cdf).pvalue > FALSE_ALARM
    assert stats.kstest(t - age, stats.truncexpon(1.2 * rate * t, scale=1 / (1.2 * rate)).cdf).pvalue < FALSE_ALARM


def test_a_vehicle_that_brakes_to_a_stop_stands():
    brakes = motion_by_hand([0, 0], start_rate=[1e-9, 0.0], acceleration=[[0.0] * 4, [-3.0, 0, 0, 0]])
    found = moved(squares(1, 1, brakes, side=200.0), 6.0, n=50, place=(100.0, 100.0), speed=9.0)
    assert (found.manoeuvre == 0).all()
    assert (found.speed < 0.3).all()
    np.testing.assert_allclose(found.position[:, 0], 100.0 + 9.0**2 / 6.0, atol=1.0)  # v^2 / 2a


RADIUS = 20.0


def circling(**settings):
    """A cell whose mode turns to the left by 1 / RADIUS along its way east, at first."""
    return only_places(one_cell_map(side=60.0, bend=(1 / RADIUS, 0.0), **settings))


def test_a_vehicle_turns_with_the_bend_as_the_line_of_the_field_does():
    """The line of course x / R through the origin: y = -R log cos(x / R)."""
    east = {"position": (0.0, 0.0), "direction": 0.0, "speed": 10.0, "rng": np.random.default_rng(0)}
    path = forecast(circling(), **east, horizon_s=2.0, dt_s=0.1).mean(axis=0)
    np.testing.assert_allclose(path[:, 1], -RADIUS * np.log(np.cos(path[:, 0] / RADIUS)), atol=0.1)
    assert path[-1, 1] > 5.0


def test_speed_settles_on_the_gain_of_the_place():
    """At the pace v(north) that reversion holds in balance: what is gained there is what is lost of the surplus."""
    climbing = only_places(one_cell_map(shape=400.0, concentration=1e4, gain=(0.0, 0.02)))  # north, across the course
    for north in (-10.0, 10.0):
        start = {"position": (0.0, north), "direction": 0.0, "speed": 10.0, "rng": np.random.default_rng(0)}
        paths = forecast(climbing, **start, horizon_s=20.0, dt_s=1.0, n_samples=400)
        speed, place = np.diff(paths[:, 14:, 0], axis=1).mean(), paths[:, 14:, 1].mean()
        assert speed == pytest.approx(10.0 * (1 + 0.02 * place), rel=0.02)
        assert abs(speed - 10.0) > 1.0


@pytest.mark.parametrize("place", [(10.0, 0.0), (-25.0, 5.0), (28.0, -28.0)])
def test_a_belief_is_born_of_the_density_of_its_place(place):
    """Far from the centre of a cell that bends and gains: direction and speed are those of `log_density` there."""
    bent = circling(concentration=40.0, shape=12.0, gain=(0.01, -0.004))
    filter_ = ParticleFilter(bent, FilterConfig(n_particles=20_000, noise_m=1e-6))
    slot, place = np.zeros(1, np.int64), np.array(place)
    filter_.begin(slot, np.array([7], np.uint64), seen_at(0.0, [place]))
    cloud = filter_.cloud
    theta, v = np.linspace(-np.pi, np.pi, 20_001), np.linspace(1e-3, 80.0, 20_001)

    def below(grid, log_density, drawn):
        total = np.concatenate([[0.0], np.cumsum(np.diff(grid) * np.exp(log_density[:-1] + np.diff(log_density) / 2))])
        assert total[-1] == pytest.approx(1.0, abs=1e-4)
        return np.interp(drawn, grid, total)

    of_direction, of_speed = bent.direction_log_density(place, theta), bent.speed_log_density(place, v)
    assert stats.kstest(below(theta, of_direction, cloud.direction[0]), "uniform").pvalue > FALSE_ALARM
    assert stats.kstest(below(v, of_speed, cloud.speed[0]), "uniform").pvalue > FALSE_ALARM
    of_center, at_center = bent.direction_log_density(np.zeros(2), theta), bent.speed_log_density(np.zeros(2), v)
    assert stats.kstest(below(theta, of_center, cloud.direction[0]), "uniform").pvalue < FALSE_ALARM
    assert stats.kstest(below(v, at_center, cloud.speed[0]), "uniform").pvalue < FALSE_ALARM
