"""A map, whole or in part, out of its messages.

They are gone through twice, one at a time: first for where cells are and how vehicles pass from one to the next, then
for the parameters of the cells that are wanted. So no more is held than the map that is made.

Source: dirprim.proto, see `map_tiles`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple, Self, cast

import numpy as np
from google.protobuf.message import DecodeError

from dirprim_filter.arrays import AnyArray, IntArray
from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.primitives.motion import FLOATS, require_passages
from dirprim_filter.primitives.part import Ground, Part
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.refit import Refit
from dirprim_filter.primitives.schedule import N_SLOTS, By, Schedule
from dirprim_filter.primitives.traffic import Passages, Traffic
from dirprim_filter.recording.schemas import dirprim_pb2
from dirprim_filter.recording.schemas.dirprim import column_of, floats_of, ints_of, parse
from dirprim_filter.recording.schemas.map_tiles import MODE_COLUMNS, VERSION
from dirprim_filter.recording.schemas.motion_columns import COLUMNS, motion_columns, motion_of
from dirprim_filter.recording.schemas.refit_message import decode_refit
from tessellation import GridTessellation, Tessellation, VoronoiTessellation
from tessellation.located_part import LocatedPart

Columns = dict[str, AnyArray]
COUNTED = ("cell", "mode", "visits", "seconds", "first", "following", "count")
"""Columns of motion that tell how vehicles pass on."""


WHOLE_CELLS = 20_000
"""A map of no more is read whole: it takes 0.2 GB with all that is made of it."""


def decode_tiles(messages: Iterable[bytes], *, near: Callable[[], Ground] | None = None) -> PrimitiveMap:
    """The map that the messages hold, in whatever order they come.

    Args:
        messages: can be gone through more than once.
        near: asked for a map of many cells: those with their centres on this ground are all that is wanted.

    Raises:
        DecodeError: bytes that are no such message, another version of it, a tile that is missing, twice there or of
            another map, columns of a wrong length, or numbers that make no map.
    """
    outline = _outlined(messages)
    try:
        cells = outline.tessellation()
        if near is None or cells.n_cells <= WHOLE_CELLS:
            return _map_of(outline, messages, cells)
        return _part_of(outline, messages, cells, np.flatnonzero(near().covers(cells.centers)))
    except ValueError as error:
        raise DecodeError(str(error)) from error


class _Outline(NamedTuple):
    """What is known of a map before its parameters are read."""

    shared: dirprim_pb2.PrimitiveMap  # what tiles repeat
    refit: Refit | None
    place: Columns  # of the cells: `square` of a grid, or `x`, `y`, and `square` of their region
    counted: Columns  # of motion
    first_cell: IntArray  # (n_tiles + 1,)
    first_manoeuvre: IntArray  # (n_tiles + 1,)

    def tessellation(self) -> GridTessellation | VoronoiTessellation:
        """The cells.

        Raises:
            ValueError: numbers that make none.
        """
        of_grid = self.shared.HasField("grid")
        grid = self.shared.grid if of_grid else self.shared.voronoi.region
        squares = GridTessellation(
            origin=np.array([grid.origin_x, grid.origin_y]), cell_size=grid.cell_size, n_x=grid.n_x, n_y=grid.n_y,
            square=self.place["square"],
        )  # fmt: skip
        if of_grid:
            return squares
        generators = np.column_stack([self.place["x"], self.place["y"]])
        return VoronoiTessellation(generators=generators, region=squares)


def _outlined(messages: Iterable[bytes]) -> _Outline:
    place: dict[int, Columns] = {}
    motion: dict[int, Columns] = {}
    n_cells: dict[int, int] = {}
    shared: set[bytes] = set()
    refit = None
    for message in _parsed(messages):
        number = message.tile
        if number in place:
            raise DecodeError(f"tile {number}: expected once, got twice")
        place[number], n_cells[number] = _place_of(message), _n_cells_of(message)
        _check_lengths(message)
        motion[number] = motion_columns(message.motion, COUNTED)
        if message.HasField("refit"):
            refit = decode_refit(message.refit)
        shared.add(_shared_part(message))
    first = _the_only(shared, place)
    tiles = range(first.n_tiles)
    n_manoeuvres = [motion[tile]["cell"].size for tile in tiles]
    counted = _joined([motion.pop(tile) for tile in tiles])
    counted["first"] = np.append(counted["first"], counted["following"].size)
    return _Outline(
        first, refit, _joined([place.pop(tile) for tile in tiles]), counted,
        np.append(0, np.cumsum([n_cells[tile] for tile in tiles])), np.append(0, np.cumsum(n_manoeuvres)),
    )  # fmt: skip


def _parsed(messages: Iterable[bytes]) -> Iterator[dirprim_pb2.PrimitiveMap]:
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


def _n_cells_of(message: dirprim_pb2.PrimitiveMap) -> int:
    return len(message.grid.square if message.HasField("grid") else message.voronoi.x)


def _place_of(message: dirprim_pb2.PrimitiveMap) -> Columns:
    if message.HasField("grid"):
        return {"square": ints_of(message.grid, "square", len(message.grid.square))}
    cells, n = message.voronoi, len(message.voronoi.x)
    square = ints_of(cells.region, "square", len(cells.region.square))
    return {"x": floats_of(cells, "x", n), "y": floats_of(cells, "y", n), "square": square}


def _check_lengths(message: dirprim_pb2.PrimitiveMap) -> None:
    """Whether a message has as many numbers as it says: room is made for them before they are read."""
    n = _n_cells_of(message)
    for part, n_rows in ((message.cells, n), (message.place_free, 1)):
        for name in MODE_COLUMNS:
            column_of(part, name, n_rows * message.n_modes)
        column_of(part, "n_rows", n_rows)
    motion = message.motion
    for name in COLUMNS:
        column_of(motion, name, len(motion.following if name in ("following", "count") else motion.cell))
    if message.HasField("schedule"):
        for name in ("flow", "pace"):
            column_of(message.schedule, name, n * int(np.prod(_turning_shape(message))))


def _turning_shape(message: dirprim_pb2.PrimitiveMap) -> tuple[int, int]:
    """Slots, and modes of a cell's own."""
    own = message.n_modes - message.n_borrowed_modes - message.n_place_free_modes
    return N_SLOTS.get(message.schedule.by, 0), own


def _shared_part(message: dirprim_pb2.PrimitiveMap) -> bytes:
    """What every tile of a map repeats; the message has nothing else then."""
    for name in ("tile", "cells", "refit"):
        message.ClearField(name)
    for column in COLUMNS:
        message.motion.ClearField(column)
    if message.HasField("schedule"):  # which clearing its columns would set
        for column in ("flow", "pace"):
            message.schedule.ClearField(column)
    if message.HasField("grid"):
        message.grid.ClearField("square")
    else:
        message.voronoi.ClearField("x")
        message.voronoi.ClearField("y")
        message.voronoi.region.ClearField("square")
    return message.SerializeToString(deterministic=True)


def _the_only(shared: set[bytes], numbers: Iterable[int]) -> dirprim_pb2.PrimitiveMap:
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


def _joined(parts: list[Columns]) -> Columns:
    """Columns one after the other; what they are joined of is let go of as soon as it is."""
    return {name: np.concatenate([part.pop(name) for part in parts]) for name in list(parts[0])}


def _part_of(outline: _Outline, messages: Iterable[bytes], whole: Tessellation, chosen: IntArray) -> PrimitiveMap:
    """The map of some cells; what is of no place, and of how vehicles pass on, is that of the whole."""
    counted, n = outline.counted, whole.n_cells
    cell, first, following = counted["cell"], counted["first"], counted["following"]
    require_passages(cell, first, following)
    tessellation = LocatedPart.of(whole, chosen)
    number = tessellation.number  # the last is of manoeuvres that have no cell
    n_placed = int(np.count_nonzero(cell >= 0))
    if n_placed and cell[n_placed - 1] >= n:
        raise ValueError(f"motion: expected manoeuvres of {n} cells, got others")
    kept = np.flatnonzero((number[cell] >= 0) | (cell < 0))
    renumbered = np.full(cell.size, -1)
    renumbered[kept] = np.arange(kept.size)
    source = np.repeat(np.arange(cell.size), np.diff(first))
    on = (renumbered[source] >= 0) & (renumbered[following] >= 0)
    some = {name: counted[name][kept] for name in ("mode", "visits", "seconds")} | {
        "cell": number[cell[kept]], "following": renumbered[following[on]], "count": counted["count"][on],
        "first": np.append(0, np.cumsum(np.bincount(renumbered[source[on]], minlength=kept.size))),
    }  # fmt: skip
    of_all = {name: counted[name][:n_placed] for name in ("cell", "mode", "visits", "seconds")}
    passages = Passages(**of_all, first=first[: n_placed + 1], following=following, count=counted["count"])
    part = Part(manoeuvre=kept[kept < n_placed], traffic=Traffic.counted(passages, whole))
    return _map_of(outline._replace(counted=some), messages, tessellation, _Chosen(chosen, kept, part))


class _Chosen(NamedTuple):
    """Of a map's cells and manoeuvres those that are wanted."""

    cell: IntArray
    manoeuvre: IntArray
    part: Part | None

    @classmethod
    def all_of(cls, outline: _Outline) -> Self:
        """All of them."""
        return cls(np.arange(outline.first_cell[-1]), np.arange(outline.first_manoeuvre[-1]), None)


def _map_of(
    outline: _Outline, messages: Iterable[bytes], tessellation: Tessellation, chosen: _Chosen | None = None
) -> PrimitiveMap:
    chosen = chosen or _Chosen.all_of(outline)
    shared, n, z = outline.shared, chosen.cell.size, chosen.manoeuvre.size
    m = shared.n_modes
    rows: dict[str, Any] = {name: np.empty((n + 1, m)) for name in MODE_COLUMNS[:5]} | {
        "bend": np.empty((n + 1, m, 2)), "gain": np.empty((n + 1, m, 2)), "n_rows": np.empty(n + 1, np.int64),
    }  # fmt: skip
    wide = {"bend": (2,), "gain": (2,), "path": (3,), "acceleration": (4,)}
    moving = {name: np.empty((z, *wide.get(name, ()))) for name in FLOATS if name not in COUNTED}
    turning: Columns = {}
    if shared.HasField("schedule"):
        slots, own = _turning_shape(shared)
        turning = {name: np.empty((slots, n, own)) for name in ("flow", "pace")}
    for message in _parsed(messages):
        to, at, n_cells = _taken(chosen.cell, outline.first_cell, message.tile)
        _fill_rows(rows, to, message.cells, at, n_cells)
        for name, column in turning.items():
            of_cells = floats_of(message.schedule, name, n_cells * slots * own).reshape(n_cells, slots, own)
            column[:, to] = of_cells[at].swapaxes(0, 1)
        to, at, _ = _taken(chosen.manoeuvre, outline.first_manoeuvre, message.tile)
        of_tile = motion_columns(message.motion, moving)
        for name, column in moving.items():
            column[to] = of_tile[name][at]
    _fill_rows(rows, slice(n, n + 1), shared.place_free, np.zeros(1, np.int64), 1)
    schedule = Schedule(by=cast(By, shared.schedule.by), zone=shared.schedule.zone, **turning) if turning else None
    return PrimitiveMap(
        tessellation=tessellation,
        direction=VonMisesMixture(
            weight=rows["weight"], mean_direction=rows.pop("mean_direction"), concentration=rows["concentration"]
        ),
        speed=Gamma(shape=rows["shape"], rate=rows["rate"]),
        n_rows=rows["n_rows"],
        n_place_free_modes=shared.n_place_free_modes,
        n_borrowed_modes=shared.n_borrowed_modes,
        bend=rows["bend"],
        gain=rows["gain"],
        motion=motion_of(outline.counted | moving, shared.motion),
        schedule=schedule,
        refit=None if chosen.part else outline.refit,
        part=chosen.part,
    )


def _taken(chosen: IntArray, first: IntArray, tile: int) -> tuple[slice, IntArray, int]:
    """Where what is chosen of a tile goes to; where it stands in it; of how many."""
    begin, end = np.searchsorted(chosen, first[tile : tile + 2])
    return slice(begin, end), chosen[begin:end] - first[tile], int(first[tile + 1] - first[tile])


def _fill_rows(rows: dict[str, Any], to: slice, part: dirprim_pb2.Primitives, at: IntArray, n: int) -> None:
    """Rows `at` of a message's n."""
    m = rows["weight"].shape[1]
    for name in MODE_COLUMNS[:5]:
        rows[name][to] = floats_of(part, name, n * m).reshape(n, m)[at]
    for slope in ("bend", "gain"):
        for i, axis in enumerate(("east", "north")):
            rows[slope][to][..., i] = floats_of(part, f"{slope}_{axis}", n * m).reshape(n, m)[at]
    rows["n_rows"][to] = ints_of(part, "n_rows", n)[at]
