from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.evaluation.cues import steps_between_cells
from dirprim_filter.evaluation.forecast_cases import Cases
from dirprim_filter.evaluation.splits import split, thinned
from dirprim_filter.filtering.kalman import acceleration_density
from dirprim_filter.primitives.learning import learn_primitives
from dirprim_filter.tracks import Tracks
from situations import ring_traffic


@pytest.fixture(scope="module")
def tracks():
    ring = ring_traffic(np.random.default_rng(1), n_vehicles=14, n_rows=30)
    return replace(ring, group=ring.track_id // 4)


@pytest.mark.parametrize(
    ("deal", "match"),
    [
        (lambda rows, rng: split(rows, by="vehicle", n_folds=1, rng=rng), "at least 2"),
        (lambda rows, rng: split(rows, by="random", n_folds=11, rng=rng), "1 to 10"),
        (lambda rows, rng: split(rows, by="lane", n_folds=2, rng=rng), "'vehicle', 'group' or 'random', got 'lane'"),
        (lambda rows, rng: split(rows[rows.track_id == 1], by="vehicle", n_folds=2, rng=rng), "at least two .*, got 1"),
        (lambda rows, rng: split(rows[np.arange(4)], by="random", n_folds=5, rng=rng), "enough rows"),
        (lambda rows, rng: thinned(rows, interval_s=0.0), "positive time"),
    ],
)
def test_what_cannot_be_dealt_is_refused(tracks, deal, match):
    with pytest.raises(ValueError, match=match):
        deal(tracks, np.random.default_rng(0))


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
    for field in set(Cases._fields) - {"name", "log"}:
        np.testing.assert_array_equal(getattr(ours, field), getattr(theirs, field))
    np.testing.assert_array_equal(ours.log.position[ours.row], ours.position)
    off = np.linalg.norm(ours.later - ours.position[:, None], axis=-1)
    assert np.nanmax(off) < 8.0 * 8.0 * 1.5  # no vehicle is interpolated over to the other group, 700 m away
    assert acceleration_density(both) == acceleration_density(apart)
    folds = split(both, by="vehicle", n_folds=12, rng=np.random.default_rng(0))
    assert [len(fold.test) for fold in folds] == [60] * 12
    learned = learn_primitives(both, tessellation="grid", cell_size=10.0, rng=np.random.default_rng(0))
    for mine, other in zip(steps_between_cells(learned, both), steps_between_cells(learned, apart), strict=True):
        np.testing.assert_array_equal(mine, other)
    merged = replace(both, group=np.zeros(len(both), np.int64))  # the control: taken for one vehicle
    assert acceleration_density(merged) > 10 * acceleration_density(both)
    assert len(Cases.of(merged).speed) < len(ours.speed)
