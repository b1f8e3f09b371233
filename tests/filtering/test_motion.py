"""The motion model: left alone it settles on the primitive, however finely time is cut."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from dirprim_filter.config import FilterConfig
from dirprim_filter.filtering.motion import forecast_table, tracking_table
from dirprim_filter.primitives import _motion
from moving import ALONE, motion_by_hand, moved, only_places, seeded, settled, squares
from situations import one_cell_map
from tessellation import GridTessellation
from tessellation._kernels import locate
from tessellation.locate import reaching

FALSE_ALARM = 1e-4  # of each statistical test below; seeds are fixed
FINE, FINER = FilterConfig(step_s=0.02), FilterConfig(step_s=0.01)


def test_left_alone_direction_and_speed_settle_on_the_primitive():
    mode = {"mean": 0.3, "concentration": 400.0, "speed": 10.0, "shape": 1000.0}  # nearly normal, as the motion is
    found = moved(only_places(one_cell_map(**mode)), 40.0, n=40_000, direction=-0.2, speed=13.0)
    for wrong, accepted in ((1.0, True), (1.1, False)):
        direction = stats.vonmises(400.0 / wrong**2, loc=0.3)
        speed = stats.gamma(1000.0 / wrong**2, scale=10.0 / 1000.0 * wrong**2)
        assert (stats.kstest(found.direction, direction.cdf).pvalue > FALSE_ALARM) == accepted
        assert (stats.kstest(found.speed, speed.cdf).pvalue > FALSE_ALARM) == accepted
    soon = moved(only_places(one_cell_map(**mode)), 0.5, n=40_000, direction=-0.2, speed=13.0)
    assert soon.speed.mean() > 12.0  # not settled yet
    assert soon.direction.mean() < 0.2


def laws(primitive_map, *, seconds=4.0, **cut):
    """Samples of east, north, direction and speed some seconds after a start off the mode."""
    found = moved(primitive_map, seconds, direction=0.25, speed=7.0, **cut)
    return *found.position.T, found.direction, found.speed


@pytest.mark.parametrize("table_of", [forecast_table, tracking_table])
def test_motion_is_the_same_however_time_is_cut(table_of):
    curved = one_cell_map(concentration=150.0, shape=30.0, side=200.0)
    bend = np.zeros((2, 1, 2))
    bend[0, 0] = 0.01, -0.005
    curved = replace(curved, bend=bend, motion=None)
    once = laws(curved, key=1, table_of=table_of)
    tenths = laws(curved, key=2, n_calls=40, table_of=table_of)
    finer = laws(curved, key=3, config=FilterConfig(step_s=0.05), table_of=table_of)
    uneven = laws(curved, key=4, n_calls=7, table_of=table_of)
    for other in (tenths, finer, uneven):
        for mine, theirs in zip(once, other, strict=True):
            assert stats.ks_2samp(mine, theirs).pvalue > FALSE_ALARM
    for mine, theirs in zip(once, laws(curved, key=5, seconds=5.0, table_of=table_of), strict=True):
        assert stats.ks_2samp(mine, theirs).pvalue < FALSE_ALARM


def test_where_no_place_tells_vehicles_go_on_at_constant_velocity_with_noise():
    """Speed is pushed by an Ornstein-Uhlenbeck process of 1 m/s^2 and rate 0.5/s, direction diffuses by 0.2 rad."""
    t, free = 2.0, one_cell_map().without_places()
    found = moved(free, t, config=FINE)
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


def anyhow():
    """A place whose one manoeuvre fits any direction and any speed, so that whoever is redrawn may take it up."""
    return squares(1, 1, motion_by_hand([0], course_spread=1.0), side=400.0)


def test_of_redrawn_particles_a_share_is_of_no_place_at_any_time():
    n, knobs = 20_000, FilterConfig(place_free_share=0.2, redraw_rate=0.4)
    for n_calls in (1, 15):
        start = {"n": n, "place": (100.0, 200.0), "speed": 30.0, "table_of": tracking_table, "config": knobs}
        found = moved(anyhow(), 3.0, n_calls=n_calls, **start)  # so fast that none stops
        assert stats.binomtest(int((found.manoeuvre > 0).sum()), n, 0.2).pvalue > FALSE_ALARM
        assert stats.binomtest(int((found.manoeuvre > 0).sum()), n, 0.22).pvalue < FALSE_ALARM
    never = moved(anyhow(), 3.0, n=n, place=(200.0, 200.0))
    assert (never.manoeuvre == 0).all()


@pytest.mark.parametrize("n_particles", [20_000, 10])
def test_redraws_come_at_their_rate_however_time_is_cut_and_however_many_particles_there_are(n_particles):
    """A particle set on the place-free manoeuvre by hand comes back to its place when it is redrawn."""
    n, rate, t = 20_000, 0.4, 2.0
    for n_calls, step_s in ((1, 0.1), (20, 0.1), (8, 0.25)):
        config = FilterConfig(place_free_share=1e-9, redraw_rate=rate, step_s=step_s, place_free_agility=1.0)
        stays = n_that_stay(n // n_particles, n_particles, t=t, n_calls=n_calls, config=config)
        assert stats.binomtest(stays, n, np.exp(-rate * t)).pvalue > FALSE_ALARM
        assert stats.binomtest(stays, n, np.exp(-1.1 * rate * t)).pvalue < FALSE_ALARM


def n_that_stay(n_vehicles, n_particles, *, t, n_calls, config):
    table, stays = tracking_table(anyhow(), config), 0
    for key in range(n_vehicles):
        state = seeded(key)
        particles = settled(table, n_particles, place=(200.0, 200.0), state=state)
        particles.manoeuvre[:] = 1
        for _ in range(n_calls):
            _motion.move(table, *particles, ALONE, t / n_calls, state)
        stays += int((particles.manoeuvre == 1).sum())
    return stays


def test_a_vehicle_that_stands_starts_at_its_rate():
    n, rate = 20_000, 0.5
    waits = motion_by_hand([0, 0], start_rate=[rate, 0.0], acceleration=[[0.0] * 4, [2.0, 0, 0, -0.2]])
    for t in (0.5, 1.0, 3.0):
        found = moved(squares(1, 1, waits, side=200.0), t, n=n, config=FINER, place=(100.0, 100.0), speed=0.0)
        started = found.speed >= 0.3
        assert stats.binomtest(int(started.sum()), n, 1 - np.exp(-rate * t)).pvalue > FALSE_ALARM
        assert stats.binomtest(int(started.sum()), n, 1 - np.exp(-1.1 * rate * t)).pvalue < FALSE_ALARM
        assert (found.manoeuvre == started).all()
        np.testing.assert_allclose(found.position[~started], 100.0, atol=6.0 * np.sqrt(0.005 * t))  # all drift alike
        # Speed since the start tells when that was: 10 - 9.69 exp(-0.2 age).
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


def test_cells_reach_beside_themselves_to_the_nearest():
    cells = GridTessellation.covering(np.array([[0.5, 0.5], [10.5, 0.5]]), cell_size=1.0)
    near = reaching(cells.locator, 3.5)
    found = {
        (x, y): locate(near, x, y)
        for x, y in ((0.5, 0.5), (10.5, 0.5), (3.5, 0.5), (7.5, 0.5), (0.5, -2.5), (5.5, 0.5), (0.5, 5.5))
    }
    assert found == {
        (0.5, 0.5): 0, (10.5, 0.5): 1, (3.5, 0.5): 0, (7.5, 0.5): 1, (0.5, -2.5): 0, (5.5, 0.5): -1, (0.5, 5.5): -1,
    }  # fmt: skip
    nothing = GridTessellation.empty().locator
    assert locate(reaching(nothing, 3.5), 0.5, 0.5) == -1
