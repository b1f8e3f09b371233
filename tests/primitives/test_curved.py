"""Primitives that bend: found where they are, absent where they are not, and proper densities everywhere."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter import learn_primitives
from dirprim_filter.config import LearningConfig
from dirprim_filter.distributions.angles import difference, wrap
from dirprim_filter.distributions.von_mises import mean_resultant_length
from dirprim_filter.primitives._modes import Modes
from dirprim_filter.primitives.fitting import bounds_of, fit_all
from situations import one_cell, one_cell_map, ring_traffic

SIDE = 10.0  # metres, of the one cell
# weight, mean direction, concentration, shape, mean speed, bend east and north, gain east and north
BENT = np.array([
    [0.6, 3.1, 60.0, 40.0, 12.0, 0.05, -0.08, 0.03, 0.02],  # across the wrap
    [0.4, 0.6, 25.0, 9.0, 5.0, 0.0, 0.1, -0.05, 0.0],
])  # fmt: skip
FLAT = np.hstack([BENT[:, :5], np.zeros((2, 4))])


def simulated(truth, rng, *, n, low=-SIDE / 2):
    """Rows of n vehicles that pass anywhere in the cell east and north of `low`, as the kernels take them."""
    mode = rng.choice(len(truth), size=n, p=truth[:, 0])
    _, mean, concentration, shape, mean_speed, *_ = truth[mode].T
    offset = rng.uniform(low, SIDE / 2, (n, 2))
    turned, gained = (truth[mode, 5:7] * offset).sum(axis=1), (truth[mode, 7:] * offset).sum(axis=1)
    direction = wrap(mean + turned + rng.vonmises(0.0, concentration))
    speed = mean_speed * np.exp(gained) * rng.standard_gamma(shape) / shape
    return one_cell(direction, speed, n_vehicles=n, position=offset)


def fitted(rows, **settings):
    """What BIC prefers, as rows of BENT, heaviest first."""
    given = {"max_modes": 3, "prior_strength": 0.02, "speed_spread": 0.2, "curved": True} | settings
    out = Modes.of(fit_all(rows, bounds_of(LearningConfig(), **given))[0])
    used = out.weight > 0
    out = out.take(used)
    found = np.column_stack([*out[:4], out.shape / out.rate, out.bend, out.gain])
    return found[np.argsort(-found[:, 0])]


def slopes_off(found, truth, n):
    """Standard errors of maximum likelihood between each bend and gain and its true value."""
    weight, concentration, shape = truth[:, [0]].T[0], truth[:, 2], truth[:, 3]
    of_place = n * weight * SIDE**2 / 12
    of_bend = 1 / np.sqrt(of_place * concentration * mean_resultant_length(concentration))
    of_gain = 1 / np.sqrt(of_place * shape)
    error = np.column_stack([of_bend, of_bend, of_gain, of_gain])
    return np.abs(found[:, 5:] - truth[:, 5:]) / error


@pytest.mark.parametrize("seed", range(5))
def test_known_bends_and_gains_are_recovered_to_four_standard_errors(seed):
    n = 3000
    found = fitted(simulated(BENT, np.random.default_rng(seed), n=n))
    assert found.shape == BENT.shape
    assert slopes_off(found, BENT, n).max() < 4
    assert np.abs(difference(found[:, 1], BENT[:, 1])).max() < 0.03
    np.testing.assert_allclose(found[:, [0, 2, 3, 4]], BENT[:, [0, 2, 3, 4]], rtol=0.2)
    for column in range(5, 9):  # the tolerance separates neighbours
        other = BENT.copy()
        other[:, column] += 0.01
        assert slopes_off(found, other, n).max() > 4


def test_known_bends_are_recovered_from_one_corner_of_the_cell():
    """There the mean at the centre is extrapolated, and moves with every step of the slope."""
    rows = simulated(BENT[:1] / [0.6, *np.ones(8)], np.random.default_rng(0), n=3000, low=1.0)
    (found,) = fitted(rows, max_modes=1)
    error = 1 / np.sqrt(3000 * 4.0**2 / 12 * np.array([60.0, 60.0, 40.0, 40.0]))
    np.testing.assert_array_less(np.abs(found[5:] - BENT[0, 5:]), 4 * error)
    away = np.sqrt(2) * 3.0  # from the centre of the cell to that of the corner
    assert np.abs(difference(found[1], BENT[0, 1])) < 4 * away * error[0]
    assert np.abs(np.log(found[4] / BENT[0, 4])) < 4 * away * error[2]


@pytest.mark.parametrize("n", [30, 300])
def test_where_nothing_bends_flat_modes_are_preferred(n):
    flat = [(fitted(simulated(FLAT, np.random.default_rng(seed), n=n))[:, 5:] == 0.0).all() for seed in range(100)]
    assert np.mean(flat) >= 0.95


def bent_map(bend=(0.05, -0.08), gain=(0.03, 0.02)):
    """One cell of 10 m around the origin with one curved mode; outside of it a flat one."""
    return one_cell_map(mean=3.1, concentration=60.0, speed=12.0, shape=40.0, side=SIDE, bend=bend, gain=gain)


def places(n, rng):
    return rng.uniform(-SIDE / 2, SIDE / 2, (n, 2))


def test_the_primitive_is_linear_inside_a_cell_and_continuous():
    curved, rng = bent_map(), np.random.default_rng(1)
    a, b, share = places(500, rng), places(500, rng), rng.uniform(size=500)
    at_a, at_b, between = (curved.primitive_at(p) for p in (a, b, a + share[:, None] * (b - a)))

    def columns(primitive):
        return np.stack([primitive.direction.mean_direction[:, 0], np.log(primitive.speed.mean[:, 0])])

    expected = columns(at_a) + share * difference(columns(at_b), columns(at_a))  # the course crosses the wrap
    np.testing.assert_allclose(difference(columns(between), expected), 0.0, atol=1e-12)
    near = curved.primitive_at(a + 1e-7 * np.sign(-a))
    assert np.abs(difference(columns(near), columns(at_a))).max() < 2e-8
    assert np.abs(difference(columns(at_a), columns(at_b))).max() > 0.5
    np.testing.assert_allclose(columns(curved.primitive_at(np.zeros((1, 2))))[:, 0], [3.1, np.log(12.0)])
    np.testing.assert_array_equal(at_a.direction.concentration, 60.0)
    np.testing.assert_array_equal(at_a.speed.shape, 40.0)


def quarter_turn(position):
    return np.stack([-position[..., 1], position[..., 0]], axis=-1)


def test_a_quarter_turn_of_the_traffic_turns_the_map(ring, ring_map):
    """The squares of the grid lie around the origin, so they turn into each other."""
    turned = replace(ring, position=quarter_turn(ring.position), direction=wrap(ring.direction + np.pi / 2))
    other = learn_primitives(turned, tessellation="grid", cell_size=6.0, rng=np.random.default_rng(7))
    assert ring_map.modes.bend.any()
    test = ring_traffic(np.random.default_rng(5), n_vehicles=20)
    mine = ring_map.log_density(test.position, test.direction, test.speed)
    theirs = other.log_density(quarter_turn(test.position), wrap(test.direction + np.pi / 2), test.speed)
    np.testing.assert_allclose(theirs, mine, atol=1e-6)
    assert np.abs(ring_map.log_density(quarter_turn(test.position), test.direction, test.speed) - mine).max() > 1.0


def test_a_ring_is_learned_as_bends_of_one_over_its_radius(ring_map):
    """On a circle the course turns by 1 / radius along the way, so that is the length of every bend."""
    busy = ring_map.n_rows[:-1] > np.median(ring_map.n_rows[:-1])
    bend = np.linalg.norm(ring_map.modes.bend[:-1, 0], axis=-1)[busy]
    np.testing.assert_allclose(bend, 1 / 20.0, rtol=0.1)


def test_a_bend_that_does_not_fit_the_modes_is_refused():
    for name in ("bend", "gain"):
        with pytest.raises(ValueError, match=f"{name}: expected"):
            replace(bent_map(), modes=bent_map().modes._replace(**{name: np.zeros((2, 3, 2))}))
    with pytest.raises(ValueError, match="bend: expected finite"):
        bent_map(bend=(np.nan, 0.0))
