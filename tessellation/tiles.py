"""Tiles of the ground: which cells are in each square of about half a kilometre, and what it takes to locate in it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from tessellation._arrays import FloatArray, IntArray
from tessellation._kernels import SIDE
from tessellation.grid import GridTessellation
from tessellation.voronoi import VoronoiTessellation

BLOCK_SQUARES = SIDE


class Tile(NamedTuple):
    """The ground of one tile. A cell is in that which holds its generator, or its square."""

    cell: IntArray  # (n,) ascending
    square: IntArray  # (k,) of a grid those of its cells, else of the region; ascending numbers of squares
    beside: IntArray  # (m,) cells of other tiles that may be nearest somewhere near its squares
    box: FloatArray  # (4,) west, south, east and north of its squares, and of all where its cells may be; metres


def block_side(region: GridTessellation) -> float:
    """Metres: positions of one block are located by what is near that block."""
    return BLOCK_SQUARES * region.cell_size


def tiles_of(cells: GridTessellation | VoronoiTessellation, side_m: float) -> list[Tile]:
    """The tiles that have a cell or a square, each of some whole blocks, about `side_m` long."""
    region = cells if isinstance(cells, GridTessellation) else cells.region
    n_blocks = max(round(side_m / block_side(region)), 1)
    squares, n_tiles_x = n_blocks * BLOCK_SQUARES, -(-region.n_x // (n_blocks * BLOCK_SQUARES))
    row, column = np.divmod(region.square, region.n_x)
    of_square = row // squares * n_tiles_x + column // squares
    shape = np.array([region.n_x, region.n_y])
    at = (cells.centers - region.origin) / region.cell_size
    east, north = (np.clip(at, 0, shape - 1).astype(np.int64) // squares).T
    of_cell = of_square if isinstance(cells, GridTessellation) else north * n_tiles_x + east
    block_row, block_column = np.unique(np.column_stack([row, column]) // BLOCK_SQUARES, axis=0).T
    of_block = block_row // n_blocks * n_tiles_x + block_column // n_blocks
    near, block = _candidates(cells, region, np.column_stack([block_column, block_row]))
    tiles, square_ends = np.unique(np.concatenate([of_square, of_cell])), np.argsort(of_square, kind="stable")
    cell_order, pair_order = np.argsort(of_cell, kind="stable"), np.argsort(of_block[block], kind="stable")
    low, high = _extents(of_cell[near], block_row[block], block_column[block], tiles)
    made = []
    for i, tile in enumerate(tiles.tolist()):
        own, mine, pairs = (
            order[slice(*np.searchsorted(of, [tile, tile + 1], sorter=order))]
            for order, of in ((cell_order, of_cell), (square_ends, of_square), (pair_order, of_block[block]))
        )
        beside = np.unique(near[pairs])
        corner = n_blocks * np.array(divmod(tile, n_tiles_x)[::-1])
        first, last = np.minimum(low[i], corner), np.maximum(high[i], corner + n_blocks)
        made.append(Tile(
            own, region.square[mine], beside[of_cell[beside] != tile],
            np.tile(region.origin, 2) + block_side(region) * np.concatenate([first, last]),
        ))  # fmt: skip
    return made


def _candidates(
    cells: GridTessellation | VoronoiTessellation, region: GridTessellation, block: IntArray
) -> tuple[IntArray, IntArray]:
    """Pairs (p,), (p,) of a cell and a block, (b, 2) column and row, in which it may be nearest; none of square cells.

    A generator that is h from a block's centre is no farther than h + r from any point of it, where r is half its
    diagonal: so what is beyond h + 2 r is nowhere nearest.
    """
    if isinstance(cells, GridTessellation) or not cells.n_cells or not len(block):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    side, tree = block_side(region), cKDTree(cells.generators)
    center = region.origin + side * (block + 0.5)
    near = tree.query(center)[0] + np.sqrt(2.0) * side
    found = [np.array(sorted(of)) for of in tree.query_ball_point(center, near * (1.0 + 1e-9) + 1e-6)]
    return np.concatenate(found), np.repeat(np.arange(len(found)), [of.size for of in found])


def _extents(tile: IntArray, row: IntArray, column: IntArray, tiles: IntArray) -> tuple[IntArray, IntArray]:
    """(p,) blocks where cells of a tile may be -> of each (t, 2) the first column and row, and behind the last."""
    low, high = np.full((tiles.size, 2), 1 << 40), np.full((tiles.size, 2), -1)
    of, at = np.searchsorted(tiles, tile), np.column_stack([column, row])
    np.minimum.at(low, of, at)
    np.maximum.at(high, of, at + 1)
    return low, high
