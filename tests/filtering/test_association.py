"""Gates and assignments against enumeration."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dirprim_filter.filtering.association import MOST_NEAR, best_pairs, gated
from situations import TRUSTING, one_cell_map, seen_at, tracker_of


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
    found = best_pairs(one, other, gain)
    assert np.unique(one[found]).size == np.unique(other[found]).size == found.size
    full = np.full((n, m), -np.inf)
    full[one, other] = gain
    assert (gain[found] > 0).all()
    assert gain[found].sum() == pytest.approx(best_by_enumeration(full), abs=1e-9)
    apart = np.arange(33)[:, None] * 10  # many that have nothing to do with each other are assigned as each by itself
    gains = np.tile(gain, apart.size)
    repeated = best_pairs((one + apart).ravel(), (other + apart).ravel(), gains)
    assert gains[repeated].sum() == pytest.approx(apart.size * gain[found].sum())


def test_gates_hold_what_a_loop_over_all_pairs_finds():
    rng = np.random.default_rng(0)
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


def test_of_a_crowd_each_track_is_compared_with_the_nearest_alone():
    rng = np.random.default_rng(0)
    mean, position = rng.normal(0, 0.1, (2, 600, 2))
    one = np.broadcast_to(np.eye(2), (600, 2, 2))
    found = gated(mean, one, position, one, gate=9.0)
    away = np.linalg.norm(mean[:, None] - position, axis=-1)
    nearest = np.argsort(away, axis=1)[:, :MOST_NEAR]
    assert set(zip(found.one.tolist(), found.other.tolist(), strict=True)) == {
        (t, d) for t, of in enumerate(nearest.tolist()) for d in of
    }


def test_of_two_that_pass_each_other_the_course_says_which_is_which():
    """Each is seen nearer to where the other was expected; the control, without courses, takes them for the other."""

    def across(**known):
        """How far each comes across in the last frame, in which they have changed sides."""
        tracker = tracker_of(one_cell_map(concentration=0.0, shape=20.0).without_places(), tracking=TRUSTING)
        sides = [[1.0, 1.0 if i < 10 else -1.0] for i in range(11)]
        places = [np.array([[-10.0 + i, 0.4], [10.0 - i, -0.4]]) * side for i, side in enumerate(sides)]
        found = [tracker.step(seen_at(0.1 * i, place, **known)) for i, place in enumerate(places)]
        return np.abs(found[-1].position[:, 1] - found[-2].position[:, 1])

    assert (across(direction=[0.0, np.pi], speed=[10.0, 10.0]) > 0.1).all()
    assert (across() < 0.05).all()
