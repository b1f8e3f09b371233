"""Rollouts keep to the road, and a vehicle's rollouts are its own."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter import forecast
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Particles, TrackedFrame
from dirprim_filter.filtering import Tracker
from dirprim_filter.forecasting import Forecaster, projected, sampled
from dirprim_filter.primitives.motion_table import motion_table
from dirprim_filter.replay import replay
from situations import TRUSTING, estimates_of, one_cell_map

START = {"position": (20.0, 0.0), "direction": np.pi / 2, "speed": 8.0}


def test_the_same_random_state_gives_the_same_rollouts_and_another_gives_others(ring_map):
    first, again, other = (forecast(ring_map, **START, rng=np.random.default_rng(seed)) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_on_a_straight_road_of_one_speed_positions_stand_at_dt_2_dt_and_so_on():
    straight = one_cell_map()
    paths = forecast(straight, position=(5.0, 1.0), direction=0.0, speed=10.0, dt_s=0.5, rng=np.random.default_rng(0))
    np.testing.assert_allclose(paths[..., 0], np.tile(5.0 + 5.0 * np.arange(1, 11), (100, 1)), atol=0.1)
    np.testing.assert_allclose(paths[..., 1], 1.0, atol=0.3)


def forecasts(ring_map, detections, **settings):
    kept, rng = [], np.random.default_rng(5)
    forecaster = Forecaster(ring_map, [kept.append], rng=rng, **{"n_samples": 4} | settings)
    tracker = Tracker(ring_map, config=FilterConfig(n_particles=50), tracking=TRUSTING, rng=np.random.default_rng(5))
    replay(detections.frames(), tracker, [forecaster])
    return [(made.time_ns, list(made.track_id), made.paths) for made in kept]


def test_a_vehicles_rollouts_are_the_same_to_the_byte_without_the_others_as_often_as_asked_for(ring_map, ring):
    crowd = Detections.of(ring[(ring.track_id < 6) & (ring.time_ns < 2_500_000_000)])
    rows = crowd.track_id == "4"
    alone = Detections(track_id=crowd.track_id[rows], time_ns=crowd.time_ns[rows], position=crowd.position[rows])
    of_crowd, of_one = forecasts(ring_map, crowd), forecasts(ring_map, alone)
    assert [time_ns for time_ns, *_ in of_crowd] == [0, 1_000_000_000, 2_000_000_000]
    for (_, names, paths), (_, name, path) in zip(of_crowd, of_one, strict=True):
        assert name == ["4"]
        assert paths.shape == (6, 4, 20, 2)
        assert paths[names.index("4")].tobytes() == path[0].tobytes()
        assert paths[names.index("3")].tobytes() != path[0].tobytes()
    crowd = Detections.of(ring[(ring.track_id < 2) & (ring.time_ns < 1_000_000_000)])
    assert [time_ns for time_ns, *_ in forecasts(ring_map, crowd, every_s=0.3)] == [k * 300_000_000 for k in range(4)]
    assert len(forecasts(ring_map, crowd, every_s=1e-3)) == 10


def test_a_belief_goes_on_by_the_manoeuvres_that_the_filter_found(ring_map):
    """One state, of which the filter has found whether it brakes: samples keep that, and look anew without it."""
    motion = replace(ring_map.motion, push=np.full_like(ring_map.motion.push, 0.1))  # drivers of rings do not brake
    ring_map = replace(ring_map, motion=motion)
    state, n = (np.array([20.0, 0.0]), np.pi / 2, 8.0), 400
    cell = int(ring_map.tessellation.cell_of(state[0][None])[0])
    here = np.flatnonzero((motion.cell == cell) & (motion.start_rate == 0))
    gained = motion.acceleration[here] @ [1.0, *(state[0] - ring_map.centers[cell]), state[2]]
    slowest = here[np.argmin(gained)]
    table, dt_s = motion_table(ring_map), np.full(5, 0.1)

    def mean_way(**found):
        belief = Particles(
            position=np.tile(state[0], (n, 1)), direction=np.full(n, state[1]), speed=np.full(n, state[2]),
            weight=np.full(n, 1 / n), vehicle=np.zeros(n, np.int64), **found,
        )  # fmt: skip
        paths = projected(table, [sampled(table, belief, n, rng=np.random.default_rng(0))], dt_s)[0]
        return float(np.linalg.norm(paths[:, -1] - state[0], axis=1).mean())

    hard = {"manoeuvre": np.full(n, slowest), "push": np.full(n, -20.0)}
    assert mean_way(**hard) < mean_way() - 0.5 * 20.0 * motion.push[slowest] * 0.4**2 / 2
    of_no_place = hard | {"manoeuvre": np.full(n, motion.n_placed)}
    assert mean_way(**of_no_place) == mean_way()


def test_a_belief_of_two_minds_has_rollouts_of_both_as_often_as_it_believes(ring_map):
    n = 200
    there = np.arange(n) % 2 == 1
    particles = Particles(
        position=np.where(there[:, None], (-20.0, 0.0), (20.0, 0.0)), direction=np.where(there, -np.pi / 2, np.pi / 2),
        speed=np.full(n, 8.0), weight=np.where(there, 0.2, 0.8) * 2 / n, vehicle=np.zeros(n, np.int64),
    )  # fmt: skip
    estimates = estimates_of(["a"], direction_resultant=0.0, speed=8.0)
    frame = TrackedFrame(time_ns=0, detections=Detections.none(), estimates=estimates, particles=particles)
    forecaster = Forecaster(ring_map, [], n_samples=1000, dt_s=0.5, rng=np.random.default_rng(0))
    first = forecaster.paths(frame)[0, :, 0]
    assert (np.abs(np.abs(first[:, 0]) - 20.0) < 4.0).all()
    assert (first[:, 0] > 0).mean() == pytest.approx(0.8, abs=4 * np.sqrt(0.16 / 1000))
