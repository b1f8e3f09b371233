"""Where cells are, block by block: of more steps than can be learned from at once, each block's by themselves.

A block of many times more is divided in four, or too few vehicles of its quiet streets would be among those drawn.
A block is laid out from what vehicles did in it and within `HALO_M` around it, and keeps the cells whose centres lie in
it. All blocks' cells together are the map's. What held-out vehicles choose for all of them is chosen at some places,
of all vehicles there: of few vehicles everywhere it would be chosen for cells that know little.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives.assembly import Layout
from dirprim_filter.primitives.choice import REACH_M
from dirprim_filter.primitives.learning import lay_out
from dirprim_filter.store.fading import Fading
from dirprim_filter.store.lattice import Lattice
from dirprim_filter.store.learning import MOST_STEPS, PLACE_M
from dirprim_filter.store.recorded_ways import Box, recordings_at, sampled
from dirprim_filter.store.store import Store
from dirprim_filter.store.tallies import Tally
from dirprim_filter.store.tiles import HALO_M, TILE_SQUARES, Whereabouts
from dirprim_filter.store.workers import Workers
from tessellation import GridTessellation, VoronoiTessellation

logger = logging.getLogger(__name__)

BLOCK_TILES = 8
"""Side, a kilometre: large beside the halo."""
LEAST_TILES = 2
"""Side of the smallest: borders cost as well."""
MOST_THINNED = 4
"""A block of so many times more steps than are learned from at once is divided,"""
MUCH_LESS = 0.7
"""if each quarter is laid out from this share of them at most: not where all is at one junction."""
SEED = 1 << 31
"""Makes numbers of blocks positive."""


class Block(NamedTuple):
    """A square of tiles."""

    east: int  # of the tile in its south-west corner
    north: int
    side: int  # tiles

    @property
    def quarters(self) -> list[Block]:
        """In four."""
        half = self.side // 2
        return [Block(self.east + i * half, self.north + j * half, half) for i in range(2) for j in range(2)]

    def traffic(self, traffic: Tally, rings: int) -> Tally:
        """Of its tiles and those in so many rings around it."""
        low = np.array([self.east, self.north]) - rings
        near = ((traffic.key >= low) & (traffic.key < low + self.side + 2 * rings)).all(axis=1)
        return Tally(key=traffic.key[near], value=traffic.value[near])

    def corners(self, lattice: Lattice) -> tuple[FloatArray, FloatArray]:
        """(2,) south-west and north-east, metres."""
        tile_m, low = TILE_SQUARES * lattice.square_m, np.array([self.east, self.north])
        return low * tile_m, (low + self.side) * tile_m


class LaidOut(NamedTuple):
    """The cells of a block."""

    block: Block
    layouts: list[tuple[FloatArray, float]]  # centres (k, 2), metres, and softness: of its cells, and to borrow from
    squares: dict[float, FloatArray]  # by their side, metres: the centres (m, 2) of those that hold rows of the block
    cell_size: float | None  # of a grid

    def layout(self, i: int) -> tuple[FloatArray, float]:
        """The i-th; its own cells where it has no others to borrow from."""
        return self.layouts[i] if i < len(self.layouts) else self.layouts[0]


def blocks_of(traffic: Tally, n_steps: float) -> list[Block]:
    """The blocks where vehicles were, in order.

    Args:
        traffic: by tiles, see `tiles.traffic_of`.
        n_steps: of all of it.
    """
    most = MOST_THINNED * MOST_STEPS / n_steps * float(traffic.value.sum())
    corners = np.unique(traffic.key // BLOCK_TILES, axis=0) * BLOCK_TILES
    whole = [Block(east, north, BLOCK_TILES) for east, north in corners.tolist()]
    return sorted(each for block in whole for each in _divided(block, traffic, most))


def _divided(block: Block, traffic: Tally, most: float) -> list[Block]:
    """A block of more traffic than `most` in parts, if that makes it less; those where vehicles were."""
    near = block.traffic(traffic, rings=1)
    own = block.traffic(near, rings=0)
    if not len(own):
        return []
    if own.value.sum() <= most or block.side <= LEAST_TILES:
        return [block]
    busiest = max(quarter.traffic(near, rings=1).value.sum() for quarter in block.quarters)
    if busiest > MUCH_LESS * near.value.sum():
        return [block]
    return [each for quarter in block.quarters for each in _divided(quarter, near, most)]


def laid_out_in_blocks(
    store: Store, blocks: list[Block], there: Whereabouts, *, workers: Workers, min_vehicles: int,
    fading: Fading | None, seed: int, **options: Any,
) -> list[Layout]:  # fmt: skip
    """The cells of all blocks, and layouts of others to borrow from.

    Args:
        store: of recordings.
        blocks: of its tiles.
        there: its recordings.
        workers: who lay them out.
        min_vehicles: places that fewer passed the same way have none.
        fading: by which older ways are left out.
        seed: of what is drawn.
        options: of `lay_out`.

    Raises:
        ValueError: no block has a place that so many vehicles passed.
        RecordingError: a recording is damaged.
        OSError: one cannot be read.
    """
    work = partial(_laid_out, store=store, min_vehicles=min_vehicles, fading=fading, seed=seed, options=options)
    lattice = store.config.lattice
    tasks = [(block, recordings_at([_box(block, lattice, fading)], there, lattice)) for block in blocks]
    done = sorted((part for part in workers.each(work, tasks) if part is not None), key=lambda part: part.block)
    if not done:
        raise ValueError(
            f"{store.path}: expected places that {min_vehicles} vehicles passed the same way, got none; add "
            "recordings, or ask for fewer vehicles"
        )
    layouts = [_together(done, i) for i in range(max(len(part.layouts) for part in done))]
    logger.info("%d cells laid out in %d blocks", layouts[0].cells.n_cells, len(done))
    return layouts


def _together(done: list[LaidOut], i: int) -> Layout:
    """The i-th layouts of all blocks as one."""
    centers, softness = zip(*(part.layout(i) for part in done), strict=True)
    n_cells = [len(some) for some in centers]
    sizes = [part.cell_size for part in done if part.cell_size is not None]
    if i == 0 and sizes:
        size = _of_most(sizes, n_cells)
        squares = np.concatenate([part.squares[size] for part in done])
        return Layout(GridTessellation.covering(squares, cell_size=size), 0.0)
    covered = np.concatenate([part.squares[REACH_M] for part in done])
    cells = VoronoiTessellation.covering(covered, generators=np.concatenate(centers), reach=REACH_M)
    return Layout(cells, _of_most(softness, n_cells))


def _of_most(chosen: Sequence[float], n_cells: list[int]) -> float:
    """What the blocks of most cells have chosen."""
    found, of = np.unique(chosen, return_inverse=True)
    return float(found[np.bincount(of, n_cells).argmax()])


def drawn_places(
    centers: FloatArray, traffic: Tally, lattice: Lattice, fading: Fading | None, *, share: float,
    rng: np.random.Generator,
) -> list[Box]:  # fmt: skip
    """Places drawn evenly of those where cells are, until they have their share of the traffic.

    Args:
        centers: (n, 2) of the cells, metres.
        traffic: by tiles, see `tiles.traffic_of`.
        lattice: of the tiles.
        fading: by which older ways are left out.
        share: of all traffic.
        rng: draws them.
    """
    places = np.unique(np.floor(centers / PLACE_M), axis=0)
    passed = dict.fromkeys(map(tuple, places.tolist()), 0)
    tile_place = np.floor((traffic.key + 0.5) * (TILE_SQUARES * lattice.square_m / PLACE_M))
    for place, n in zip(map(tuple, tile_place.tolist()), traffic.value[:, 0].tolist(), strict=True):
        passed[place] = passed.get(place, 0) + n
    order = rng.permutation(len(places))
    n_passed = np.cumsum([passed[tuple(place)] for place in places[order].tolist()])
    n_drawn = int(np.searchsorted(n_passed, share * traffic.value.sum())) + 1
    return [Box(place * PLACE_M, (place + 1) * PLACE_M, fading) for place in places[np.sort(order[:n_drawn])]]


def _box(block: Block, lattice: Lattice, fading: Fading | None) -> Box:
    low, high = block.corners(lattice)
    return Box(low - HALO_M, high + HALO_M, fading)


def _laid_out(
    task: tuple[Block, list[tuple[int, str]]], *, store: Store, min_vehicles: int, fading: Fading | None, seed: int,
    options: dict[str, Any],
) -> LaidOut | None:  # fmt: skip
    """A block, by its recordings; None of one without places that so many passed."""
    block, recordings = task
    low, high = block.corners(store.config.lattice)
    box = _box(block, store.config.lattice, fading)
    (sample,) = sampled(store, [box], most_rows=MOST_STEPS, min_vehicles=min_vehicles, recordings=recordings)
    here = _inside(sample.ways.position, low, high)
    if not len(here):
        return None
    rng = np.random.default_rng((seed, block.east + SEED, block.north + SEED, block.side))
    found = lay_out(sample.ways.visible().tracks, rng=rng, **options)
    layouts = [(_inside(each.cells.centers, low, high), each.softness) for each in found]
    cells, sizes = found[0].cells, {REACH_M}
    cell_size = cells.cell_size if isinstance(cells, GridTessellation) else None
    if cell_size is not None:
        sizes |= {cell_size, *(options.get("config") or LearningConfig()).cell_sizes}
    squares = {size: GridTessellation.covering(here, cell_size=size).centers for size in sizes}
    return LaidOut(block, layouts, squares, cell_size)


def _inside(position: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Those of (n, 2) that are."""
    return position[((position >= low) & (position < high)).all(axis=1)]
