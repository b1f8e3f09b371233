"""Where cells are, block by block: of more steps than can be learned from at once, each block's by themselves.

A block is laid out from what vehicles did in it and within `HALO_M` around it, and keeps the cells whose centres lie in
it. All blocks' cells together are the map's. What held-out vehicles choose for all of them is chosen at some places,
of all vehicles there: of few vehicles everywhere it would be chosen for cells that know little.
"""

from __future__ import annotations

import logging
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.primitives.assembly import Layout
from dirprim_filter.primitives.choice import REACH_M
from dirprim_filter.primitives.learning import lay_out
from dirprim_filter.store.fading import Fading
from dirprim_filter.store.lattice import Lattice
from dirprim_filter.store.learning import MOST_STEPS, PLACE_M
from dirprim_filter.store.recorded_ways import Box, recordings_at, sampled
from dirprim_filter.store.store import Store
from dirprim_filter.store.tiles import HALO_M, TILE_SQUARES, Tile, Whereabouts
from dirprim_filter.store.workers import Workers
from tessellation import GridTessellation, VoronoiTessellation

logger = logging.getLogger(__name__)

BLOCK_TILES = 8
"""Side, a kilometre: large beside the halo, and small beside what is learned from at once."""
SEED = 1 << 31
"""Makes numbers of blocks positive."""


class LaidOut(NamedTuple):
    """A block."""

    block: Tile
    layouts: list[tuple[FloatArray, float]]  # centres (k, 2), metres, and softness: of its cells, and to borrow from
    covered: FloatArray  # (m, 2) metres, a place in each square that cells cover

    def layout(self, i: int) -> tuple[FloatArray, float]:
        """The i-th; its own cells where it has no others to borrow from."""
        return self.layouts[i] if i < len(self.layouts) else self.layouts[0]


def blocks_of(there: Whereabouts) -> list[Tile]:
    """The blocks that recordings have steps in, in order."""
    return sorted({(east, north) for east, north in (there.tile // BLOCK_TILES).tolist()})


def laid_out_in_blocks(
    store: Store, blocks: list[Tile], there: Whereabouts, *, workers: Workers, min_vehicles: int,
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
    covered = np.concatenate([part.covered for part in done])
    every = range(max(len(part.layouts) for part in done))
    layouts = [_together([part.layout(i) for part in done], covered) for i in every]
    logger.info("%d cells laid out in %d blocks", layouts[0].cells.n_cells, len(done))
    return layouts


def _together(parts: list[tuple[FloatArray, float]], covered: FloatArray) -> Layout:
    """Centres of all blocks, and the softness of most."""
    centers, softness = zip(*parts, strict=True)
    found, of = np.unique(softness, return_inverse=True)
    n_cells = np.bincount(of, [len(some) for some in centers])
    cells = VoronoiTessellation.covering(covered, generators=np.concatenate(centers), reach=REACH_M)
    return Layout(cells, float(found[n_cells.argmax()]))


def drawn_places(centers: FloatArray, fading: Fading | None, *, share: float, rng: np.random.Generator) -> list[Box]:
    """Places drawn evenly of those where cells are.

    Args:
        centers: (n, 2) of the cells, metres.
        fading: by which older ways are left out.
        share: of the places; one at least.
        rng: draws them.
    """
    places = np.unique(np.floor(centers / PLACE_M), axis=0)
    drawn = places[np.sort(rng.permutation(len(places))[: max(1, int(share * len(places)))])]
    return [Box(place * PLACE_M, (place + 1) * PLACE_M, fading) for place in drawn]


def _side_m(lattice: Lattice) -> float:
    return BLOCK_TILES * TILE_SQUARES * lattice.square_m


def _box(block: Tile, lattice: Lattice, fading: Fading | None) -> Box:
    side_m = _side_m(lattice)
    low = np.array(block) * side_m
    return Box(low - HALO_M, low + side_m + HALO_M, fading)


def _laid_out(
    task: tuple[Tile, list[tuple[int, str]]], *, store: Store, min_vehicles: int, fading: Fading | None, seed: int,
    options: dict[str, Any],
) -> LaidOut | None:  # fmt: skip
    """A block, by its recordings; None of one without places that so many passed."""
    block, recordings = task
    side_m, box = _side_m(store.config.lattice), _box(block, store.config.lattice, fading)
    (sample,) = sampled(store, [box], most_rows=MOST_STEPS, min_vehicles=min_vehicles, recordings=recordings)
    low = np.array(block) * side_m
    position = sample.ways.position
    here = position[_is_inside(position, low, side_m)]
    if not len(here):
        return None
    rng = np.random.default_rng((seed, block[0] + SEED, block[1] + SEED))
    found = lay_out(sample.ways.visible().tracks, rng=rng, **options)
    layouts = [(each.cells.centers[_is_inside(each.cells.centers, low, side_m)], each.softness) for each in found]
    covered = GridTessellation.covering(here, cell_size=REACH_M).centers
    return LaidOut(block, layouts, covered)


def _is_inside(position: FloatArray, low: FloatArray, side_m: float) -> Any:
    """(n,)."""
    return ((position >= low) & (position < low + side_m)).all(axis=1)
