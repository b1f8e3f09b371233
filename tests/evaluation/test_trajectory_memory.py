"""Trajectory memory: vehicles go on as one that was seen here and moved like it, never as themselves."""

import numpy as np
import pytest

from dirprim_filter.evaluation.baselines.trajectory_memory import States, TrajectoryMemory
from dirprim_filter.evaluation.forecast_cases import Cases
from situations import ring_traffic, tracks_of

RADIUS, SPEED = 20.0, 8.0


def on_ring(angle, *, radius=RADIUS, speed=SPEED):
    angle = np.atleast_1d(angle)
    place = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return States(place, angle + np.pi / 2, np.full(angle.size, speed))


def drawn(memory, start, time_s, *, n_samples=200, but=None):
    return memory.sample(start, time_s=np.array(time_s), n_samples=n_samples, but=but, rng=np.random.default_rng(0))


@pytest.fixture(scope="module")
def memory():
    return TrajectoryMemory.of(ring_traffic(np.random.default_rng(0), n_vehicles=40))


def test_on_a_ring_it_goes_along_the_ring_and_off_it_straight_on(memory):
    path = drawn(memory, on_ring([0.3, 2.0]), (1.0, 3.0))
    radius = np.linalg.norm(path, axis=-1)
    angle = np.arctan2(path[..., 1], path[..., 0]) - np.array([0.3, 2.0])[:, None, None]
    assert np.median(np.abs(radius - RADIUS)) < 1.0
    np.testing.assert_allclose(np.median(angle % (2 * np.pi), axis=1), [[0.4, 1.2]] * 2, rtol=0.1)
    beside = States(np.array([[200.0, 0.0]]), np.array([0.0]), np.array([SPEED]))  # the control: no vehicle was there
    unfamiliar = drawn(memory, beside, (3.0,))
    bend = np.linalg.norm(unfamiliar - [200.0, 0.0], axis=-1)
    assert np.median(np.abs(np.linalg.norm(unfamiliar, axis=-1) - RADIUS)) > 100.0
    assert (bend < 1.7 * 3.0 * SPEED).all()


def test_a_vehicle_never_follows_itself():
    alone = ring_traffic(np.random.default_rng(0), n_vehicles=1)
    memory = TrajectoryMemory.of(alone)
    start = States(alone.position[:1], alone.direction[:1], alone.speed[:1])
    radius = {but: np.linalg.norm(drawn(memory, start, (3.0,), but=np.array([but])), axis=-1) for but in (-1, 0)}
    own = np.linalg.norm(alone.position[0])
    assert np.median(np.abs(radius[-1] - own)) < 1.0
    assert (radius[0] > own + 5.0).all()  # straight on: there is no other


def test_of_tracks_of_one_row_there_is_nothing_to_remember_and_all_go_straight_on():
    lone = tracks_of(np.zeros((3, 1, 2)))
    memory = TrajectoryMemory.of(lone)
    memory, found = memory.chosen(Cases.of(lone, horizons_s=(2.0,)), (2.0,), rng=np.random.default_rng(0))
    assert not found
    path = drawn(memory, States(np.zeros((1, 2)), np.zeros(1), np.full(1, 10.0)), (2.0,))
    np.testing.assert_allclose(path[0, :, 0], np.tile([20.0, 0.0], (200, 1)), atol=1.0)
