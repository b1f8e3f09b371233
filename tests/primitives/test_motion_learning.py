"""What is learned of how vehicles go on: it forecasts others, is the same for a seed, and grows slower than the log."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter import learn_primitives
from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives.background import learn_background
from dirprim_filter.primitives.motion_learning import label_visits, learn_motion
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.primitives.visits import Visits
from moving import rollouts
from situations import junction_traffic, tracks_of


@pytest.fixture(scope="module")
def junction():
    tracks = junction_traffic(np.random.default_rng(2), n_vehicles=120)
    learned = learn_primitives(tracks, tessellation="grid", cell_size=10.0, rng=np.random.default_rng(2))
    return learned, TrackRows.thinned(tracks, interval_s=0.2)


def background_of(rows):
    return learn_background(rows, LearningConfig(), rng=np.random.default_rng(0))


def test_twice_the_vehicles_are_less_than_half_as_many_manoeuvres_more(junction):
    learned, rows = junction

    def n_manoeuvres(part, detail):
        visits = Visits.of(rows[part], learned.tessellation)
        return label_visits(learned, visits, detail=detail, rng=np.random.default_rng(0)).cell.size

    half, all_ = rows.vehicle < 60, rows.vehicle < 120
    for detail in (0.3, 1.0, 3.0):
        assert n_manoeuvres(all_, detail) < 1.5 * n_manoeuvres(half, detail)
    few, some = rows.vehicle < 9, rows.vehicle < 18
    assert n_manoeuvres(some, 1e-6) > 1.5 * n_manoeuvres(few, 1e-6)  # where every visit is a manoeuvre of its own


def test_where_no_vehicle_was_in_a_cell_motion_is_of_no_place(junction):
    learned, rows = junction
    elsewhere = replace(rows, position=rows.position + 1e4)
    motion = learn_motion(learned, elsewhere, background_of(rows), rng=np.random.default_rng(0))
    assert motion.n_placed == 0
    assert len(motion) > 1
    assert (motion.push > 0).any()


def test_labels_are_of_one_cell_and_mode_each(junction):
    learned, rows = junction
    visits = Visits.of(rows, learned.tessellation)
    labels = label_visits(learned, visits, detail=1.0, rng=np.random.default_rng(0))
    inside = visits.cell >= 0
    np.testing.assert_array_equal(labels.label >= 0, inside)
    np.testing.assert_array_equal(labels.cell[labels.label[inside]], visits.cell[inside])
    standing = learned.n_own_modes - 1
    np.testing.assert_array_equal(labels.mode[labels.label[inside]] == standing, visits.stands[inside])
    assert (np.diff(labels.cell) >= 0).all()
    np.testing.assert_array_equal(np.unique(labels.label[inside]), np.arange(labels.cell.size))


def test_the_manoeuvres_of_a_junction_tell_who_turns(junction):
    """Before the junction no vehicle has turned; by their manoeuvre's count vehicles go on left, right and straight."""
    learned, rows = junction
    motion = learn_motion(learned, rows, background_of(rows), rng=np.random.default_rng(0))
    entry = learned.tessellation.cell_of(np.array([[35.0, 0.5], [35.0, -0.5]]))
    here = np.isin(motion.cell, entry)
    for turn in (-np.pi / 2, 0.0, np.pi / 2):
        share = motion.visits[here & (np.abs(motion.turn_ahead - turn) < 0.5)].sum() / motion.visits[here].sum()
        assert share == pytest.approx(1 / 3, abs=0.05)
    np.testing.assert_allclose(motion.course[here], 0.0, atol=0.15)


def test_who_creeps_goes_on_and_who_stands_stays():
    """A queue that rolls at 0.2 m/s, as real ones do for seconds, is not taken for one that stands."""
    east, pace = np.tile(np.linspace(0.0, 20.0, 11), 2), np.repeat([0.2, 0.0], 11)
    way = east[:, None] + 0.1 * pace[:, None] * np.arange(40)
    queue = tracks_of(np.stack(np.broadcast_arrays(way, pace[:, None]), axis=-1), speed=pace[:, None])
    learned = learn_primitives(queue, tessellation="grid", cell_size=10.0, rng=np.random.default_rng(0))
    paths = rollouts(learned, [[10.0, 0.2], [10.0, 0.0]], [0.0, 0.0], [0.2, 0.0], time_s=[3.0], n_samples=200, seed=1)
    creeps, stands = paths[:, :, 0, 0].mean(axis=1) - 10.0
    assert 0.4 < creeps < 0.8  # 0.6 m by the speed it has
    assert abs(stands) < 0.1


def braking_traffic(rng, *, n_vehicles, length_m=60.0, end=6.0):
    """Vehicles of 8 to 16 m/s that brake evenly, so that each drives 6 m/s at the end of a street."""
    time_s = 0.1 * np.arange(100)
    begin = rng.uniform(8.0, 16.0, (n_vehicles, 1))
    braking = (begin**2 - end**2) / (2 * length_m)
    braked_s = np.minimum(time_s, (begin - end) / braking)
    x = begin * braked_s - 0.5 * braking * braked_s**2 + end * (time_s - braked_s)
    y = np.broadcast_to(rng.normal(0.0, 0.3, (n_vehicles, 1)), x.shape)
    return tracks_of(np.stack([x, y], axis=-1), speed=begin - braking * braked_s)


def test_who_is_faster_brakes_harder_for_the_same_place():
    traffic, others = (braking_traffic(np.random.default_rng(seed), n_vehicles=40) for seed in (0, 1))
    learned = learn_primitives(traffic, tessellation="grid", cell_size=12.0, rng=np.random.default_rng(0))
    rows = TrackRows.thinned(traffic, interval_s=0.1)
    now, later = others[others.time_ns == 0], others[others.time_ns == 4_000_000_000]
    assert (now.track_id == later.track_id).all()

    motion = learn_motion(learned, rows, background_of(rows), rng=np.random.default_rng(0))
    paths = rollouts(
        replace(learned, motion=motion), now.position, now.direction, now.speed, time_s=[4.0], n_samples=64, seed=2
    )
    too_far = paths[:, :, 0, 0].mean(axis=1) - later.position[:, 0]
    assert abs(np.polyfit(now.speed, too_far, 1)[0]) < 0.05  # m by m/s that it is faster; at constant speed 2 s
