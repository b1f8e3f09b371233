from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.evaluation.cues import steps_between_cells
from dirprim_filter.evaluation.forecast_cases import Cases
from dirprim_filter.evaluation.splits import split, thinned
from dirprim_filter.filtering.manoeuvre import acceleration_density
from dirprim_filter.primitives import learn_primitives
from dirprim_filter.tracks import Tracks
from situations import ring_traffic


@pytest.fixture(scope="module")
def tracks():
    ring = ring_traffic(np.random.default_rng(1), n_vehicles=14, n_rows=30)
    return Tracks(
        track_id=ring.track_id, time_ns=ring.time_ns, position=ring.position, direction=ring.direction,
        speed=ring.speed, group=np.asarray(ring.track_id) // 4,
    )  # fmt: skip


def rows_of(tracks):
    return set(zip(tracks.track_id.tolist(), tracks.time_ns.tolist(), strict=True))


@pytest.mark.parametrize(("by", "column"), [("vehicle", "track_id"), ("group", "group")])
def test_every_row_is_held_out_once_and_none_shares_its_vehicle_or_group_with_what_is_learned(tracks, by, column):
    folds = split(tracks, by=by, n_folds=3, rng=np.random.default_rng(2))
    assert len(folds) == 3
    assert sorted(row for fold in folds for row in rows_of(fold.test)) == sorted(rows_of(tracks))
    for train, test in folds:
        assert not np.intersect1d(getattr(train, column), getattr(test, column)).size
        assert rows_of(train) | rows_of(test) == rows_of(tracks)


def test_random_rows_are_disjoint_tenths_and_leak_vehicles(tracks):
    folds = split(tracks, by="random", n_folds=10, rng=np.random.default_rng(2))
    held_out = [row for fold in folds for row in rows_of(fold.test)]
    assert len(held_out) == len(set(held_out)) == len(tracks)
    assert {len(fold.test) for fold in folds} == {len(tracks) // 10}
    assert np.intersect1d(folds[0].train.track_id, folds[0].test.track_id).size  # what the other splits must not have


def test_thinned_rows_are_the_first_of_each_interval_of_each_vehicle(tracks):
    kept = thinned(tracks, interval_s=0.5)
    for vehicle in np.unique(tracks.track_id):
        time = tracks.time_ns[tracks.track_id == vehicle]
        expected, slots = [], set()
        for t in time:
            slot = (t - time[0]) // 500_000_000
            if slot not in slots:
                slots.add(slot)
                expected.append(t)
        np.testing.assert_array_equal(kept.time_ns[kept.track_id == vehicle], expected)


@pytest.mark.parametrize(
    ("by", "n_folds", "match"),
    [
        ("vehicle", 1, "at least 2"),
        ("random", 0, "1 to 10"),
        ("random", 11, "1 to 10"),
        ("lane", 2, "'vehicle', 'group' or 'random', got 'lane'"),
    ],
)
def test_what_cannot_be_dealt_is_refused(tracks, by, n_folds, match):
    with pytest.raises(ValueError, match=match):
        split(tracks, by=by, n_folds=n_folds, rng=np.random.default_rng(0))


def test_one_vehicle_cannot_be_held_out_from_itself(tracks):
    alone = tracks[tracks.track_id == 1]
    with pytest.raises(ValueError, match="at least two to split by vehicle, got 1"):
        split(alone, by="vehicle", n_folds=2, rng=np.random.default_rng(0))
    with pytest.raises(ValueError, match="enough rows"):
        split(alone[:4], by="random", n_folds=5, rng=np.random.default_rng(0))
    with pytest.raises(ValueError, match="positive time"):
        thinned(alone, interval_s=0.0)


def test_an_id_in_two_groups_is_two_vehicles_to_whoever_evaluates():
    ring = ring_traffic(np.random.default_rng(1), n_vehicles=6, n_rows=60)
    later = replace(  # interleaved in time, elsewhere, the other way
        ring, time_ns=ring.time_ns + 30_000_000, position=ring.position + 500.0, direction=ring.direction + np.pi
    )
    groups = [replace(ring, group=np.full(len(ring), 3)), replace(later, group=np.full(len(ring), 8))]
    both = Tracks.concatenate(groups)
    apart = replace(both, track_id=both.track_id + 100 * both.group)
    kept, expected = thinned(both, interval_s=0.5), thinned(apart, interval_s=0.5)
    np.testing.assert_array_equal(kept.position, expected.position)
    ours, theirs = Cases.of(both), Cases.of(apart)
    for field in set(Cases._fields) - {"name", "around"}:
        np.testing.assert_array_equal(getattr(ours, field), getattr(theirs, field))
    for mine, other in zip(ours.around, theirs.around, strict=True):
        np.testing.assert_array_equal(mine, other)
    np.testing.assert_array_equal(ours.around.state[ours.at, :2], ours.position)
    off = np.linalg.norm(ours.later - ours.position[:, None], axis=-1)
    assert np.nanmax(off) < 8.0 * 8.0 * 1.5  # nobody is interpolated over to the other group, 700 m away
    assert acceleration_density(both) == acceleration_density(apart)
    folds = split(both, by="vehicle", n_folds=12, rng=np.random.default_rng(0))
    assert [len(fold.test) for fold in folds] == [60] * 12
    learned = learn_primitives(both, tessellation="grid", cell_size=10.0, rng=np.random.default_rng(0))
    for mine, other in zip(steps_between_cells(learned, both), steps_between_cells(learned, apart), strict=True):
        np.testing.assert_array_equal(mine, other)
    merged = replace(both, group=np.zeros(len(both), np.int64))  # the control: taken for one vehicle
    assert acceleration_density(merged) > 10 * acceleration_density(both)
    assert len(Cases.of(merged).speed) < len(ours.speed)
