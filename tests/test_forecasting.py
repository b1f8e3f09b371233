"""Rollouts keep to the road, a vehicle's are its own, and who responds to its leader shares a scene with it."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter import forecast
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Particles, TrackedFrame
from dirprim_filter.filtering import GroupTracker
from dirprim_filter.forecasting import Forecaster, leader_table, projected, sampled
from dirprim_filter.primitives.leader import N_FEATURES, LeaderResponse
from dirprim_filter.primitives.motion_table import motion_table
from dirprim_filter.replay import replay
from moving import motion_by_hand, rollouts, squares, state_of
from situations import TRUSTING, estimates_of, one_cell_map, seen_at, tracker_of

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
    replay(detections.frames(), tracker_of(ring_map, tracking=TRUSTING, seed=5, n_particles=50), [forecaster])
    return [(made.time_ns, list(made.track_id), made.paths) for made in kept]


def test_a_vehicles_rollouts_are_the_same_to_the_byte_without_the_others_as_often_as_asked_for(ring_map, ring):
    crowd = Detections.of(ring[(ring.track_id < 6) & (ring.time_ns < 2_500_000_000)])
    of_crowd, of_one = forecasts(ring_map, crowd), forecasts(ring_map, crowd[crowd.track_id == "4"])
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


RESPONDING = FilterConfig(interaction="leader", n_particles=100)
ALWAYS, ROOM = 0, 1


def road(*, trust=1.0, push=0.0, start_rate=(0.0, 0.0, 5.0), by=ROOM, gained=0.5):
    """A lane of 400 m to the east; drivers take the speed at which they could stop behind their leader."""
    motion = motion_by_hand(
        np.repeat(np.arange(20), 2), start_rate=np.tile([0.0, 0.2], 20), log_pace=np.tile([np.log(10.3), 0.0], 20)
    )
    gain = np.zeros(N_FEATURES)
    gain[by] = gained
    leader = LeaderResponse(gain=gain, push=push, trust=trust, start_rate=np.array(start_rate))
    return squares(20, 1, replace(motion, leader=leader))


def ways_of(primitive_map, place, speed, *, interaction="leader", time_s=(1.0, 5.0), seed=0):
    states = np.column_stack([place, np.full(len(place), 10.0)]), np.zeros(len(place)), speed
    given = {"time_s": time_s, "n_samples": 200, "interaction": interaction, "seed": seed}
    return rollouts(primitive_map, *states, **given)[..., 0]


def test_no_vehicle_drives_through_a_queue_but_one_without_a_leader():
    place, speed = [100.0, 60.0, 20.0], [0.0, 10.0, 10.0]
    responding = ways_of(road(start_rate=(0.0, 0.0, 0.0)), place, speed)
    standing = responding[0, :, -1] < 101.0
    assert (responding[1, standing, -1] < 96.0).all()
    assert (responding[2, standing, -1] < responding[1, standing, -1] - 4.0).all()
    alone = ways_of(road(), place, speed, interaction="none")
    assert (alone[1, :, -1] > 105.0).all()


def test_samples_of_one_number_are_one_scene():
    """When the leader starts is drawn; who waits behind it moves up as far as it goes, in that sample."""
    found = ways_of(road(start_rate=(0.0, 5.0, 5.0)), [100.0, 93.0], [0.0, 0.0], time_s=(10.0,))[..., 0]
    leads, follows = found[0] - 100.0, found[1] - 93.0
    assert leads.std() > 0.5
    assert (follows < leads + 0.8).all()
    assert np.corrcoef(leads, follows)[0, 1] > 0.8
    assert (np.roll(follows, 1) > leads + 0.8).any()  # of another scene


def test_order_does_not_matter():
    table, response = motion_table(road(push=0.5)), leader_table(road(push=0.5), RESPONDING)
    place, speed = np.array([100.0, 60.0, 20.0, 140.0]), np.array([4.0, 10.0, 12.0, 9.0])
    dt_s, order = np.full(6, 0.5), np.array([2, 0, 3, 1])
    alone = [
        sampled(table, state_of((x, 10.0), 0.0, v), 50, rng=np.random.default_rng(int(x)))
        for x, v in zip(place, speed, strict=True)
    ]
    found = projected(table, alone, dt_s, response)
    again = projected(table, [alone[i] for i in order], dt_s, response)
    np.testing.assert_array_equal(again, found[order])


def test_where_leaders_are_not_trusted_vehicles_go_on_as_if_alone():
    place, speed, steps = [100.0, 85.0], [5.0, 10.0], tuple(0.2 * np.arange(1, 20))
    alone = ways_of(road(trust=0.0), place, speed, interaction="none", time_s=steps)
    for trust in (0.0, 1e-12):
        found = ways_of(road(trust=trust), place, speed, time_s=steps)
        np.testing.assert_allclose(found, alone, atol=1e-6 * (trust > 0))
    assert (ways_of(road(trust=0.5), place, speed, time_s=steps)[0] == alone[0]).all()  # nothing is ahead of it
    assert (ways_of(road(trust=0.5), place, speed, time_s=steps)[1] != alone[1]).any()


def test_forecasts_of_a_frame_are_worlds_of_its_groups():
    """Who brakes behind its leader does not brake behind a vehicle of another group."""
    place, group = np.array([60.0, 90.0, 60.0]), np.array([0, 0, 1])
    learned = road(by=ALWAYS, gained=-2.0)
    tracker = GroupTracker(lambda _: tracker_of(learned, tracking=TRUSTING, seed=1, n_particles=100))
    where = np.column_stack([place, np.full(3, 10.0)])
    frame = tracker.track(seen_at(0.0, where, ids=["a", "b", "a"], group=group))
    assert frame.names == ["a", "b", "1/a"]
    ways = {}
    for interaction in ("leader", "none"):
        config = replace(RESPONDING, interaction=interaction)
        forecaster = Forecaster(learned, [], horizon_s=3.0, config=config, rng=np.random.default_rng(0))
        ways[interaction] = forecaster.paths(frame)[:, :, -1, 0].mean(axis=1) - place
    assert ways["leader"][0] < ways["none"][0] - 4.0
    np.testing.assert_allclose(ways["leader"][1:], ways["none"][1:], atol=0.5)  # steps are cut by looks
