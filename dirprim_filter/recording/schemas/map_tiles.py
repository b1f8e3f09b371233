"""A map of directional primitives as messages `dirprim.PrimitiveMap`, the cells on a square of the ground in each.

A message is an `ArrowMessage` of tables: `cell` with a row for each cell of the tile, `square` (those that are the
cells of a grid, or near the data), `beside` (generators of other tiles that may be nearest on this ground), `manoeuvre`
with a row for each manoeuvre of these cells, `transition` with what followed them, in their order. Cells and manoeuvres
have their numbers in the map. What every tile repeats is `SHARED`. A map comes back bit for bit.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple, Self

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.primitives.motion import FLOATS, Motion
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.traffic import Passages
from dirprim_filter.recording.schemas.arrow_message import Columns, Scalar, encode
from tessellation import GridTessellation, VoronoiTessellation
from tessellation.tiles import Tile, tiles_of

VERSION = 5
"""Of the messages; a map of another version has other tiles."""
TILE_M = 500.0
"""Side of a tile, about: a vehicle is on one of them, at most on four, and a city has hundreds."""
TILE_CELLS = 4096
"""Cells in a message, at most: some 0.5 MB at three modes, so that a damaged chunk is small and a viewer can page."""

ROW = ("weight", "mean_direction", "concentration", "shape", "rate", "bend", "gain")
"""Columns of the modes of each cell."""
MANOEUVRE = ("number", "cell", "mode", "n_following")
LEADER = ("gain", "push", "trust", "start_rate")
SCALARS = {
    "n_tiles": int, "n_place_free_modes": int, "kind": str, "origin_x": float,
    "origin_y": float, "cell_size": float, "n_x": int, "n_y": int, "course_rate": float, "strength": float,
    "spread": float,
}  # fmt: skip
SHARED = ("version", *SCALARS, "place_free", "free_manoeuvre", "free_transition", "leader")
"""What every tile repeats."""
NO_NUMBERS = np.empty(0, np.int64)
NOTHING = Tile(NO_NUMBERS, NO_NUMBERS, NO_NUMBERS, np.zeros(4))


def encoded_tiles(primitive_map: PrimitiveMap, tiles: list[Tile]) -> Iterator[bytes]:
    """The message of each tile."""
    scalars, shared = shared_by_tiles(primitive_map, len(tiles))
    of_all = OfAll.of(primitive_map)
    for i, tile in enumerate(tiles):
        yield encode(scalars | {"tile": i}, tables_of(primitive_map, tile, of_all) | shared)


class OfAll(NamedTuple):
    """What is found of all cells and manoeuvres at once."""

    area: FloatArray  # (n,) square metres
    center: FloatArray  # (n, 2) metres
    begin: IntArray  # (n + 1,) the manoeuvres of cell i are those from begin[i] to begin[i + 1]
    arrived: FloatArray  # (z,) of each manoeuvre of a place, how many visits followed that of another

    @classmethod
    def of(cls, primitive_map: PrimitiveMap) -> Self:
        """Of a map."""
        cells, motion = primitive_map.tessellation, primitive_map.motion
        begin = np.searchsorted(motion.cell[: motion.n_placed], np.arange(cells.n_cells + 1))
        return cls(cells.area, cells.centers.reshape(-1, 2), begin, Passages.of(primitive_map).arrived)


def tables_of(primitive_map: PrimitiveMap, tile: Tile, of_all: OfAll) -> dict[str, Columns]:
    """What a tile has of its own."""
    area, center, begin, arrived = of_all
    manoeuvres, transitions = _manoeuvres(primitive_map.motion, ranges(begin, tile.cell)[0])
    beside = NO_NUMBERS if isinstance(primitive_map.tessellation, GridTessellation) else tile.beside
    return {
        "cell": {"number": tile.cell, "area": area[tile.cell], "place": center[tile.cell]}
        | _rows(primitive_map, tile.cell),
        "square": {"number": tile.square},
        "beside": {"cell": beside, "place": center[beside]},
        "manoeuvre": manoeuvres | {"arrived": arrived[manoeuvres["number"]]},
        "transition": transitions,
    }


def tiles_in(primitive_map: PrimitiveMap) -> list[Tile]:
    """The tiles of a map, at least one.

    Raises:
        TypeError: cells of a kind that the messages do not know.
    """
    cells = primitive_map.tessellation
    if not isinstance(cells, GridTessellation | VoronoiTessellation):
        raise TypeError(f"tessellation: expected a GridTessellation or VoronoiTessellation, got {type(cells).__name__}")
    of_grid = isinstance(cells, GridTessellation)
    return [part for tile in tiles_of(cells, TILE_M) for part in _not_too_large(tile, of_grid)] or [NOTHING]


def shared_by_tiles(primitive_map: PrimitiveMap, n_tiles: int) -> tuple[dict[str, Scalar], dict[str, Columns]]:
    """What every tile repeats: scalars and tables."""
    cells, motion = primitive_map.tessellation, primitive_map.motion
    grid: Any = cells if isinstance(cells, GridTessellation) else cells.region  # type: ignore[attr-defined]
    kind = "grid" if grid is cells else "voronoi"
    free, after_free = _manoeuvres(motion, np.arange(motion.n_placed, len(motion)))
    leaders = [motion.leader] if motion.leader else []
    leader = {name: np.array([getattr(of, name) for of in leaders], np.float64) for name in LEADER}
    values = (
        n_tiles, primitive_map.n_place_free_modes, kind, *map(float, grid.origin),
        float(grid.cell_size), grid.n_x, grid.n_y, float(motion.course_rate), float(motion.strength),
        float(motion.spread),
    )  # fmt: skip
    scalars = {"version": VERSION, **dict(zip(SCALARS, values, strict=True))}
    place_free = _rows(primitive_map, np.array([cells.n_cells]))
    return scalars, {
        "place_free": place_free, "free_manoeuvre": free, "free_transition": after_free, "leader": leader
    }  # fmt: skip


def ranges(first: IntArray, of: IntArray) -> tuple[IntArray, IntArray]:
    """The ranges from first[i] to first[i + 1] of some i (n,), one after the other, and where each begins, (n + 1,)."""
    begin = np.append(0, np.cumsum(first[of + 1] - first[of]))
    return np.arange(begin[-1]) + np.repeat(first[of] - begin[:-1], np.diff(begin)), begin


def _rows(primitive_map: PrimitiveMap, rows: IntArray) -> Columns:
    direction, speed = primitive_map.direction, primitive_map.speed
    columns = (
        direction.weight, direction.mean_direction, direction.concentration, speed.shape, speed.rate,
        primitive_map.bend, primitive_map.gain,
    )  # fmt: skip
    of_modes = {name: column[rows] for name, column in zip(ROW, columns, strict=True)}
    return of_modes | {"n_rows": primitive_map.n_rows[rows]}


def _manoeuvres(motion: Motion, number: IntArray) -> tuple[Columns, Columns]:
    """Some manoeuvres (n,), ascending, and the transitions from them."""
    following, first = ranges(motion.first, number)
    columns: dict[str, AnyArray] = {
        "number": number, "cell": motion.cell[number], "mode": motion.mode[number], "n_following": np.diff(first),
    }  # fmt: skip
    columns |= {name: getattr(motion, name)[number] for name in FLOATS}
    return columns, {"following": motion.following[following], "count": motion.count[following]}


def _not_too_large(tile: Tile, of_grid: bool) -> list[Tile]:
    """A tile as several of at most `TILE_CELLS` cells; the first has the ground of generators."""
    made = []
    for first in range(0, max(tile.cell.size, 1), TILE_CELLS):
        some = slice(first, first + TILE_CELLS)
        square = tile.square[some] if of_grid else NO_NUMBERS if first else tile.square
        made.append(Tile(tile.cell[some], square, NO_NUMBERS if first else tile.beside, tile.box))
    return made
