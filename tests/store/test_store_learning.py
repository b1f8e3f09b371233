"""Maps of summaries: the same for the same statistics, silent of few vehicles, and faded by age."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter import save_map
from dirprim_filter.store import learning
from dirprim_filter.store.fading import Fading
from dirprim_filter.store.learning import learn_from_summary, visible_tracks
from dirprim_filter.store.pseudo_tracks import APART_NS
from dirprim_filter.store.steps import HOUR_NS
from dirprim_filter.store.summary import Summary
from dirprim_filter.tracks import Tracks
from situations import ring_traffic

DAY = 24


def lane(n_vehicles, *, north=0.0, hour=0, first_id=0):
    """Vehicles that drive 40 m to the east at about 8 m/s, one after the other."""
    t = np.arange(0.0, 5.01, 0.5)
    speed = 8.0 + 0.1 * np.arange(n_vehicles)
    east = speed[:, None] * t - 20.0
    return Tracks(
        track_id=first_id + np.repeat(np.arange(n_vehicles), t.size),
        time_ns=np.tile((t * 1e9).astype(np.int64), n_vehicles) + hour * HOUR_NS,
        position=np.column_stack([east.ravel(), np.full(east.size, north)]),
        direction=np.zeros(east.size),
        speed=np.repeat(speed, t.size),
    )


def test_the_bytes_of_a_map_depend_on_the_statistics_alone(tmp_path):
    a, b = (Summary.of(ring_traffic(np.random.default_rng(seed), n_vehicles=6, n_rows=30)) for seed in (1, 2))
    for name, summary in (("one", a + b), ("other", b + a + a - a), ("control", a + a)):
        learned = learn_from_summary(
            summary, min_vehicles=2, tessellation="grid", cell_size=8.0, rng=np.random.default_rng(0)
        )
        save_map(learned, tmp_path / name)
    bytes_of = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert bytes_of["one"] == bytes_of["other"] != bytes_of["control"]


def test_of_few_vehicles_a_map_says_nothing():
    summary = Summary.of(lane(6)) + Summary.of(lane(4, north=50.0, first_id=9))
    assert visible_tracks(summary, min_vehicles=4).tracks.position[:, 1].max() > 45.0
    assert visible_tracks(summary, min_vehicles=5).tracks.position[:, 1].max() < 5.0
    with pytest.raises(ValueError, match="expected places that 7 vehicles passed the same way, got none"):
        learn_from_summary(summary, min_vehicles=7, rng=np.random.default_rng(0))
    learned = learn_from_summary(
        summary, min_vehicles=5, tessellation="grid", cell_size=8.0, rng=np.random.default_rng(0)
    )
    own = learned.direction.weight[:-1, : learned.n_own_modes + learned.n_borrowed_modes]
    assert (own[learned.tessellation.centers[:, 1] < 10.0] > 0).any()
    assert learned.motion.visits[learned.motion.cell >= 0].min() >= 5.0
    from_placed = np.repeat(learned.motion.cell, np.diff(learned.motion.first)) >= 0
    assert from_placed.any()
    assert learned.motion.count[from_placed].min() >= 5.0


def test_a_vehicle_that_passes_twice_is_one():
    """Four vehicles that pass two times each are no eight."""
    once, again = lane(4), lane(4, hour=1)
    tracks = Tracks.concatenate([once, again])
    assert visible_tracks(Summary.of(tracks), min_vehicles=4).tracks.n_tracks == 8
    assert not len(visible_tracks(Summary.of(tracks), min_vehicles=5).tracks)
    in_two = visible_tracks(Summary.of(once) + Summary.of(again), min_vehicles=5)
    assert in_two.tracks.n_tracks == 8


def test_nothing_stands_between_rows_that_something_was_left_out_between():
    """Six vehicles drive the lane; the one that leaves it for half a second is nowhere in between."""
    swerves = lane(1, first_id=50)
    away = np.arange(len(swerves)) == 5
    swerves = replace(swerves, position=swerves.position + 20.0 * away[:, None] * [0.0, 1.0])
    tracks = visible_tracks(Summary.of(Tracks.concatenate([lane(6), swerves])), min_vehicles=5).tracks
    assert tracks.n_tracks == 7
    assert np.abs(tracks.position[:, 1]).max() < 1.0
    own = tracks.time_ns[tracks.vehicle == np.argmin(np.bincount(tracks.vehicle))]
    assert np.diff(own).max() == APART_NS  # too long for learning to fill it in


def test_age_fades_whole_vehicles_by_its_half_life():
    n = 400
    recordings = [Summary.of(lane(n, north=100.0 * k, hour=(10 - 10 * k) * DAY)) for k in range(2)]
    summary = Summary.total(recordings)
    fading = Fading(half_life_s=10 * DAY * 3600.0, now_ns=10 * DAY * HOUR_NS)
    tracks = visible_tracks(summary, min_vehicles=1, fading=fading).tracks
    old = np.unique(tracks.track_id[tracks.position[:, 1] > 50.0]).size
    new = np.unique(tracks.track_id[tracks.position[:, 1] < 50.0]).size
    assert new == n
    assert abs(old - n / 2) <= 3
    assert set(np.bincount(tracks.vehicle)) == {11}  # whole ones
    before = Fading(half_life_s=3600.0, now_ns=0)
    tracks, _ = visible_tracks(summary, min_vehicles=1, fading=before)
    assert (tracks.position[:, 1] > 50.0).all()  # the rest is to come


def test_many_steps_are_taken_block_by_block_and_thinned_by_whole_vehicles(monkeypatch):
    summary = Summary.total([Summary.of(lane(30, hour=hour)) for hour in range(6)])
    whole = visible_tracks(summary, min_vehicles=1).tracks
    monkeypatch.setattr(learning, "BLOCK_STEPS", 150)
    in_blocks = visible_tracks(summary, min_vehicles=1).tracks
    assert in_blocks.n_tracks == whole.n_tracks == 180
    assert sorted(in_blocks.position.tolist()) == sorted(whole.position.tolist())
    monkeypatch.setattr(learning, "MOST_STEPS", 60 * 11)
    some = visible_tracks(summary, min_vehicles=1).tracks
    assert abs(some.n_tracks - 60) <= 3
    assert set(np.bincount(some.vehicle)) == set(np.bincount(whole.vehicle))


def test_what_cannot_be_learned_from_is_refused():
    with pytest.raises(ValueError, match="expected at least one vehicle, got none"):
        visible_tracks(Summary.none())
    with pytest.raises(ValueError, match="half_life_s: expected a positive number"):
        Fading(half_life_s=0.0, now_ns=0)
    with pytest.raises(ValueError, match="min_vehicles: expected at least 1"):
        learn_from_summary(Summary.none(), min_vehicles=0, rng=np.random.default_rng(0))
