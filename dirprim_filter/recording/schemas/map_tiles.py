"""A map of directional primitives as `dirprim.PrimitiveMap` messages, a tile of cells in each.

Source: dirprim.proto. Columns travel as packed doubles, so a map comes back bit for bit.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.schedule import Schedule
from dirprim_filter.recording.schemas import dirprim_pb2
from dirprim_filter.recording.schemas.motion_columns import encode_motion
from dirprim_filter.recording.schemas.refit_message import encode_refit
from tessellation import GridTessellation, VoronoiTessellation

VERSION = 2
"""Of the messages; a map of another version says other things of motion."""
TILE_CELLS = 4096
"""Cells in a message: some 0.5 MB at three modes, so that a damaged chunk is small and a viewer can page."""

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
    n_cells = tessellation.n_cells
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
    n_tiles = max(1, -(-n_cells // TILE_CELLS))
    place_free = _encode_rows(columns, primitive_map.n_rows, slice(n_cells, None))
    for tile in range(n_tiles):
        cells = slice(tile * TILE_CELLS, min((tile + 1) * TILE_CELLS, n_cells))
        yield dirprim_pb2.PrimitiveMap(
            version=VERSION,
            tile=tile,
            n_tiles=n_tiles,
            n_modes=primitive_map.direction.weight.shape[1],
            n_place_free_modes=primitive_map.n_place_free_modes,
            n_borrowed_modes=primitive_map.n_borrowed_modes,
            **_encode_cells(tessellation, cells, tile, n_tiles),
            cells=_encode_rows(columns, primitive_map.n_rows, cells),
            place_free=place_free,
            motion=encode_motion(primitive_map.motion, tile, n_tiles),
            schedule=_encode_schedule(primitive_map.schedule, cells),
            refit=encode_refit(primitive_map.refit) if tile == 0 else None,
        )


def _encode_cells(
    tessellation: GridTessellation | VoronoiTessellation, cells: slice, tile: int, n_tiles: int
) -> dict[str, Any]:
    """A tile's cells. A region has no cell to go with, so each tile takes as many of its squares."""
    if isinstance(tessellation, GridTessellation):
        return {"grid": _encode_grid(tessellation, cells)}
    x, y = tessellation.generators[cells].T
    first, last = (tessellation.region.n_cells * t // n_tiles for t in (tile, tile + 1))
    region = _encode_grid(tessellation.region, slice(first, last))
    return {"voronoi": dirprim_pb2.Voronoi(x=x.tolist(), y=y.tolist(), region=region)}


def _encode_grid(grid: GridTessellation, squares: slice) -> dirprim_pb2.Grid:
    return dirprim_pb2.Grid(
        origin_x=grid.origin[0],
        origin_y=grid.origin[1],
        cell_size=grid.cell_size,
        n_x=grid.n_x,
        n_y=grid.n_y,
        square=grid.square[squares].tolist(),
    )


def _encode_rows(columns: dict[str, FloatArray], n_rows: IntArray, rows: slice) -> dirprim_pb2.Primitives:
    packed = {name: column[rows].ravel().tolist() for name, column in columns.items()}
    return dirprim_pb2.Primitives(**packed, n_rows=n_rows[rows].tolist())


def _encode_schedule(schedule: Schedule | None, cells: slice) -> dirprim_pb2.Schedule | None:
    if schedule is None:
        return None
    columns = {name: getattr(schedule, name)[:, cells].swapaxes(0, 1).ravel().tolist() for name in ("flow", "pace")}
    return dirprim_pb2.Schedule(by=schedule.by, zone=schedule.zone, **columns)
