"""Vehicles on primitives that bend turn with the bend."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from dirprim_filter import forecast, learn_primitives
from dirprim_filter.config import FilterConfig
from dirprim_filter.filtering import _kernels, _relaxing
from dirprim_filter.filtering.belief import ParticleBelief
from dirprim_filter.filtering.motion import motion_table
from dirprim_filter.primitives.journeys import Journeys
from situations import one_cell_map, ring_traffic

BARE = FilterConfig(direction_spread=1e-6, speed_spread=1e-6)  # the modes of the map as they are
RADIUS = 20.0


def off_the_ring(primitive_map, *, horizon_s=3.0):
    """Mean distance from the ring of vehicles that were not learned from, that many seconds later."""
    rng = np.random.default_rng(0)
    test = ring_traffic(np.random.default_rng(77), n_vehicles=40, n_rows=1)
    last = np.concatenate([
        forecast(primitive_map, position=p, direction=d, speed=s, horizon_s=horizon_s, rng=rng)[:, -1]
        for p, d, s in zip(test.position, test.direction, test.speed, strict=True)
    ])  # fmt: skip
    return np.abs(np.hypot(*last.T) - RADIUS).mean()


@pytest.mark.parametrize("cell_size", [6.0, 9.0])
def test_on_a_ring_futures_of_a_curved_map_keep_the_lane_better_than_those_of_a_flat_one(ring, cell_size):
    curved, flat = (  # by their primitives alone
        replace(
            learn_primitives(
                ring, tessellation="grid", cell_size=cell_size, primitive=primitive, rng=np.random.default_rng(0)
            ),
            journeys=Journeys.none(),
        )
        for primitive in ("curved", "flat")
    )
    of_curved, of_flat, of_free = (off_the_ring(m) for m in (curved, flat, curved.without_places()))
    assert of_curved < 1.75  # half a lane
    assert of_curved < of_flat
    assert of_curved < 0.2 * of_free


def circling(**knobs):
    """A cell whose mode turns to the left by 1 / RADIUS along its way east, at first."""
    straight = one_cell_map(drift=1e-6, side=60.0, **knobs)
    bend = np.zeros((2, 1, 2))
    bend[0, 0, 0] = 1 / RADIUS
    return replace(straight, bend=bend)


def test_a_vehicle_turns_with_the_bend_as_the_line_of_the_field_does():
    """The line of course x / R through the origin: y = -R log cos(x / R)."""
    path = forecast(
        circling(), position=(0.0, 0.0), direction=0.0, speed=10.0, horizon_s=2.0, dt_s=0.1, config=BARE,
        rng=np.random.default_rng(0),
    ).mean(axis=0)  # fmt: skip
    np.testing.assert_allclose(path[:, 1], -RADIUS * np.log(np.cos(path[:, 0] / RADIUS)), atol=0.3)
    assert path[-1, 1] > 5.0


def test_speed_settles_on_the_gain_of_the_place():
    standing_still = one_cell_map(drift=1e-6, shape=400.0, concentration=100.0, side=1e4, speed_rate=5.0)
    gain = np.zeros((2, 1, 2))
    gain[0, 0, 1] = 0.05  # north, across the way
    paths = forecast(
        replace(standing_still, gain=gain), position=(0.0, 10.0), direction=0.0, speed=10.0, horizon_s=4.0, dt_s=1.0,
        config=BARE, n_samples=400, rng=np.random.default_rng(0),
    )  # fmt: skip
    speed = np.diff(paths[:, 2:, 0], axis=1).mean() / np.cos(0.1)
    north = paths[:, 2:, 1].mean()
    assert speed == pytest.approx(10.0 * np.exp(0.05 * north), rel=0.05)


def test_a_belief_is_born_along_the_bend_of_its_place():
    for place in (np.array([10.0, 0.0]), np.array([-10.0, 5.0])):
        table = motion_table(circling(concentration=400.0), BARE)
        belief = ParticleBelief(n_particles=20_000)
        _kernels.be_born(table, belief.cloud, np.array([0]), np.array([7], np.uint64), place[None], 1e-6)
        direction = belief.cloud.direction[0]
        assert stats.kstest(direction, stats.vonmises(400.0, loc=place[0] / RADIUS).cdf).pvalue > 1e-4
        assert stats.kstest(direction, stats.vonmises(400.0, loc=0.9 * place[0] / RADIUS).cdf).pvalue < 1e-4


def test_beyond_its_cell_a_primitive_bends_no_further():
    table = motion_table(circling(), BARE)
    for x, bound in ((29.0, 29.0), (31.0, 30.0), (-500.0, -30.0)):
        assert _relaxing.offset_in(table, 0, x, -x) == (bound, -bound)
