"""Where first detections are expected: against the chain's exact solution, counted vehicles, and what was made."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.sparse import csr_array

from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.filtering import ParticleFilter
from dirprim_filter.filtering.existence import LEVEL_S, Undetected
from dirprim_filter.primitives.traffic import Traffic
from moving import motion_by_hand, squares
from situations import on_the_ring, one_cell_map, seen_at, tracker_of
from tessellation import GridTessellation

SETTINGS = FilterConfig(n_particles=100)
STAY_S = 2.0


def road():
    """Squares side by side: trajectories begin in the first, stay 2 s in each on average, and end in the last."""
    cells = GridTessellation(origin=np.zeros(2), cell_size=20.0, n_x=4, n_y=1, square=np.arange(4))
    return Traffic(
        present=np.full(4, 0.25), begins=np.eye(4)[0] / (4 * STAY_S), ends=np.eye(4)[-1] / STAY_S,
        flow=csr_array((np.eye(4, k=-1) - np.eye(4)) / STAY_S), cell=np.arange(4), tessellation=cells,
    )  # fmt: skip


def of_map(primitive_map):
    return Traffic.of(primitive_map.tessellation, primitive_map.motion)


def seen_in(traffic, rng, *, level, clutter):
    """First detections of a Poisson number of vehicles where traffic is, and false ones among them."""
    side, n_cells = np.sqrt(traffic.tessellation.area[0]), traffic.tessellation.n_cells
    n, n_false = rng.poisson(level), rng.poisson(clutter * traffic.tessellation.area.sum())
    cell = np.append(rng.choice(traffic.cell, n, p=traffic.present), rng.integers(0, n_cells, n_false))
    return np.column_stack([side * (cell + rng.random(cell.size)), side * rng.random(cell.size)])


def test_traffic_learned_from_a_log_neither_grows_nor_shrinks_and_comes_back(ring_map):
    traffic = of_map(ring_map)
    for dt_s in (0.04, 1.0):
        np.testing.assert_allclose(traffic.later(traffic.present, dt_s), traffic.present, rtol=1e-9)
    after = traffic.later(0.1 * traffic.present, 1.0)
    assert (after <= traffic.present * (1 + 1e-9)).all()
    assert 0.1 < after.sum() < traffic.later(after, 1.0).sum() < 1.0
    assert of_map(ring_map.without_places()) is None  # the controls: nothing is known of trajectories
    assert of_map(one_cell_map()) is None


def test_trajectories_begin_and_end_where_visits_have_none_before_or_after_them(ring_map):
    ways = motion_by_hand([0, 0, 0], transitions=[(0, 1, 1.0), (1, 2, 0.5)])  # of one visit and one second each
    traffic = of_map(squares(1, 1, ways))
    np.testing.assert_allclose(traffic.begins, np.array([1.0, 0.0, 0.5]) / 3.0)
    on_a_ring = of_map(ring_map)
    assert on_a_ring.ends.max() < 1.0  # the log ends wherever its vehicles are: that is no exit


def test_who_is_not_detected_passes_on_by_the_chains_exact_solution_and_is_thinned_by_frames():
    traffic, config = road(), TrackingConfig(detection_probability=0.6)
    undetected, share, b = Undetected(traffic, config, SETTINGS), traffic.present, traffic.begins
    generator = np.zeros((5, 5))
    generator[:4, :4], generator[:4, 4] = traffic.flow.toarray(), b
    level = config.vehicle_density * traffic.tessellation.area.sum()
    centers = traffic.tessellation.centers
    for _ in range(4):
        expected = config.birth_density + 0.6 * level * share / traffic.tessellation.area
        np.testing.assert_allclose(expected_at(undetected, centers), expected, rtol=0.03)
        see(undetected, np.empty((0, 2)))
        undetected._counts[0] = level * undetected._counts[1]  # only what is where is asked about
        share = (expm(generator * 0.2) @ np.append(0.4 * share, 1.0))[:4]
        undetected.advance(0.2, 5.0)
    assert share[0] > 5.0 * share[-1]  # the first cell is where trajectories begin
    assert expected_at(undetected, centers + 1e3) == pytest.approx(config.birth_density)


class Counted(csr_array):
    """A matrix that knows how often it was multiplied."""

    times = 0

    def __matmul__(self, other):
        Counted.times += 1
        return super().__matmul__(other)


def test_a_pause_of_many_minutes_costs_no_thousands_of_steps():
    slow = road()
    slow = replace(slow, flow=Counted(slow.flow / 100.0), begins=slow.begins / 100.0)  # who stays 200 s in each square
    generator = np.block([[slow.flow.toarray(), slow.begins[:, None]], [np.zeros((1, 5))]])
    empty = np.zeros(4)
    for dt_s in (30.0, 99.0, 101.0, 600.0, 3600.0):  # buses send their place each ten minutes
        exact = (expm(generator * dt_s) @ np.append(empty, 1.0))[:4]
        np.testing.assert_allclose(slow.later(empty, dt_s), exact, atol=0.01 * slow.present[0])
    Counted.times = 0
    slow.later(empty, 3600.0)
    assert Counted.times <= 1000


def expected_at(undetected, places):
    """First detections per square metre; false ones aside."""
    return undetected.by_chance(places, np.zeros(len(places), np.bool_), 0.0)


def see(undetected, places, *, labelled=False):
    false = np.full(len(places), undetected.config.clutter_density)
    return undetected.see(places, np.full(len(places), labelled), false)


def test_the_level_is_learned_from_vehicles_and_not_from_clutter():
    traffic, config = road(), TrackingConfig(clutter_density=2e-3, vehicle_density=1e-2)
    levels = np.zeros((2, 40))
    for (i, seed), _ in np.ndenumerate(levels):
        undetected, rng = Undetected(traffic, config, SETTINGS), np.random.default_rng(seed)
        see(undetected, seen_in(traffic, rng, level=i * 0.9 * 40.0, clutter=config.clutter_density))
        levels[i, seed] = undetected.level
    of_clutter, of_forty = levels.mean(axis=1)  # 16 were expected
    assert of_clutter < 4.0
    assert of_forty == pytest.approx(40.0, rel=0.1)
    stays = Undetected(traffic, config, SETTINGS)
    see(stays, seen_in(traffic, np.random.default_rng(0), level=40.0, clutter=0.0), labelled=True)
    assert stays.level == pytest.approx(config.vehicle_density * traffic.tessellation.area.sum())


def test_the_level_follows_the_traffic_up_and_down_within_its_time_constant():
    traffic, config = road(), TrackingConfig(clutter_density=1e-6, vehicle_density=1e-2)
    undetected, rng, levels = Undetected(traffic, config, SETTINGS), np.random.default_rng(0), []
    for truth in (40.0, 2.0):
        for _ in range(2 * round(LEVEL_S) // 10):
            undetected.advance(10.0, 5.0)  # after a pause longer than a gap all are first detections
            see(undetected, seen_in(traffic, rng, level=0.9 * truth, clutter=0.0))
        levels.append(undetected.level)
    assert levels[0] == pytest.approx(40.0, rel=0.1)
    assert 2.0 < levels[1] < 2.0 + np.exp(-2.0) * 38.0 + 3.0  # what it keeps of before, and of its first 16


def test_after_a_pause_all_are_undetected_again_and_without_a_map_frames_thin_alike():
    for traffic in (None, road()):
        undetected = Undetected(traffic, TrackingConfig(), SETTINGS)
        place = np.full((1, 2), 10.0)
        first = expected_at(undetected, place)
        assert see(undetected, place, labelled=True) == pytest.approx(first)
        undetected.advance(0.1, 5.0)
        assert expected_at(undetected, place) < 0.3 * first
        undetected.advance(5.1, 5.0)
        assert expected_at(undetected, place) == pytest.approx(first)


@pytest.mark.parametrize("is_dense", [True, False])
def test_a_first_frame_full_of_vehicles_on_the_road_is_reported_and_one_detection_is_not(ring_map, is_dense):
    rng = np.random.default_rng(0)
    angle, off_road = rng.uniform(0, 2 * np.pi, 20 if is_dense else 1), rng.uniform(40, 80, (5, 2))
    places = np.concatenate([20.0 * np.column_stack([np.cos(angle), np.sin(angle)]), off_road])
    found = tracker_of(ring_map, seed=1, n_particles=100).step(seen_at(0.0, places))
    assert len(found) == (angle.size if is_dense else 0)
    assert (np.linalg.norm(found.position, axis=1) < 30.0).all()


class AtAnExit(ParticleFilter):
    """Where trajectories end at a rate, 1/s."""

    rate = 0.0

    def places(self, slot):
        return super().places(slot)._replace(ends=np.full(slot.size, self.rate))


def test_who_is_missed_where_trajectories_end_is_gone_sooner_than_elsewhere(ring_map):
    left = []
    for rate in (0.0, 2.0):
        model = AtAnExit(ring_map, SETTINGS)
        model.rate, tracker = rate, tracker_of(model, seed=1, n_particles=100)
        seen = [seen_at(0.1 * i, [on_the_ring(0.1 * i)][: i < 20]) for i in range(30)]
        n_found = [len(tracker.step(frame, time_ns=i * 10**8)) for i, frame in enumerate(seen)]
        assert all(n_found[5:20])
        left.append(sum(n_found[20:]))
    assert left[1] < left[0]
