"""Cells laid out block by block: where blocks are, that workers change nothing, and that nothing is lost by it."""

import numpy as np
import pytest
from streets import store_of, street

from dirprim_filter import Tracks, write_tracks
from dirprim_filter.store import blocks, updating
from dirprim_filter.store.blocks import blocks_of, laid_out_in_blocks
from dirprim_filter.store.tiles import TILE_SQUARES, Whereabouts
from dirprim_filter.store.updating import learn_from_store, update_map
from dirprim_filter.store.workers import InProcess

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
    there = Whereabouts.of_all(store.recorded())
    return blocks_of(there), there


def test_blocks_are_those_of_tiles():
    there = Whereabouts.of_all({"one": [[0, 0], [7, 7]], "other": [[8, 0], [-1, -9]]})
    assert blocks_of(there) == [(-1, -2), (0, 0), (1, 0)]


def test_each_block_has_its_own_cells_whoever_lays_them_out_in_whatever_order(store, small_blocks):
    every, there = blocks_in(store)
    assert len(every) == 3
    whole, again = (laid_out_in_blocks(store, every, there, workers=each, **HOW) for each in (InProcess(), Backwards()))
    centers = whole.cells.centers
    np.testing.assert_array_equal(centers, again.cells.centers)
    np.testing.assert_array_equal(whole.cells.region.square, again.cells.region.square)
    assert whole.softness == again.softness
    for block in every:
        alone = laid_out_in_blocks(store, [block], there, workers=InProcess(), **HOW).cells.centers
        np.testing.assert_array_equal(centers[(centers // TILE_SQUARES == block).all(axis=1)], alone)
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
    alone = laid_out_in_blocks(store, every[:1], there, workers=InProcess(), **HOW)
    one = learned(store, tessellation=alone.cells)
    monkeypatch.setattr(updating, "MOST_STEPS", 10**9)
    monkeypatch.setattr(updating, "laid_out_in_blocks", None)
    whole = learned(store)
    assert whole.tessellation.n_cells != tiled.tessellation.n_cells
    assert density(tiled) > density(whole) - 0.1
    assert density(one) < density(whole) - 0.5


def test_given_cells_and_numbers_of_cells_are_not_laid_out_in_blocks(store, small_blocks, monkeypatch):
    monkeypatch.setattr(updating, "laid_out_in_blocks", None)
    assert learned(store, tessellation="grid", cell_size=16.0).tessellation.cell_size == 16.0
    assert 20 <= learned(store, n_cells=30).tessellation.n_cells <= 30
