"""Where cells are, block by block: of more steps than can be learned from at once, each block's by themselves.

A block is laid out from what vehicles did in it and within `HALO_M` around it, and keeps the cells whose centres lie in
it. All blocks' cells together are the map's.
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
from dirprim_filter.store.learning import MOST_STEPS
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
    centers: FloatArray  # (k, 2) metres, of its cells
    softness: float
    covered: FloatArray  # (m, 2) metres, a place in each square that cells cover


def blocks_of(there: Whereabouts) -> list[Tile]:
    """The blocks that recordings have steps in, in order."""
    return sorted({(east, north) for east, north in (there.tile // BLOCK_TILES).tolist()})


def laid_out_in_blocks(
    store: Store, blocks: list[Tile], there: Whereabouts, *, workers: Workers, min_vehicles: int,
    fading: Fading | None, seed: int, **options: Any,
) -> Layout:  # fmt: skip
    """The cells of all blocks.

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
    softness, of = np.unique([part.softness for part in done], return_inverse=True)
    n_cells = np.bincount(of, [len(part.centers) for part in done])
    cells = VoronoiTessellation.covering(
        np.concatenate([part.covered for part in done]), generators=np.concatenate([part.centers for part in done]),
        reach=REACH_M,
    )  # fmt: skip
    logger.info("%d cells laid out in %d blocks", cells.n_cells, len(done))
    return Layout(cells, float(softness[n_cells.argmax()]))


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
    centers = found.cells.centers
    covered = GridTessellation.covering(here, cell_size=REACH_M).centers
    return LaidOut(block, centers[_is_inside(centers, low, side_m)], found.softness, covered)


def _is_inside(position: FloatArray, low: FloatArray, side_m: float) -> Any:
    """(n,)."""
    return ((position >= low) & (position < low + side_m)).all(axis=1)
