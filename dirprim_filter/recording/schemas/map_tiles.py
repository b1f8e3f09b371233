"""A map of directional primitives as `dirprim.PrimitiveMap` messages, the cells on a square of the ground in each.

Source: dirprim.proto. Columns travel as packed doubles, so a map comes back bit for bit.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.traffic import Passages
from dirprim_filter.recording.schemas import dirprim_pb2
from dirprim_filter.recording.schemas.motion_columns import encode_manoeuvres, encode_place_free, ranges
from tessellation import GridTessellation, VoronoiTessellation
from tessellation.tiles import Tile, tiles_of

VERSION = 5
"""Of the messages; a map of another version has other tiles."""
TILE_M = 500.0
"""Side of a tile, about: a vehicle is on one of them, at most on four, and a city has hundreds."""
TILE_CELLS = 4096
"""Cells in a message, at most: some 0.5 MB at three modes, so that a damaged chunk is small and a viewer can page."""

MODE_COLUMNS = (
    "weight", "mean_direction", "concentration", "shape", "rate", "bend_east", "bend_north", "gain_east", "gain_north",
)  # fmt: skip


def encode_tiles(primitive_map: PrimitiveMap) -> Iterator[dirprim_pb2.PrimitiveMap]:
    """The messages that hold a map; a map with no cell takes one.

    Raises:
        TypeError: cells of a kind that the messages do not know.
    """
    tessellation = primitive_map.tessellation
    if not isinstance(tessellation, GridTessellation | VoronoiTessellation):
        raise TypeError(
            f"tessellation: expected a GridTessellation or VoronoiTessellation, got {type(tessellation).__name__}"
        )
    columns = {
        "weight": primitive_map.direction.weight,
        "mean_direction": primitive_map.direction.mean_direction,
        "concentration": primitive_map.direction.concentration,
        "shape": primitive_map.speed.shape,
        "rate": primitive_map.speed.rate,
        "bend_east": primitive_map.bend[..., 0],
        "bend_north": primitive_map.bend[..., 1],
        "gain_east": primitive_map.gain[..., 0],
        "gain_north": primitive_map.gain[..., 1],
    }
    motion, area, arrived = primitive_map.motion, tessellation.area, Passages.of(primitive_map).arrived
    of_grid = isinstance(tessellation, GridTessellation)
    tiles = [part for tile in tiles_of(tessellation, TILE_M) for part in _not_too_large(tile, of_grid)] or [_NOTHING]
    begin = np.searchsorted(motion.cell[: motion.n_placed], np.arange(tessellation.n_cells + 1))
    place_free = _encode_rows(columns, primitive_map.n_rows, np.array([tessellation.n_cells]))
    for i, tile in enumerate(tiles):
        yield dirprim_pb2.PrimitiveMap(
            version=VERSION,
            tile=i,
            n_tiles=len(tiles),
            n_modes=primitive_map.direction.weight.shape[1],
            n_place_free_modes=primitive_map.n_place_free_modes,
            **_encode_ground(tessellation, tile),
            cell=tile.cell.tolist(),
            area=area[tile.cell].tolist(),
            box=dirprim_pb2.Box(**dict(zip(("west", "south", "east", "north"), tile.box.tolist(), strict=True))),
            cells=_encode_rows(columns, primitive_map.n_rows, tile.cell),
            place_free=place_free,
            motion=encode_manoeuvres(motion, ranges(begin, tile.cell)[0], arrived),
            place_free_motion=encode_place_free(motion),
        )


_NOTHING = Tile(*(np.empty(0, np.int64),) * 3, np.zeros(4))


def _not_too_large(tile: Tile, of_grid: bool) -> list[Tile]:
    """A tile as several of at most `TILE_CELLS` cells; the first has the ground of generators."""
    none = np.empty(0, np.int64)
    made = []
    for first in range(0, max(tile.cell.size, 1), TILE_CELLS):
        some = slice(first, first + TILE_CELLS)
        ground = (tile.square[some] if of_grid else none if first else tile.square, none if first else tile.beside)
        made.append(Tile(tile.cell[some], *ground, tile.box))
    return made


def _encode_ground(tessellation: GridTessellation | VoronoiTessellation, tile: Tile) -> dict[str, Any]:
    """Where a tile's cells are."""
    if isinstance(tessellation, GridTessellation):
        return {"grid": _encode_grid(tessellation, tile.square)}
    (x, y), (beside_x, beside_y) = (tessellation.generators[of].T.tolist() for of in (tile.cell, tile.beside))
    return {"voronoi": dirprim_pb2.Voronoi(
        x=x, y=y, region=_encode_grid(tessellation.region, tile.square), beside=tile.beside.tolist(),
        beside_x=beside_x, beside_y=beside_y,
    )}  # fmt: skip


def _encode_grid(grid: GridTessellation, square: IntArray) -> dirprim_pb2.Grid:
    return dirprim_pb2.Grid(
        origin_x=grid.origin[0],
        origin_y=grid.origin[1],
        cell_size=grid.cell_size,
        n_x=grid.n_x,
        n_y=grid.n_y,
        square=square.tolist(),
    )


def _encode_rows(columns: dict[str, FloatArray], n_rows: IntArray, rows: IntArray) -> dirprim_pb2.Primitives:
    packed = {name: column[rows].ravel().tolist() for name, column in columns.items()}
    return dirprim_pb2.Primitives(**packed, n_rows=n_rows[rows].tolist())
