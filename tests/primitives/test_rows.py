"""Rows to learn from: thinned, some of many, and what is held out together."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.primitives.rows import TrackRows
from situations import ring_traffic, tracks_of


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
    rows = TrackRows.thinned(
        ring_traffic(np.random.default_rng(0), n_vehicles=n_vehicles, n_rows=n_rows), interval_s=0.05
    )
    for seed in range(5):
        some = rows.some(most, rng=np.random.default_rng(seed))
        assert 0.9 * most <= len(some) <= 2 * most
        assert (np.diff(some.vehicle) >= 0).all()
    if n_vehicles == 300:  # whole vehicles, others each time
        assert set(np.unique(some.vehicle, return_counts=True)[1].tolist()) == {100}
        other = rows.some(most, rng=np.random.default_rng(9))
        assert set(some.vehicle.tolist()) != set(other.vehicle.tolist())
    assert rows.some(len(rows), rng=np.random.default_rng(0)) is rows


def grouped(n_groups, *, share_of_first=None):
    ring = ring_traffic(np.random.default_rng(0), n_vehicles=24, n_rows=20)
    group = ring.track_id % n_groups
    if share_of_first is not None:
        group = np.where(ring.track_id < 24 * share_of_first, 0, 1 + ring.track_id % (n_groups - 1))
    return replace(ring, group=10 * group)


def test_groups_are_held_out_whole_where_there_are_three_and_none_rules():
    rows = TrackRows.thinned(grouped(3), interval_s=0.2)
    np.testing.assert_array_equal(rows.group, 10 * (rows.vehicle // 8))  # vehicles are in order of group and id
    for too_few in (grouped(1), grouped(2), grouped(4, share_of_first=0.75)):
        by_vehicle = TrackRows.thinned(too_few, interval_s=0.2)
        np.testing.assert_array_equal(by_vehicle.group, by_vehicle.vehicle)
