"""Rows to learn from: thinned, held out together, and learned by metres and seconds of their own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dirprim_filter import Tracks, learn_primitives
from dirprim_filter.course import motion_of
from dirprim_filter.primitives.learning import LEAST_ROWS, enough_rows
from dirprim_filter.primitives.rows import Scale, TrackRows
from situations import ring_traffic, tracks_of

AIS = Path(__file__).parents[3] / "shared" / "data" / "solent_ais" / "solent_ais.csv"


def scaled(tracks, times):
    """The same vehicles on a plane so many times as large, seen so many times as seldom."""
    return replace(tracks, time_ns=tracks.time_ns * times, position=tracks.position * times)


def scale_of(tracks):
    return TrackRows.thinned(tracks, interval_s=0.2).scale


def mean_density(learned, tracks):
    return learned.log_density(tracks.position, tracks.direction, tracks.speed).mean()


def measured(ids, vehicle, time_ns, position):
    """Tracks of vehicles of which only the places are known, where their speeds are."""
    of = motion_of(vehicle, time_ns, position)
    known = np.isfinite(of.speed)
    motion = {"direction": of.direction[known], "speed": of.speed[known]}
    return Tracks(track_id=ids[vehicle[known]], time_ns=time_ns[known], position=position[known], **motion)


def test_cars_have_the_least_scale_and_what_is_seen_seldom_has_more():
    often = ring_traffic(np.random.default_rng(0), n_vehicles=6, dt_s=0.5, n_rows=30)
    assert scale_of(often) == Scale(3.0, 0.5)
    seldom = scale_of(scaled(often, 8))
    assert seldom.interval_s == pytest.approx(4.0)
    assert seldom.reach_m > 10.0
    assert seldom.longest_gap_s == pytest.approx(12.0)


@pytest.mark.parametrize("tessellation", ["grid", "voronoi"])
def test_a_larger_world_seen_more_seldom_is_learned_alike(tessellation):
    small = scaled(ring_traffic(np.random.default_rng(1), n_vehicles=24, dt_s=0.5, n_rows=40), 8)
    seen, found = scaled(ring_traffic(np.random.default_rng(2), n_vehicles=6, dt_s=0.5, n_rows=40), 8), []
    for times in (1, 4):
        learned = learn_primitives(scaled(small, times), tessellation=tessellation, rng=np.random.default_rng(0))
        found.append((learned, mean_density(learned, scaled(seen, times))))
    (one, density), (other, of_large) = found
    assert of_large == pytest.approx(density, abs=0.1)
    assert density > mean_density(one.without_places(), seen) + 0.5
    assert other.tessellation.n_cells == pytest.approx(one.tessellation.n_cells, rel=0.3)
    assert other.motion.n_placed > 0


def test_many_places_are_laid_out_by_more_rows_than_one():
    """However far apart; one place by `LEAST_ROWS`."""
    ring = ring_traffic(np.random.default_rng(0), n_vehicles=24).position
    alone = enough_rows(ring, 3.0)
    assert alone == LEAST_ROWS
    places = 500.0 * np.arange(60)[:, None, None] * [1.0, 0.5] + ring
    of_all = enough_rows(places.reshape(-1, 2), 3.0)
    assert of_all == pytest.approx(2 * enough_rows(places[:30].reshape(-1, 2), 3.0), rel=0.05)
    assert of_all > 5 * LEAST_ROWS


@pytest.mark.skipif(not AIS.exists(), reason="no AIS in ../shared/data")
def test_ships_of_a_strait_are_learned():
    table = np.genfromtxt(AIS, delimiter=",", names=True)
    position = np.column_stack([table["x_m"], table["y_m"]])
    ids, vehicle = np.unique(table["track_id"], return_inverse=True)
    time_ns = np.round(table["time_s"] * 1e9).astype(np.int64)
    _, once = np.unique(np.column_stack([vehicle, time_ns]), axis=0, return_index=True)
    tracks = measured(ids, vehicle[once], time_ns[once], position[once])
    assert len(tracks) > 0.9 * once.size  # but for those at anchor, who report every three minutes
    learned = learn_primitives(tracks, tessellation="voronoi", n_cells=60, rng=np.random.default_rng(0))
    moving = tracks[tracks.speed > 1.0]
    assert mean_density(learned, moving) > mean_density(learned.without_places(), moving) + 1.0


@pytest.mark.parametrize("jitter_m", [0.0, 1e-6, 1e-2, 10.0])
def test_what_parked_vehicles_cost_does_not_depend_on_how_far_they_jitter(jitter_m):
    rng, n = np.random.default_rng(0), 50
    homes = rng.uniform(-50, 50, (20, 1, 2)) + jitter_m * rng.normal(size=(20, n, 2))
    way = np.stack([2.0 * np.arange(n) - 50.0, np.zeros(n)], axis=1) + rng.uniform(-3, 3, (20, 1, 2)) * [0, 1]
    position, vehicle = np.concatenate([homes, way]).reshape(-1, 2), np.repeat(np.arange(40), n)
    tracks = measured(np.arange(40), vehicle, np.tile(np.arange(n) * 100_000_000, 40), position)
    learned = learn_primitives(tracks, rng=np.random.default_rng(0))
    assert sum(np.asarray(column).nbytes for column in learned.tessellation.locator) < 1e6
    assert learned.tessellation.n_cells < 200


def alone(time_s):
    return tracks_of(np.zeros((1, len(time_s), 2)), time_ns=np.round(np.asarray(time_s) * 1e9).astype(np.int64))


def test_a_clock_that_jitters_by_a_millisecond_thins_to_the_same_rows():
    steady = 0.1 * np.arange(400)
    jitter = np.random.default_rng(0).uniform(-0.001, 0.001, 400)
    kept, of_jittered = (TrackRows.thinned(alone(time), interval_s=0.2) for time in (steady, steady + jitter))
    assert len(kept) == len(of_jittered) == 200
    np.testing.assert_allclose(of_jittered.time_ns * 1e-9, 0.2 * np.arange(200), atol=0.0011)
    between = TrackRows.thinned(alone(0.15 * np.arange(400)), interval_s=0.2)  # 0.15 s are too little
    np.testing.assert_allclose(np.diff(between.time_ns) * 1e-9, 0.3)


@pytest.mark.parametrize(("n_vehicles", "n_rows", "most"), [(1, 20_000, 1000), (2, 9000, 100), (300, 100, 3000)])
def test_some_rows_are_about_as_many_as_asked_for_and_never_none(n_vehicles, n_rows, most):
    ring = ring_traffic(np.random.default_rng(0), n_vehicles=n_vehicles, n_rows=n_rows)
    rows = TrackRows.thinned(ring, interval_s=0.05)
    for seed in range(5):
        some = rows.some(most, rng=np.random.default_rng(seed))
        assert 0.9 * most <= len(some) <= 2 * most
        assert (np.diff(some.vehicle) >= 0).all()
    if n_vehicles == 300:  # whole vehicles, others each time
        assert set(np.unique(some.vehicle, return_counts=True)[1].tolist()) == {100}
        other = rows.some(most, rng=np.random.default_rng(9))
        assert set(some.vehicle.tolist()) != set(other.vehicle.tolist())
    assert rows.some(len(rows), rng=np.random.default_rng(0)) is rows


def test_groups_are_held_out_whole_where_there_are_three_and_none_rules():
    ring = ring_traffic(np.random.default_rng(0), n_vehicles=24, n_rows=20)
    rows = TrackRows.thinned(replace(ring, group=10 * (ring.track_id % 3)), interval_s=0.2)
    np.testing.assert_array_equal(rows.group, 10 * (rows.vehicle // 8))  # vehicles are in order of group and id
    one_rules = np.where(ring.track_id < 18, 0, 1 + ring.track_id % 3)
    for too_few in (0 * ring.track_id, ring.track_id % 2, one_rules):
        by_vehicle = TrackRows.thinned(replace(ring, group=10 * too_few), interval_s=0.2)
        np.testing.assert_array_equal(by_vehicle.group, by_vehicle.vehicle)
