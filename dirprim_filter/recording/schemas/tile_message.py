"""A tile's message: checked, and what can be said of it before its parameters are read.

Source: dirprim.proto, see `map_tiles`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from google.protobuf.message import DecodeError

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.primitives.schedule import N_SLOTS
from dirprim_filter.recording.schemas import dirprim_pb2
from dirprim_filter.recording.schemas.dirprim import column_of, floats_of, ints_of, parse
from dirprim_filter.recording.schemas.map_tiles import MODE_COLUMNS, VERSION
from dirprim_filter.recording.schemas.motion_columns import ALL, COLUMNS, motion_columns

Columns = dict[str, AnyArray]


class Head(NamedTuple):
    """What is known of a tile before its parameters are read."""

    at: int  # which message it is
    cell: IntArray
    manoeuvre: IntArray
    n_following: AnyArray  # transitions of each
    box: FloatArray  # (4,) metres
    ahead: IntArray


def parsed(messages: Iterable[bytes]) -> Iterator[dirprim_pb2.PrimitiveMap]:
    """Each of the messages, if it is one of this version.

    Raises:
        DecodeError: it is not.
    """
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
        yield message


def n_cells_of(message: dirprim_pb2.PrimitiveMap) -> int:
    """How many cells a tile has."""
    return len(message.grid.square if message.HasField("grid") else message.voronoi.x)


def head_of(message: dirprim_pb2.PrimitiveMap, at: int) -> Head:
    """What the message that comes as number `at` has in it."""
    box, motion = message.box, manoeuvres_of(message.motion, ("number", "first"))
    return Head(
        at=at,
        cell=ints_of(message, "cell", n_cells_of(message)),
        manoeuvre=motion["number"],
        n_following=motion["n_following"].astype(np.int32),
        box=np.array([box.west, box.south, box.east, box.north]),
        ahead=ints_of(message, "ahead", len(message.ahead)),
    )


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


def centers_of(message: dirprim_pb2.PrimitiveMap) -> FloatArray:
    """(n, 2) metres, of a tile's cells."""
    if message.HasField("voronoi"):
        return places_of(message.voronoi, "x", "y", n_cells_of(message))
    grid = message.grid
    row, column = np.divmod(ints_of(grid, "square", n_cells_of(message)), max(grid.n_x, 1))
    corner = np.array([grid.origin_x, grid.origin_y]) + grid.cell_size * np.column_stack([column, row])
    return np.asarray(corner + grid.cell_size / 2)


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
            column_of(motion, name, len(motion.following if name in ("following", "count") else motion.cell))
    if message.HasField("schedule"):
        for name in ("flow", "pace"):
            column_of(message.schedule, name, n * int(np.prod(turning_shape(message))))


def turning_shape(message: dirprim_pb2.PrimitiveMap) -> tuple[int, int]:
    """Slots, and modes of a cell's own."""
    own = message.n_modes - message.n_borrowed_modes - message.n_place_free_modes
    return N_SLOTS.get(message.schedule.by, 0), own


def shared_part(message: dirprim_pb2.PrimitiveMap) -> bytes:
    """What every tile of a map repeats; the message has nothing else then."""
    for name in ("tile", "cell", "area", "box", "ahead", "cells", "motion", "refit"):
        message.ClearField(name)
    if message.HasField("schedule"):  # which clearing its columns would set
        for column in ("flow", "pace"):
            message.schedule.ClearField(column)
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
