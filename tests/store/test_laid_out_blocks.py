"""Cells laid out block by block: where blocks are, that workers change nothing, and that nothing is lost by it."""

import numpy as np
import pytest
from streets import store_of, street

from dirprim_filter import Tracks, write_tracks
from dirprim_filter.primitives.borrowing import N_LAYOUTS
from dirprim_filter.store import blocks, updating
from dirprim_filter.store.blocks import blocks_of, drawn_places, laid_out_in_blocks
from dirprim_filter.store.learning import PLACE_M, at_some_places
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
    layouts, again = (laid_out_in_blocks(store, every, there, workers=w, **HOW) for w in (InProcess(), Backwards()))
    assert len(layouts) == 1 + N_LAYOUTS  # those to borrow from too
    for i, (one, other) in enumerate(zip(layouts, again, strict=True)):
        centers = one.cells.centers
        np.testing.assert_array_equal(centers, other.cells.centers)
        np.testing.assert_array_equal(one.cells.region.square, other.cells.region.square)
        assert one.softness == other.softness > 0
        for block in every:
            alone = laid_out_in_blocks(store, [block], there, workers=InProcess(), **HOW)[i].cells.centers
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
    """Squares where cells are, drawn evenly."""
    centers = np.array([[10.0, 10.0], [300.0, 10.0], [310.0, 20.0], [-5.0, 500.0]])

    def drawn(share, seed=0):
        return drawn_places(centers, None, share=share, rng=np.random.default_rng(seed))

    places = drawn(1.0)
    assert [tuple(place.low / PLACE_M) for place in places] == [(-1.0, 1.0), (0.0, 0.0), (1.0, 0.0)]
    assert all((place.high - place.low == PLACE_M).all() for place in places)
    assert len(drawn(0.01)) == 1
    assert {tuple(drawn(0.5, seed)[0].low) for seed in range(40)} == {tuple(place.low) for place in places}


def test_strengths_of_hours_are_chosen_by_all_rows_of_some_places():
    position = np.random.default_rng(1).uniform(-2000.0, 2000.0, (20_000, 2))
    place = [tuple(each) for each in np.floor(position / PLACE_M)]
    assert at_some_places(position, 20_000, rng=np.random.default_rng(0)).all()
    some = at_some_places(position, 5000, rng=np.random.default_rng(0))
    assert 4800 < some.sum() <= 5000  # a place has 80
    chosen = {each for each, taken in zip(place, some, strict=True) if taken}
    assert [each in chosen for each in place] == some.tolist()
    busy = np.zeros((1000, 2))
    assert at_some_places(busy, 10, rng=np.random.default_rng(0)).all()  # one place at least


def test_given_cells_and_numbers_of_cells_are_not_laid_out_in_blocks(store, small_blocks, monkeypatch):
    monkeypatch.setattr(updating, "laid_out_in_blocks", None)
    assert learned(store, tessellation="grid", cell_size=16.0).tessellation.cell_size == 16.0
    assert 20 <= learned(store, n_cells=30).tessellation.n_cells <= 30
