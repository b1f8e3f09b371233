"""A tile's message: checked, and what can be said of it before its parameters are read.

Source: dirprim.proto, see `map_tiles`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from google.protobuf.message import DecodeError

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.recording.schemas import dirprim_pb2
from dirprim_filter.recording.schemas.dirprim import column_of, floats_of, ints_of, parse
from dirprim_filter.recording.schemas.map_tiles import MODE_COLUMNS, VERSION
from dirprim_filter.recording.schemas.motion_columns import ALL, COLUMNS, OF_TRANSITIONS, motion_columns

Columns = dict[str, AnyArray]


class TileColumns(NamedTuple):
    """All that a tile has."""

    cell: IntArray  # (n,) ascending
    rows: Columns  # (n, m, ...) of its primitives
    area: FloatArray  # (n,) square metres
    place: FloatArray  # (n, 2) metres, of its generators; none of a grid
    square: IntArray  # those that it has of the grid, or the region
    beside: IntArray  # (b,) cells of others, and
    beside_place: FloatArray  # (b, 2) their generators
    motion: Columns  # see `manoeuvres_of`


def parsed(messages: Iterable[bytes]) -> Iterator[dirprim_pb2.PrimitiveMap]:
    """Each of the messages, if it is one of this version.

    Raises:
        DecodeError: it is not.
    """
    for data in messages:
        message = dirprim_pb2.PrimitiveMap()
        parse(message, data)
        check_version(message.version)
        if message.WhichOneof("tessellation") is None:
            raise DecodeError(
                f"tile {message.tile}: expected the cells of a grid or of generators, got none that this version knows"
            )
        yield message


def check_version(version: int) -> None:
    """Whether a message is of the version that this program reads.

    Raises:
        DecodeError: it is not.
    """
    if version != VERSION:
        age = "an older" if version < VERSION else "a newer"
        raise DecodeError(f"it is of {age} version, {version}; this program reads version {VERSION}")


def n_cells_of(message: dirprim_pb2.PrimitiveMap) -> int:
    """How many cells a tile has."""
    return len(message.grid.square if message.HasField("grid") else message.voronoi.x)


def numbers_of(message: dirprim_pb2.PrimitiveMap) -> tuple[IntArray, IntArray]:
    """(n,), (z,) which cells and manoeuvres of the map it has."""
    cell = ints_of(message, "cell", n_cells_of(message))
    return cell, ints_of(message.motion, "number", len(message.motion.cell))


def columns_of(message: dirprim_pb2.PrimitiveMap, motion: Iterable[str] = ALL) -> TileColumns:
    """What the message has in it, of its manoeuvres the columns of these names.

    Raises:
        DecodeError: columns of a wrong length.
    """
    check_lengths(message)
    n, of_generators = n_cells_of(message), message.HasField("voronoi")
    cells = message.voronoi  # empty of a grid
    region, n_beside = (cells.region if of_generators else message.grid), len(cells.beside)
    return TileColumns(
        cell=ints_of(message, "cell", n),
        rows=rows_of(message.cells, n, message.n_modes),
        area=floats_of(message, "area", n),
        place=places_of(cells, "x", "y", n if of_generators else 0),
        square=ints_of(region, "square", len(region.square)),
        beside=ints_of(cells, "beside", n_beside),
        beside_place=places_of(cells, "beside_x", "beside_y", n_beside),
        motion=manoeuvres_of(message.motion, motion),
    )


def rows_of(part: dirprim_pb2.Primitives, n: int, m: int) -> Columns:
    """Columns of n rows of m modes, as `PrimitiveMap` and what it holds name them."""
    rows: Columns = {name: floats_of(part, name, n * m).reshape(n, m) for name in MODE_COLUMNS[:5]}
    for slope in ("bend", "gain"):
        axes = [floats_of(part, f"{slope}_{axis}", n * m).reshape(n, m) for axis in ("east", "north")]
        rows[slope] = np.stack(axes, axis=-1)
    return rows | {"n_rows": ints_of(part, "n_rows", n)}


def manoeuvres_of(motion: dirprim_pb2.Motion, names: Iterable[str] = ALL) -> Columns:
    """Columns of manoeuvres, see `motion_columns`; in place of `first`, how many transitions each has.

    Raises:
        DecodeError: columns of a wrong length, or transitions of no manoeuvre.
    """
    columns = motion_columns(motion, names)
    limits = np.append(columns.pop("first"), len(motion.following))
    if limits[0] != 0 or (limits[1:] < limits[:-1]).any():
        raise DecodeError(f"first: expected ascending numbers from 0 to {limits[-1]}, got others")
    return columns | {"n_following": np.diff(limits)}


def places_of(message: dirprim_pb2.Voronoi, x: str, y: str, n: int) -> FloatArray:
    """(n, 2) out of two columns."""
    return np.column_stack([floats_of(message, x, n), floats_of(message, y, n)])


def check_lengths(message: dirprim_pb2.PrimitiveMap) -> None:
    """Whether a message has as many numbers as it says: room is made for them before they are read."""
    n = n_cells_of(message)
    for part, n_rows in ((message.cells, n), (message.place_free, 1)):
        for name in MODE_COLUMNS:
            column_of(part, name, n_rows * message.n_modes)
        column_of(part, "n_rows", n_rows)
    for motion in (message.motion, message.place_free_motion):
        for name in COLUMNS:
            column_of(motion, name, len(motion.following if name in OF_TRANSITIONS else motion.cell))


def shared_part(message: dirprim_pb2.PrimitiveMap) -> bytes:
    """What every tile of a map repeats; the message has nothing else then."""
    for name in ("tile", "cell", "area", "box", "cells", "motion"):
        message.ClearField(name)
    if message.HasField("grid"):
        message.grid.ClearField("square")
    else:
        for name in ("x", "y", "beside", "beside_x", "beside_y"):
            message.voronoi.ClearField(name)
        message.voronoi.region.ClearField("square")
    return message.SerializeToString(deterministic=True)


def the_only(shared: set[bytes], numbers: Iterable[int]) -> dirprim_pb2.PrimitiveMap:
    """What all tiles repeat, if they are all there and of one map."""
    if not shared:
        raise DecodeError("expected at least one tile of a map, got none")
    first, came = dirprim_pb2.PrimitiveMap(), list(numbers)
    first.ParseFromString(next(iter(shared)))
    # Compared by number: the count comes from the file, and a range of it could be of any length.
    if len(came) != first.n_tiles or max(came) != first.n_tiles - 1:
        raise DecodeError(f"expected tiles 0 to {first.n_tiles - 1}, got {len(came)} of them")
    if len(shared) > 1:
        raise DecodeError("expected the tiles of one map, got tiles of several")
    return first
