"""Visits: a vehicle's runs through one cell each, whatever the rate of its log."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.distributions.angles import difference
from dirprim_filter.primitives._clustering import dp_means
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.primitives.visits import AHEAD_M, FASTER_S, GAINED_MPS, GAINED_S, STEP_S, Visits
from dirprim_filter.tracks import Tracks
from oracles import between_rows
from oracles import dp_means as slow_dp_means
from situations import ring_traffic, tracks_of
from tessellation import GridTessellation


def squares_of(tracks, *, side):
    return GridTessellation.covering(np.concatenate([tracks.position, tracks.position + side]), cell_size=side)


def eastward(speed, *, dt_s=0.1, x=0.0, track_id=0, group=0, start_s=0.0):
    """A vehicle that drives east at the speeds given, one for each row."""
    speed = np.asarray(speed, float)
    way = np.concatenate([[0.0], np.cumsum(dt_s * (speed[1:] + speed[:-1]) / 2)])
    time_ns = np.round((start_s + dt_s * np.arange(speed.size)) * 1e9).astype(np.int64)
    place = np.column_stack([x + way, np.full(speed.size, 5.0)])
    return tracks_of([place], track_id=track_id, time_ns=time_ns, speed=speed, group=group)


STREET = GridTessellation(origin=np.zeros(2), cell_size=10.0, n_x=20, n_y=1, square=np.arange(20))


def visits_of(*parts, cells=STREET):
    """Of all rows of tracks."""
    return Visits.of(TrackRows.thinned(Tracks.concatenate(list(parts)), interval_s=1e-3), cells)


def test_rows_at_2_hz_pass_the_cells_that_rows_at_10_hz_pass():
    often = ring_traffic(np.random.default_rng(4), n_rows=96)
    seldom = often[often.time_ns % 500_000_000 == 0]
    cells = squares_of(often, side=3.0)
    of_often, of_seldom = (visits_of(tracks, cells=cells) for tracks in (often, seldom))
    np.testing.assert_array_equal(of_often.cell, of_seldom.cell)
    np.testing.assert_array_equal(of_often.vehicle, of_seldom.vehicle)
    np.testing.assert_allclose(of_often.position, of_seldom.position, atol=1e-3)
    assert np.abs(of_often.seconds - of_seldom.seconds).max() < 1.5 * STEP_S
    passed = cells.cell_of(seldom.position[seldom.track_id == 0])
    assert (np.diff(passed) != 0).sum() + 1 < (of_seldom.vehicle[of_seldom.begin] == 0).sum()  # rows alone miss some


def test_between_rows_instants_are_on_splines_and_rows_alone_say_nothing():
    """Vehicles in segments, of which one is a single row, with rows at odd times; instants go no further than rows."""
    rng = np.random.default_rng(6)
    tracks = ring_traffic(rng, n_vehicles=4, radius=6.0, n_rows=60, dt_s=0.13)
    far = (tracks.time_ns > 3e9).astype(np.int64) + (tracks.time_ns > tracks.time_ns.max() - 1e8)
    tracks = replace(tracks, time_ns=tracks.time_ns + rng.integers(0, 50_000_000, len(tracks)) + far * 4_000_000_000)
    rows, visits = TrackRows.thinned(tracks, interval_s=1e-3), visits_of(tracks, cells=squares_of(tracks, side=5.0))
    breaks = np.flatnonzero((np.diff(rows.vehicle) != 0) | (np.diff(rows.time_ns) > 1_500_000_000)) + 1
    parts = np.split(np.arange(len(rows)), breaks)
    assert {part.size == 1 for part in parts} == {True, False}
    parts = [part for part in parts if part.size > 1]
    assert visits.segment.max() + 1 == len(parts)
    for number, part in enumerate(parts):
        time_s, own = (rows.time_ns[part] - rows.time_ns[part[0]]) * 1e-9, visits.segment == number
        at_s = STEP_S * np.arange(np.floor(time_s[-1] / STEP_S) + 1)
        assert own.sum() == at_s.size
        place, course, speed = between_rows(time_s, rows.position[part], rows.direction[part], rows.speed[part], at_s)
        np.testing.assert_allclose(visits.position[own], place, atol=1e-9)
        np.testing.assert_allclose(difference(visits.course[own], course), 0.0, atol=1e-9)
        np.testing.assert_allclose(visits.speed[own], speed, atol=1e-9)
        assert (visits.vehicle[own] == rows.vehicle[part[0]]).all()


def braking(stand_s):
    """Through a street's third cell at 8 m/s, to a stop in its middle, and on."""
    down, up = np.linspace(8.0, 0.0, 12), np.linspace(0.0, 8.0, 12)
    return np.concatenate([np.full(25, 8.0), down, np.zeros(round(stand_s / 0.1)), up, np.full(20, 8.0)])


def test_who_stops_makes_three_visits_and_who_hardly_stops_one():
    visits = visits_of(eastward(braking(3.0)))
    here = visits.cell == visits.cell[visits.stands]
    assert visits.stands[here].tolist() == [False, True, False]
    assert visits.seconds[visits.stands][0] == pytest.approx(3.2)  # with the zeros at which it stops and starts
    assert (np.diff(visits.cell) >= 0).all()
    assert visits.cell[0] == 0
    assert visits.follows().tolist() == [True] * (len(visits) - 1) + [False]
    assert len(visits_of(eastward([5.0]), eastward([5.0], start_s=90.0))) == 0  # of single rows
    visits = visits_of(eastward(braking(0.2)))
    assert not visits.stands.any()
    assert (np.diff(visits.cell) == 1).all()


@pytest.mark.parametrize(
    ("second", "joined"),
    [({}, True), ({"track_id": 1}, False), ({"group": 1}, False), ({"start_s": 3.6}, False), ({"start_s": 3.2}, True)],
    ids=["the same vehicle", "another vehicle", "another group", "a long gap", "a short gap"],
)
def test_nothing_joins_two_vehicles_groups_or_what_a_long_gap_divides(second, joined):
    speed = np.full(20, 5.0)
    later = {"start_s": 2.0, "x": 10.0} | second
    later["x"] = 5.0 * later["start_s"]
    visits = visits_of(eastward(speed), eastward(speed, **later))
    assert (np.unique(visits.segment).size == 1) == joined
    assert (visits.follows().sum() == len(visits) - 1) == joined
    across = visits.later(1.5)[10]
    assert (across >= 0) == joined
    ahead = visits.features(np.vstack([STREET.centers, np.zeros(2)]))
    known = np.isfinite(ahead[0])
    assert known[7:9].all()  # 8 m on, before the divide at 9.5 m
    assert known[9:11].all() == known[14] == joined  # 16 m, and 3 s


def test_features_say_where_and_how_fast_a_vehicle_is_later():
    speed = 6.0 + 0.05 * np.arange(100)
    visits = visits_of(eastward(speed))
    feature = visits.features(np.vstack([STREET.centers, np.zeros(2)]))
    x = visits.position[visits.begin, 0]
    for i, (metres, alike) in enumerate(AHEAD_M):
        known = np.isfinite(feature[:, 7 + 2 * i])
        assert known.any()
        np.testing.assert_allclose(feature[known, 7 + 2 * i] * alike, (x + metres)[known], atol=1.2)  # an instant's way
        np.testing.assert_allclose(feature[known, 8 + 2 * i] * alike, 5.0)
        np.testing.assert_array_equal(known, x + metres < visits.position[-1, 0] + 1e-6)
    for i, (seconds, alike) in enumerate(FASTER_S):
        later = visits.speed[visits.begin] + 0.5 * seconds
        known = np.isfinite(feature[:, 13 + i])
        np.testing.assert_allclose((feature[:, 13 + i] * alike)[known], later[known], atol=1e-6)
    np.testing.assert_allclose(feature[np.isfinite(feature[:, 15]), 15] * GAINED_MPS, 0.5 * GAINED_S, atol=1e-6)


@pytest.mark.parametrize("opens_at", [0.05, 0.5, 2.0, 50.0])
@pytest.mark.parametrize("most", [3, 40])
def test_groups_are_those_of_the_slow_twin(opens_at, most):
    rng = np.random.default_rng(6)
    for _ in range(2):
        feature = rng.normal(0, 1, (40, 4)) + rng.integers(0, 4, (40, 1))
        feature[rng.random(feature.shape) < 0.25] = np.nan
        order, label = rng.permutation(40), np.empty(40, np.int64)
        dp_means(feature, order, opens_at, most, label)
        np.testing.assert_array_equal(label, slow_dp_means(feature, order, opens_at, most))
        assert label.max() < most
