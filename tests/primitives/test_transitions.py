"""Laws of transitions: those that vehicles were seen to make, of all manoeuvres of a cell together."""

import itertools
from collections import Counter
from dataclasses import replace

import numpy as np

from dirprim_filter.primitives.transitions import cell_transitions
from situations import one_cell_map, with_ways
from tessellation import OUTSIDE, GridTessellation


def three_cells():
    one, row = one_cell_map(), np.zeros(4, np.int64)
    cells = GridTessellation(origin=np.zeros(2), cell_size=10.0, n_x=3, n_y=1, square=np.arange(3, dtype=np.int64))
    return replace(
        one, tessellation=cells, direction=one.direction[row], speed=one.speed[row], n_rows=np.ones(4, np.int64),
        bend=np.empty(0), gain=np.empty(0), motion=None,
    )  # fmt: skip


def reported(found):
    return {(int(s), int(t)): (float(n), float(p)) for s, t, n, p in zip(*found, strict=True)}


def test_manoeuvres_of_a_cell_count_together_and_those_inside_it_not():
    learned = with_ways(
        three_cells(),
        cell=[0, 0, 1, 2],
        ways=[(0, 2, 3.0), (0, 3, 1.0), (0, 1, 9.0), (1, 2, 4.0), (2, 0, 2.0), (3, 2, 0.0)],
    )
    assert reported(cell_transitions(learned)) == {(0, 1): (7.0, 7 / 8), (0, 2): (1.0, 1 / 8), (1, 0): (2.0, 1.0)}


def test_what_follows_a_manoeuvre_of_no_place_is_from_no_cell():
    learned = with_ways(three_cells(), cell=[0, 0, 1, 2], ways=[(0, 2, 3.0), (4, 1, 5.0)])
    assert reported(cell_transitions(learned)) == {(0, 1): (3.0, 1.0)}


def test_they_are_those_of_the_tracks_that_were_learned_from(ring, ring_map):
    """Beside those that the thinned rows' splines cut differently: a tenth of a second past a border, and corners."""
    expected = Counter()
    for track_id in np.unique(ring.track_id):
        cell = ring_map.tessellation.cell_of(ring.position[ring.track_id == track_id])
        expected.update((int(s), int(t)) for s, t in itertools.pairwise(cell) if s != t and OUTSIDE not in (s, t))
    found = reported(cell_transitions(ring_map))
    assert {pair for pair, n in expected.items() if n > 3} <= set(found)
    off = sum(abs(found.get(pair, (0.0,))[0] - expected[pair]) for pair in set(found) | set(expected))
    assert off < 0.05 * expected.total()
    cells = np.unique([s for s, _ in found])
    shares = [sum(share for (s, _), (_, share) in found.items() if s == cell) for cell in cells]
    np.testing.assert_allclose(shares, 1.0)


def test_a_map_without_places_keeps_none(ring_map):
    assert cell_transitions(ring_map).n.size > 0
    assert cell_transitions(ring_map.without_places()).n.size == 0
    assert cell_transitions(replace(ring_map, motion=None)).n.size == 0
