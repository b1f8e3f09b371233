"""Vehicles that respond to who drives ahead of them: joint scenes."""

from dataclasses import replace

import numpy as np

import moving
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import GroupTracker, Tracker
from dirprim_filter.forecasting import Forecaster, leader_table, projected, sampled
from dirprim_filter.primitives.leader import N_FEATURES, LeaderResponse
from dirprim_filter.primitives.motion_table import motion_table
from moving import motion_by_hand, squares
from situations import TRUSTING

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


def rollouts(primitive_map, place, speed, *, interaction="leader", time_s=(1.0, 5.0), seed=0):
    states = np.column_stack([place, np.full(len(place), 10.0)]), np.zeros(len(place)), speed
    given = {"time_s": time_s, "n_samples": 200, "interaction": interaction, "seed": seed}
    return moving.rollouts(primitive_map, *states, **given)[..., 0]


def test_no_vehicle_drives_through_a_queue_but_one_without_a_leader():
    place, speed = [100.0, 60.0, 20.0], [0.0, 10.0, 10.0]
    responding = rollouts(road(start_rate=(0.0, 0.0, 0.0)), place, speed)
    standing = responding[0, :, -1] < 101.0
    assert (responding[1, standing, -1] < 96.0).all()
    assert (responding[2, standing, -1] < responding[1, standing, -1] - 4.0).all()
    alone = rollouts(road(), place, speed, interaction="none")
    assert (alone[1, :, -1] > 105.0).all()


def test_samples_of_one_number_are_one_scene():
    """When the leader starts is drawn; who waits behind it moves up as far as it goes, in that sample."""
    found = rollouts(road(start_rate=(0.0, 5.0, 5.0)), [100.0, 93.0], [0.0, 0.0], time_s=(10.0,))[..., 0]
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
        sampled(table, moving.state_of((x, 10.0), 0.0, v), 50, rng=np.random.default_rng(int(x)))
        for x, v in zip(place, speed, strict=True)
    ]
    found = projected(table, alone, dt_s, response)
    again = projected(table, [alone[i] for i in order], dt_s, response)
    np.testing.assert_array_equal(again, found[order])


def test_where_leaders_are_not_trusted_vehicles_go_on_as_if_alone():
    place, speed, steps = [100.0, 85.0], [5.0, 10.0], tuple(0.2 * np.arange(1, 20))
    alone = rollouts(road(trust=0.0), place, speed, interaction="none", time_s=steps)
    for trust in (0.0, 1e-12):
        found = rollouts(road(trust=trust), place, speed, time_s=steps)
        np.testing.assert_allclose(found, alone, atol=1e-6 * (trust > 0))
    assert (rollouts(road(trust=0.5), place, speed, time_s=steps)[0] == alone[0]).all()  # nothing is ahead of it
    assert (rollouts(road(trust=0.5), place, speed, time_s=steps)[1] != alone[1]).any()


def test_forecasts_of_a_frame_are_worlds_of_its_groups():
    """Who brakes behind its leader does not brake behind a vehicle of another group."""
    place, group = np.array([60.0, 90.0, 60.0]), np.array([0, 0, 1])
    learned = road(by=ALWAYS, gained=-2.0)
    tracker = GroupTracker(
        lambda _: Tracker(learned, config=RESPONDING, tracking=TRUSTING, rng=np.random.default_rng(1))
    )
    where = np.column_stack([place, np.full(3, 10.0)])
    frame = tracker.track(
        Detections(track_id=["a", "b", "a"], time_ns=np.zeros(3, np.int64), position=where, group=group)
    )
    assert frame.names == ["a", "b", "1/a"]
    ways = {}
    for interaction in ("leader", "none"):
        config = replace(RESPONDING, interaction=interaction)
        forecaster = Forecaster(learned, [], horizon_s=3.0, config=config, rng=np.random.default_rng(0))
        ways[interaction] = forecaster.paths(frame)[:, :, -1, 0].mean(axis=1) - place
    assert ways["leader"][0] < ways["none"][0] - 4.0
    np.testing.assert_allclose(ways["leader"][1:], ways["none"][1:], atol=0.5)  # steps are cut by looks
