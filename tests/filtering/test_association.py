"""Gates and assignments against enumeration; existence against a simulated chain."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dirprim_filter.config import TrackingConfig
from dirprim_filter.filtering import existence
from dirprim_filter.filtering.association import Pairs, best_assignment, gated, within


def best_by_enumeration(table):
    """The largest sum of a choice of at most one positive entry from each row and each column."""
    best = 0.0
    for choice in product(range(-1, table.shape[1]), repeat=table.shape[0]):
        taken = [j for j in choice if j >= 0]
        if len(set(taken)) == len(taken):
            best = max(best, sum(table[i, j] for i, j in enumerate(choice) if j >= 0))
    return best


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_the_assignment_is_the_best_of_all(data):
    n, m = data.draw(st.integers(0, 4)), data.draw(st.integers(0, 4))
    cells = st.one_of(st.none(), st.floats(-5, 5))
    table = [[data.draw(cells) for _ in range(m)] for _ in range(n)]
    listed = [(i, j, table[i][j]) for i in range(n) for j in range(m) if table[i][j] is not None]
    one, other = (np.array([row[k] for row in listed], dtype=np.int64) for k in (0, 1))
    gain = np.array([row[2] for row in listed], dtype=float)
    found = best_assignment(Pairs(one, other), gain)
    assert np.unique(found.one).size == found.one.size
    assert np.unique(found.other).size == found.other.size
    full = np.full((n, m), -np.inf)
    full[one, other] = gain
    got = full[found.one, found.other]
    assert (got > 0).all()
    assert got.sum() == pytest.approx(best_by_enumeration(full), abs=1e-9)


def test_the_nearest_to_one_may_be_anothers():
    """Greedy choice would give the first track its nearest, and the second nothing."""
    pairs = Pairs(np.array([0, 0, 1]), np.array([0, 1, 0]))
    found = best_assignment(pairs, np.array([5.0, 4.0, 4.5]))
    assert list(zip(found.one.tolist(), found.other.tolist(), strict=True)) == [(0, 1), (1, 0)]


@pytest.mark.parametrize("seed", range(3))
def test_gates_hold_what_a_loop_over_all_pairs_finds(seed):
    rng = np.random.default_rng(seed)
    mean, position = rng.uniform(0, 30, (20, 2)), rng.uniform(0, 30, (50, 2))
    root = rng.normal(0, 1.5, (20, 2, 2))
    covariance = root @ root.swapaxes(1, 2) + 0.1 * np.eye(2)
    noise = np.broadcast_to(0.25 * np.eye(2), (50, 2, 2)).copy()
    noise[::3] *= 4
    found = gated(mean, covariance, position, noise, gate=9.0)
    expected = set()
    for t, d in product(range(20), range(50)):
        off = position[d] - mean[t]
        if off @ np.linalg.inv(covariance[t] + noise[d]) @ off <= 9.0:
            expected.add((t, d))
    assert set(zip(found.one.tolist(), found.other.tolist(), strict=True)) == expected
    assert 20 < len(expected) < 500


def test_points_within_reach_are_those_of_a_loop():
    rng = np.random.default_rng(0)
    one, other, reach = rng.uniform(0, 20, (15, 2)), rng.uniform(0, 20, (25, 2)), rng.uniform(0, 8, 15)
    found = within(one, other, reach=reach)
    near = np.linalg.norm(one[:, None] - other[None], axis=-1) <= reach[:, None]
    assert set(zip(found.one.tolist(), found.other.tolist(), strict=True)) == set(map(tuple, np.argwhere(near)))


def test_nobody_and_nothing_give_no_pair():
    none, some = np.empty((0, 2)), np.zeros((3, 2))
    eye = np.tile(np.eye(2), (3, 1, 1))
    for found in (
        gated(none, eye[:0], some, eye, gate=9.0), gated(some, eye, none, eye[:0], gate=9.0),
        within(none, some, reach=np.empty(0)), within(some, none, reach=np.ones(3)),
        best_assignment(Pairs(np.array([0]), np.array([0])), np.array([0.0])),
    ):  # fmt: skip
        assert found.one.size == found.other.size == 0


def test_time_moves_existence_as_a_simulated_chain_does():
    config = TrackingConfig(occlusion_rate=0.3, reappearance_rate=0.6, departure_rate=0.2)
    n, dt_s, steps = 200_000, 0.01, 150
    rng = np.random.default_rng(0)
    state = np.zeros(n, np.int64)
    for _ in range(steps):
        u = rng.random(n)
        leaves = u < config.departure_rate * dt_s
        moves = (u >= config.departure_rate * dt_s) & (u < (config.departure_rate + np.where(state, 0.6, 0.3)) * dt_s)
        state = np.where(state == 2, 2, np.where(leaves, 2, np.where(moves, 1 - state, state)))
    simulated = np.bincount(state, minlength=3) / n
    expected = existence.later(np.array([[1.0, 0.0, 0.0]]), steps * dt_s, config)[0]
    tolerance = 4 * np.sqrt(0.25 / n) + 2 * dt_s * 0.3  # of the draw, and of the chain's coarse steps
    np.testing.assert_allclose(simulated, expected, atol=tolerance)
    other = existence.later(np.array([[1.0, 0.0, 0.0]]), 1.3 * steps * dt_s, config)[0]
    assert np.abs(simulated - other).max() > tolerance


def test_existence_does_not_depend_on_how_finely_time_is_cut():
    config = TrackingConfig()
    start = np.array([[0.6, 0.3, 0.1], [0.0, 1.0, 0.0]])
    once, often = existence.later(start, 2.0, config), start
    for _ in range(40):
        often = existence.later(often, 0.05, config)
    np.testing.assert_allclose(once, often, rtol=1e-10)
    np.testing.assert_allclose(once.sum(axis=1), 1.0)


def test_hits_and_misses_are_bayes_rule():
    config = TrackingConfig(detection_probability=0.8, clutter_density=1e-3)
    before = np.array([[0.5, 0.2, 0.3]])
    hit = existence.after_hit(before, np.log([0.05]), config)[0]
    assert hit[0] == pytest.approx(0.5 * 0.8 * 0.05 / (0.5 * 0.8 * 0.05 + 0.3 * 1e-3))
    assert hit[1] == 0
    miss = existence.after_miss(before, config)[0]
    np.testing.assert_allclose(miss, np.array([0.1, 0.2, 0.3]) / 0.6)


def test_who_is_unseen_fades_but_not_at_once():
    config = TrackingConfig(occlusion_rate=0.05, departure_rate=0.01, reappearance_rate=0.33)
    fades = existence.unseen_for(np.array([0.0, 0.1, 3.0, 20.0]), config)
    assert fades[0] == 1.0
    assert (np.diff(fades) < 0).all()
    assert fades[2] > 0.5 > fades[3]
