"""Cells laid out block by block: where blocks are, that workers change nothing, and that nothing is lost by it."""

import numpy as np
import pytest
from streets import store_of, street

from dirprim_filter import Tracks, write_tracks
from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives.borrowing import N_LAYOUTS
from dirprim_filter.store import blocks, updating
from dirprim_filter.store.blocks import LEAST_TILES, MOST_THINNED, blocks_of, drawn_places, laid_out_in_blocks
from dirprim_filter.store.lattice import Lattice
from dirprim_filter.store.learning import MOST_STEPS, PLACE_M, at_some_places
from dirprim_filter.store.recorded_ways import EVERYWHERE, sampled
from dirprim_filter.store.steps import passed_place
from dirprim_filter.store.tallies import Tally
from dirprim_filter.store.tiles import TILE_SQUARES, Whereabouts, traffic_of
from dirprim_filter.store.updating import learn_from_store, update_map
from dirprim_filter.store.workers import InProcess
from tessellation import GridTessellation

STATE = ("position", "direction", "speed")
HOW = {"min_vehicles": 1, "fading": None, "seed": 3, "tessellation": "voronoi", "cell_size": 16.0}


class Backwards(InProcess):
    """The last task first."""

    def each(self, work, tasks):
        return super().each(work, tasks[::-1])


@pytest.fixture
def small_blocks(monkeypatch):
    """Of a tile each; what is learned from at once is less than there is."""
    monkeypatch.setattr(blocks, "BLOCK_TILES", 1)
    monkeypatch.setattr(updating, "MOST_STEPS", 4000)


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """Of a street through three tiles."""
    folder = tmp_path_factory.mktemp("store")
    for seed in range(3):
        write_tracks(street(seed, north=0.0, n_vehicles=12), folder / f"{seed}.mcap")
    return store_of(folder / "store", folder, 0, 1, 2)


def learned(store, **options):
    options = {"tessellation": "voronoi"} | options
    return learn_from_store(store, min_vehicles=1, rng=np.random.default_rng(0), **options)


def blocks_in(store):
    recorded = store.recorded()
    tiles = Tally.of(np.array([tile for some in recorded.values() for tile in some]), np.ones((9, 1), np.int64))
    return blocks_of(tiles, 1.0), Whereabouts.of_all(recorded)


def tally(n):
    return Tally.of(np.array(list(n)), np.array(list(n.values()))[:, None])


def test_blocks_are_those_where_vehicles_were():
    every = blocks_of(tally({(0, 0): 1, (7, 7): 5, (8, 0): 1, (-1, -9): 2}), 9.0)
    assert every == [(-8, -16, 8), (0, 0, 8), (8, 0, 8)]
    np.testing.assert_array_equal(every[0].corners(Lattice()), [(-1024.0, -2048.0), (0.0, -1024.0)])


def test_blocks_of_many_steps_are_divided():
    """Until they have at most so many times more than are learned from at once, or are small; all ground stays."""
    n = {(e, k): 10 ** (e // 8) for e in range(24) for k in range(16)}
    n_steps = 150.0 * MOST_STEPS
    every = blocks_of(tally(n), n_steps)
    of = {tile: [b for b in every if len(b.traffic(tally({tile: 1}), rings=0))] for tile in n}
    assert all(len(found) == 1 for found in of.values())
    assert {block.side for block in every} == {2, 4, 8}
    for block in every:
        steps = sum(count for tile, count in n.items() if of[tile] == [block]) * n_steps / sum(n.values())
        assert steps <= MOST_THINNED * MOST_STEPS or block.side == LEAST_TILES
    assert {block.side for block in blocks_of(tally(n), MOST_STEPS)} == {8}


def test_a_block_is_not_divided_where_that_makes_it_no_less():
    """Borders through a junction would cost, and each side would be learned from as few vehicles as before."""
    junction = {(3, 3): 100, (3, 4): 100, (4, 3): 100, (4, 4): 100}
    assert blocks_of(tally(junction), 100.0 * MOST_STEPS) == [(0, 0, 8)]
    two = {(e + i, k + i): n for (e, k), n in junction.items() for i in (-3, 3)}
    assert len(blocks_of(tally(two), 100.0 * MOST_STEPS)) > 1  # the control


def test_traffic_is_by_tiles():
    position = np.array([[0.0, 1.0], [127.0, 127.0], [128.0, 0.0], [-1.0, 300.0]])
    state, _ = Lattice().states(position, np.zeros(4), np.ones(4))
    passed = Tally.of(passed_place(state, Lattice())[:, None], np.array([[3], [2], [1], [7]]))
    found = traffic_of(passed)
    assert {tuple(tile): n for tile, n in zip(found.key.tolist(), found.value[:, 0].tolist(), strict=True)} == {
        (-1, 2): 7, (0, 0): 5, (1, 0): 1,
    }  # fmt: skip


def test_each_block_has_its_own_cells_whoever_lays_them_out_in_whatever_order(store, small_blocks):
    every, there = blocks_in(store)
    assert len(every) == 3
    layouts, again = (laid_out_in_blocks(store, every, there, workers=w, **HOW) for w in (InProcess(), Backwards()))
    assert len(layouts) == 1 + N_LAYOUTS  # those to borrow from too
    for i, (one, other) in enumerate(zip(layouts, again, strict=True)):
        centers = one.cells.centers
        np.testing.assert_array_equal(centers, other.cells.centers)
        np.testing.assert_array_equal(one.cells.region.square, other.cells.region.square)
        assert one.softness == other.softness > 0
        for block in every:
            alone = laid_out_in_blocks(store, [block], there, workers=InProcess(), **HOW)[i].cells.centers
            here = (centers // TILE_SQUARES == (block.east, block.north)).all(axis=1)
            np.testing.assert_array_equal(centers[here], alone)
    with pytest.raises(ValueError, match="expected places that 1000 vehicles passed the same way, got none"):
        laid_out_in_blocks(store, every, there, workers=InProcess(), **HOW | {"min_vehicles": 1000})


def test_nothing_is_lost_by_blocks(store, small_blocks, monkeypatch):
    """Log density of vehicles of other days, in nat; the negative control has cells of one block alone."""
    test = Tracks.concatenate([street(seed, north=0.0) for seed in range(10, 13)])

    def density(m):
        return float(m.log_density(test.position, test.direction, test.speed).mean())

    tiled = learned(store)
    assert update_map(tiled, store).n_cells == 0
    every, there = blocks_in(store)
    alone, *_ = laid_out_in_blocks(store, every[:1], there, workers=InProcess(), **HOW)
    one = learned(store, tessellation=alone.cells)
    monkeypatch.setattr(updating, "laid_out_in_blocks", None)
    with pytest.raises(TypeError):  # cells were laid out in blocks
        learned(store)
    monkeypatch.setattr(updating, "MOST_STEPS", 10**9)
    whole = learned(store)
    assert whole.tessellation.n_cells != tiled.tessellation.n_cells
    assert density(tiled) > density(whole) - 0.1
    assert density(one) < density(whole) - 0.5


def test_held_out_vehicles_choose_at_some_places():
    """Squares where cells are, drawn evenly, until they have their share of the traffic."""
    centers = np.array([[10.0, 10.0], [300.0, 10.0], [310.0, 20.0], [-5.0, 500.0]])
    traffic = tally({(0, 0): 1, (1, 1): 1, (2, 0): 96, (-1, 3): 1, (9, 9): 1})  # the last is of no cell

    def drawn(share, seed=0):
        return drawn_places(centers, traffic, Lattice(), None, share=share, rng=np.random.default_rng(seed))

    places = [(-1.0, 1.0), (0.0, 0.0), (1.0, 0.0)]
    assert [tuple(place.low / PLACE_M) for place in drawn(1.0)] == places
    assert all((place.high - place.low == PLACE_M).all() for place in drawn(1.0))
    firsts = {tuple(tuple(place.low / PLACE_M) for place in drawn(0.01, seed)) for seed in range(60)}
    assert firsts == {(place,) for place in places}
    for seed in range(20):  # the busy one is among them, however many quiet ones came before
        assert places[2] in {tuple(place.low / PLACE_M) for place in drawn(0.5, seed)}


def test_strengths_of_hours_are_chosen_by_all_rows_of_some_places():
    position = np.random.default_rng(1).uniform(-2000.0, 2000.0, (20_000, 2))
    place = [tuple(each) for each in np.floor(position / PLACE_M)]
    assert at_some_places(position, 20_000, rng=np.random.default_rng(0)).all()
    some = at_some_places(position, 5000, rng=np.random.default_rng(0))
    assert 5000 <= some.sum() < 5200  # a place has 80
    chosen = {each for each, taken in zip(place, some, strict=True) if taken}
    assert [each in chosen for each in place] == some.tolist()
    busy = np.repeat([[0.0, 0.0], [300.0, 0.0]], [1000, 5], axis=0)  # a quiet place alone would choose by five rows
    drawn = [at_some_places(busy, 500, rng=np.random.default_rng(seed)).sum() for seed in range(20)]
    assert set(drawn) == {1000, 1005}


@pytest.mark.parametrize("cell_size", [16.0, None])
def test_a_grid_in_blocks_has_the_squares_where_vehicles_were(store, small_blocks, cell_size):
    every, there = blocks_in(store)
    how = HOW | {"tessellation": "grid", "cell_size": cell_size}
    grid, *lenders = laid_out_in_blocks(store, every, there, workers=InProcess(), **how)
    assert [type(other.cells).__name__ for other in lenders] == ["VoronoiTessellation"] * N_LAYOUTS
    assert grid.cells.cell_size in ((cell_size,) if cell_size else LearningConfig().cell_sizes)
    (whole,) = sampled(store, [EVERYWHERE], most_rows=10**9, min_vehicles=1)
    covering = GridTessellation.covering(whole.ways.position, cell_size=grid.cells.cell_size)
    np.testing.assert_allclose(grid.cells.centers, covering.centers)
    part, *_ = laid_out_in_blocks(store, every[:1], there, workers=InProcess(), **how)
    assert part.cells.n_cells < grid.cells.n_cells / 2  # the control
    in_blocks = learned(store, tessellation="grid", cell_size=cell_size)
    assert in_blocks.tessellation.n_cells == grid.cells.n_cells or cell_size is None
    assert np.isfinite(in_blocks.log_density(*(getattr(whole.ways, name) for name in STATE))).all()


def test_given_cells_and_numbers_of_cells_are_not_laid_out_in_blocks(store, small_blocks, monkeypatch):
    monkeypatch.setattr(updating, "laid_out_in_blocks", None)
    cells = GridTessellation.covering(np.array([[0.0, 0.0], [300.0, 0.0]]), cell_size=16.0)
    assert learned(store, tessellation=cells).tessellation.n_cells == 2
    assert 20 <= learned(store, n_cells=30).tessellation.n_cells <= 30
