"""Laws of transitions: those of a walk that is known cell by cell, none lost, none made up."""

import itertools
from dataclasses import replace

import numpy as np

from dirprim_filter.primitives.journeys import Journeys
from dirprim_filter.primitives.transitions import cell_transitions
from situations import one_cell_map
from tessellation import OUTSIDE, GridTessellation


def on_grid(journeys, *, n=6, side=10.0):
    """A map of n by n squares with these journeys."""
    one = one_cell_map()
    cells = GridTessellation(origin=np.zeros(2), cell_size=side, n_x=n, n_y=n, square=np.arange(n * n, dtype=np.int64))
    row = np.zeros(n * n + 1, np.int64)
    return replace(
        one, tessellation=cells, direction=one.direction[row], speed=one.speed[row], n_rows=np.ones(row.size, np.int64),
        bend=np.empty(0), gain=np.empty(0), journeys=journeys,
    )  # fmt: skip


def journeys_along(*ways):
    """Journeys through points, half a second from each to the next."""
    position = np.concatenate([np.asarray(way, float) for way in ways])
    duration = np.concatenate([[0.5] * (len(way) - 1) + [0.0] for way in ways])
    return Journeys(
        position=position, direction=np.zeros(len(position)), speed=np.ones(len(position)), duration=duration
    )


def test_a_way_across_three_cells_in_one_row_is_two_transitions():
    learned = on_grid(journeys_along([(5, 5), (25, 5)], [(5, 5), (5, 15)], [(5, 5), (15, 5), (15, 15)]))
    cell = learned.tessellation.cell_of
    a, b, c, d, e = (int(cell(np.array(p))) for p in ((5.0, 5.0), (15.0, 5.0), (25.0, 5.0), (5.0, 15.0), (15.0, 15.0)))
    found = cell_transitions(learned)
    told = {(int(s), int(t)): (int(n), float(p)) for s, t, n, p in zip(*found, strict=True)}
    assert told == {(a, b): (2, 2 / 3), (a, d): (1, 1 / 3), (b, c): (1, 1 / 2), (b, e): (1, 1 / 2)}


def test_they_are_those_of_a_walk_looked_at_much_more_finely():
    rng = np.random.default_rng(3)
    walks = [np.clip(rng.uniform(5, 55, 2) + np.cumsum(rng.normal(0, 3, (40, 2)), axis=0), -10, 70) for _ in range(20)]
    learned = on_grid(journeys_along(*walks))
    expected = {}
    for walk in walks:
        for start, end in itertools.pairwise(walk):
            cells = learned.tessellation.cell_of(start + np.linspace(0, 1, 2000)[:, None] * (end - start))
            for s, t in itertools.pairwise(cells):
                if s != t and OUTSIDE not in (s, t):
                    expected[int(s), int(t)] = expected.get((int(s), int(t)), 0) + 1
    found = cell_transitions(learned)
    assert set(zip(found.start.tolist(), found.end.tolist(), strict=True)) >= {p for p, n in expected.items() if n > 3}
    # A corner that is cut by less than a step is passed over, and taken for a way from corner to corner.
    assert abs(found.n.sum() - sum(expected.values())) < 0.05 * sum(expected.values())
    np.testing.assert_allclose(np.bincount(found.start, weights=found.share)[np.unique(found.start)], 1.0)


def test_no_journeys_no_transitions():
    found = cell_transitions(one_cell_map())
    assert found.n.size == found.share.size == 0
    assert cell_transitions(one_cell_map().without_places()).n.size == 0
