"""A map of directional primitives as `dirprim.PrimitiveMap` messages, a tile of cells in each.

Source: dirprim.proto. Columns travel as packed doubles, so a map comes back bit for bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, cast

import numpy as np
from google.protobuf.message import DecodeError

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.schedule import N_SLOTS, By, Schedule
from dirprim_filter.recording.schemas import dirprim_pb2
from dirprim_filter.recording.schemas.dirprim import floats_of, ints_of, parse
from dirprim_filter.recording.schemas.motion_columns import COLUMNS, decode_motion, encode_motion
from dirprim_filter.recording.schemas.refit_message import decode_refit, encode_refit
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


def decode_tiles(messages: Iterable[bytes]) -> PrimitiveMap:
    """The map that the messages hold, in whatever order they come.

    Raises:
        DecodeError: bytes that are no such message, another version of it, a tile that is missing, twice there or of
            another map, columns of a wrong length, or numbers that make no map.
    """
    tiles: dict[int, dirprim_pb2.PrimitiveMap] = {}
    for data in messages:
        message = dirprim_pb2.PrimitiveMap()
        parse(message, data)
        if message.version != VERSION:
            age = "an older" if message.version < VERSION else "a newer"
            raise DecodeError(f"it is of {age} version, {message.version}; this program reads version {VERSION}")
        if message.WhichOneof("tessellation") is None:
            raise DecodeError(
                f"tile {message.tile}: expected the cells of a grid or of generators, got none that this version knows"
            )
        if message.tile in tiles:
            raise DecodeError(f"tile {message.tile}: expected once, got twice")
        tiles[message.tile] = message
    if not tiles:
        raise DecodeError("expected at least one tile of a map, got none")
    first = next(iter(tiles.values()))
    # Compared by number: the count comes from the file, and a range of it could be of any length.
    if len(tiles) != first.n_tiles or max(tiles) != first.n_tiles - 1:
        raise DecodeError(f"expected tiles 0 to {first.n_tiles - 1}, got {len(tiles)} of them")
    ordered = [tiles[tile] for tile in sorted(tiles)]
    if any(_shared_part(tile) != _shared_part(first) for tile in ordered):
        raise DecodeError("expected the tiles of one map, got tiles of several")
    try:
        return _joined(ordered)
    except ValueError as error:
        raise DecodeError(str(error)) from error


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


def _schedule_of(tiles: list[dirprim_pb2.PrimitiveMap], n_cells: list[int]) -> Schedule | None:
    first = tiles[0]
    if not first.HasField("schedule"):
        return None
    shape = (N_SLOTS.get(first.schedule.by, 0), first.n_modes - first.n_borrowed_modes - first.n_place_free_modes)
    flow, pace = (
        np.concatenate([
            floats_of(tile.schedule, name, n * shape[0] * shape[1]).reshape(n, *shape)
            for tile, n in zip(tiles, n_cells, strict=True)
        ]).swapaxes(0, 1)
        for name in ("flow", "pace")
    )  # fmt: skip
    return Schedule(by=cast(By, first.schedule.by), zone=first.schedule.zone, flow=flow, pace=pace)


def _shared_part(tile: dirprim_pb2.PrimitiveMap) -> bytes:
    """What every tile of a map repeats."""
    shared = dirprim_pb2.PrimitiveMap()
    shared.CopyFrom(tile)
    shared.ClearField("tile")
    shared.ClearField("cells")
    shared.ClearField("refit")
    for column in COLUMNS:
        shared.motion.ClearField(column)
    for column in ("flow", "pace"):
        shared.schedule.ClearField(column)
    if shared.HasField("grid"):
        shared.grid.ClearField("square")
    else:
        shared.voronoi.ClearField("x")
        shared.voronoi.ClearField("y")
        shared.voronoi.region.ClearField("square")
    return shared.SerializeToString(deterministic=True)


def _joined(tiles: list[dirprim_pb2.PrimitiveMap]) -> PrimitiveMap:
    first = tiles[0]
    of_grid = first.HasField("grid")
    n_cells = [len(tile.grid.square if of_grid else tile.voronoi.x) for tile in tiles]
    rows = [*((tile.cells, n) for tile, n in zip(tiles, n_cells, strict=True)), (first.place_free, 1)]
    column = {
        name: np.concatenate([floats_of(part, name, n * first.n_modes) for part, n in rows]).reshape(
            sum(n_cells) + 1, first.n_modes
        )
        for name in MODE_COLUMNS
    }
    return PrimitiveMap(
        tessellation=_grid_of([tile.grid for tile in tiles]) if of_grid else _voronoi_of(tiles, n_cells),
        direction=VonMisesMixture(
            weight=column["weight"],
            mean_direction=column["mean_direction"],
            concentration=column["concentration"],
        ),
        speed=Gamma(shape=column["shape"], rate=column["rate"]),
        n_rows=np.concatenate([ints_of(part, "n_rows", n) for part, n in rows]),
        n_place_free_modes=first.n_place_free_modes,
        n_borrowed_modes=first.n_borrowed_modes,
        bend=np.stack([column["bend_east"], column["bend_north"]], axis=-1),
        gain=np.stack([column["gain_east"], column["gain_north"]], axis=-1),
        motion=decode_motion([tile.motion for tile in tiles]),
        schedule=_schedule_of(tiles, n_cells),
        refit=decode_refit(first.refit) if first.HasField("refit") else None,
    )


def _grid_of(parts: list[dirprim_pb2.Grid]) -> GridTessellation:
    grid = parts[0]
    return GridTessellation(
        origin=np.array([grid.origin_x, grid.origin_y]),
        cell_size=grid.cell_size,
        n_x=grid.n_x,
        n_y=grid.n_y,
        square=np.concatenate([ints_of(part, "square", len(part.square)) for part in parts]),
    )


def _voronoi_of(tiles: list[dirprim_pb2.PrimitiveMap], n_cells: list[int]) -> VoronoiTessellation:
    x, y = (
        np.concatenate([floats_of(tile.voronoi, axis, n) for tile, n in zip(tiles, n_cells, strict=True)])
        for axis in ("x", "y")
    )
    return VoronoiTessellation(
        generators=np.column_stack([x, y]), region=_grid_of([tile.voronoi.region for tile in tiles])
    )
