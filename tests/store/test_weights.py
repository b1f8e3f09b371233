"""Weights and mean speeds by hour and by age: better where demand turns, else the same, and silent of few vehicles."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.primitives import PrimitiveMap
from dirprim_filter.primitives.motion_learning import modes_of
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.primitives.schedule import HOUR_NS
from dirprim_filter.primitives.visits import Visits
from dirprim_filter.store.by_hour import learn_schedule
from dirprim_filter.store.fading import Fading, refreshed
from dirprim_filter.tracks import Tracks
from tessellation import GridTessellation

RUSH = (7, 8, 17)
STREET = PrimitiveMap(
    tessellation=GridTessellation(
        origin=np.full(2, -20.0), cell_size=40.0, n_x=1, n_y=1, square=np.zeros(1, np.int64)
    ),
    direction=VonMisesMixture(
        weight=np.array([[0.45, 0.45, 0.05, 0.05], [0.0, 0.0, 0.0, 1.0]]),
        mean_direction=np.tile([0.0, np.pi, 0.0, 0.0], (2, 1)), concentration=np.tile([50.0, 50.0, 0.01, 0.01], (2, 1)),
    ),
    speed=Gamma(shape=np.full((2, 4), 9.0), rate=np.tile([0.9, 0.9, 90.0, 0.9], (2, 1))),
    n_rows=np.array([1, 1]), n_place_free_modes=1,
)  # fmt: skip
"""One cell: east and west at 10 m/s, standing, and place-free."""


def traffic(seed, n_days, rate, *, turns):
    """Hour, way and speed of vehicles: in rush hours, where demand turns, mostly westward and slowly."""
    rng = np.random.default_rng(seed)
    hour = np.repeat(np.arange(24 * n_days), rng.poisson(rate, 24 * n_days))
    rush = np.isin(hour % 24, RUSH) & turns
    west = rng.random(hour.size) < np.where(rush, 0.9, 0.4)
    speed = rng.gamma(9.0, 1 / 0.9, hour.size) * np.where(rush, 0.5, 1.0)
    return hour, west, np.maximum(speed, 1.0)


def seen(hour, west, speed):
    """Visits of the cell, and mode and hour of each."""
    n, t = hour.size, np.arange(5) * 0.2
    along = np.where(west, -1.0, 1.0)[:, None] * speed[:, None] * (t - t.mean())
    tracks = Tracks(
        track_id=np.repeat(np.arange(n), t.size),
        time_ns=np.repeat(np.arange(n), t.size) * 10**10 + np.tile(np.arange(t.size), n) * 2 * 10**8,
        position=np.column_stack([np.clip(along.ravel(), -19.0, 19.0), np.zeros(along.size)]),
        direction=np.repeat(np.where(west, np.pi, 0.0), t.size), speed=np.repeat(speed, t.size),
    )  # fmt: skip
    visits = Visits.of(TrackRows.thinned(tracks, interval_s=0.0), STREET.tessellation)
    return visits, modes_of(STREET, visits), hour


def days(seed, n_days, rate, *, turns):
    return seen(*traffic(seed, n_days, rate, turns=turns))


def gained(learned_from, judged_by, **options):
    """Nat by which a map by hour is better than that of all day on visits of other days: in rush hours, and in all."""
    schedule = learn_schedule(STREET, *learned_from, **{"by": "hour", "zone": "UTC", "min_vehicles": 1} | options)
    turned, (visits, _, hour) = replace(STREET, schedule=schedule), judged_by
    now = hour[visits.vehicle] % 24
    more = np.empty(now.size)
    for slot in range(24):
        of = now == slot
        rows = visits.position[of], visits.course[of], visits.speed[of]
        more[of] = turned.at_time(slot * HOUR_NS).log_density(*rows) - STREET.log_density(*rows)
    return more[np.isin(now, RUSH)].mean(), more.mean()


@pytest.mark.parametrize(("rate", "least"), [(1.5, 1), (4.0, 5)])
def test_where_demand_turns_a_map_by_hour_is_better(rate, least):
    rush, all_day = gained(days(0, 10, rate, turns=True), days(50, 4, 1.0, turns=True), min_vehicles=least)
    assert rush > 0.5
    assert all_day > 0.05


def test_where_nothing_turns_it_never_loses_a_hundredth_of_a_nat():
    for seed in range(5):
        _, all_day = gained(days(seed, 6, 1.0, turns=False), days(seed + 50, 4, 1.0, turns=False))
        assert all_day > -0.01


def test_the_week_has_slots_of_its_own():
    """What is so on Thursdays, the epoch's day of the week, says nothing of Fridays."""
    visits, mode, hour = days(0, 21, 2.0, turns=True)
    weekly = learn_schedule(STREET, visits, mode, hour, by="week", zone="UTC", min_vehicles=1)
    daily = learn_schedule(STREET, visits, mode, hour, by="hour", zone="UTC", min_vehicles=1)
    thursday, friday = weekly.flow[72 + 7, 0, 1], weekly.flow[96 + 7, 0, 1]
    assert thursday != friday
    assert min(thursday, friday) > 1.0
    assert daily.flow[7, 0, 1] > 1.3


def test_clocks_of_a_zone_move_the_slots():
    visits, mode, hour = days(0, 6, 3.0, turns=True)
    utc, kolkata = (
        learn_schedule(STREET, visits, mode, hour, by="hour", zone=zone, min_vehicles=1)
        for zone in ("UTC", "Asia/Dhaka")
    )
    np.testing.assert_array_equal(np.roll(utc.pace, 6, axis=0), kolkata.pace)


def test_how_few_vehicles_drove_in_an_hour_is_not_said():
    """Of 0 to 4 slow vehicles a map says the same, of 5 it says more."""
    hour, west, speed = traffic(0, 6, 4.0, turns=True)
    known = hour % 24 != 3
    found = []
    for k in (0, 2, 4, 5):
        of = (np.append(hour[known], [51] * k), np.append(west[known], [True] * k), np.append(speed[known], [2.0] * k))
        schedule = learn_schedule(STREET, *seen(*of), by="hour", zone="UTC", min_vehicles=5)
        found.append((schedule.flow[3, 0, 1], schedule.pace[3, 0, 1]))
    np.testing.assert_allclose(found[:3], 1.0, atol=0.01)
    assert found[3][1] < 0.9


def test_of_one_day_nothing_can_be_held_out():
    with pytest.raises(ValueError, match="expected recordings of at least two days"):
        gained(days(0, 1, 5.0, turns=True), days(1, 1, 5.0, turns=True))


def test_weights_and_mean_speeds_are_of_what_vehicles_count():
    """Of 200 vehicles the later half drives west and slowly; the earlier ones are of another regime."""
    days = 24 * np.arange(200) // 4
    late = np.arange(200) >= 100
    now = Fading(half_life_s=10 * 24 * 3600.0, now_ns=int(days[-1]) * HOUR_NS)
    east, west = refreshed(STREET, *seen(days, late, np.where(late, 5.0, 10.0)), now).direction.weight[0, :2]
    assert east / west == pytest.approx(1.0 / 101.0, rel=0.1)  # one vehicle's worth of leaning is left of them
    assert east + west == pytest.approx(STREET.direction.weight[0, :2].sum())
    of_one_hour = seen(np.zeros(200, int), late, np.where(late, 5.0, 10.0))
    same = refreshed(STREET, *of_one_hour, replace(now, now_ns=0))
    np.testing.assert_allclose(same.speed.mean, STREET.speed.mean)
    np.testing.assert_allclose(same.direction.weight, STREET.direction.weight)


def test_mean_speeds_are_of_what_age_leaves():
    """All ways alike; the later half of the vehicles is half as fast, the earlier one 100 half-lives ago."""
    late = np.arange(200) >= 100
    now = Fading(half_life_s=24 * 3600.0, now_ns=100 * 24 * HOUR_NS)
    visits = seen(np.where(late, 100 * 24, 0), np.arange(200) % 2 == 0, np.where(late, 5.0, 10.0))
    pace = refreshed(STREET, *visits, now).speed.mean[0] / STREET.speed.mean[0]
    np.testing.assert_allclose(pace[:2], 5.0 / 7.5, rtol=0.02)
    np.testing.assert_array_equal(pace[2:], 1.0)
