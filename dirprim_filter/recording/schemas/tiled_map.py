"""A map, whole or in part, out of its messages.

They are gone through twice, one at a time: first for what is in each, then for what is wanted. So no more is held than
the map that is made, and of a large one where its tiles are and how vehicles pass on.

Source: dirprim.proto, see `map_tiles`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, Protocol, cast

import numpy as np
from google.protobuf.message import DecodeError

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.primitives.part import Part, renumbered
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.refit import Refit
from dirprim_filter.primitives.schedule import By, Schedule
from dirprim_filter.primitives.traffic import Passages, Traffic
from dirprim_filter.recording.schemas import dirprim_pb2
from dirprim_filter.recording.schemas.dirprim import floats_of, ints_of
from dirprim_filter.recording.schemas.map_tiles import MODE_COLUMNS
from dirprim_filter.recording.schemas.motion_columns import motion_columns, motion_of, ranges
from dirprim_filter.recording.schemas.refit_message import decode_refit
from dirprim_filter.recording.schemas.tile_message import (
    Columns,
    Head,
    centers_of,
    check_lengths,
    head_of,
    manoeuvres_of,
    n_cells_of,
    parsed,
    places_of,
    shared_part,
    the_only,
    turning_shape,
)
from tessellation import GridTessellation, Tessellation, VoronoiTessellation, blocks
from tessellation.blocks import BLOCK_SQUARES
from tessellation.located_part import LocatedPart

WHOLE_CELLS = 20_000
"""A map of no more is read whole: it takes 0.2 GB with all that is made of it."""
NO_NUMBERS = np.empty(0, np.int64)


class Messages(Protocol):
    """The encoded tiles of a map, which can be gone through more than once."""

    def __iter__(self) -> Iterator[bytes]:
        """All of them, in an order that stays."""
        ...

    def some(self, wanted: IntArray) -> Iterable[bytes]:
        """Of these those that are wanted, by where they stand in that order."""
        ...


class TiledMap:
    """A map of which tiles can be read by themselves.

    Args:
        messages: its tiles.

    Attributes:
        box: (n_tiles, 4) west, south, east and north of each tile and of all where its cells may be, metres.

    Raises:
        DecodeError: bytes that are no such message, another version of it, a tile that is missing, twice there or of
            another map, columns of a wrong length, or numbers that make no map.
    """

    def __init__(self, messages: Messages) -> None:
        self._messages = messages
        heads: dict[int, Head] = {}
        shared: set[bytes] = set()
        self._refit: Refit | None = None
        for at, message in enumerate(parsed(messages)):
            if message.tile in heads:
                raise DecodeError(f"tile {message.tile}: expected once, got twice")
            check_lengths(message)
            heads[message.tile] = head_of(message, at)
            if message.HasField("refit"):
                self._refit = decode_refit(message.refit)
            shared.add(shared_part(message))
        self._shared = the_only(shared, heads)
        self._heads = [heads[tile] for tile in range(len(heads))]
        self.n_cells = _numbered("cells", [head.cell for head in self._heads]).size
        self._n_placed = _numbered("manoeuvres", [head.manoeuvre for head in self._heads]).size
        self.box = np.array([head.box for head in self._heads])
        grid = self._shared.grid if self._shared.HasField("grid") else self._shared.voronoi.region
        self._grid: dict[str, Any] = {
            "origin": np.array([grid.origin_x, grid.origin_y]), "cell_size": grid.cell_size, "n_x": grid.n_x,
            "n_y": grid.n_y,
        }  # fmt: skip
        self._traffic: tuple[Traffic | None] | None = None

    @property
    def is_large(self) -> bool:
        """Whether there is much to gain by reading some tiles alone: else rasters are of the whole, and small."""
        return self.n_cells > WHOLE_CELLS and self._grid["n_x"] * self._grid["n_y"] > blocks.DENSE_SQUARES

    @property
    def margin_m(self) -> float:
        """What is at a place depends on no cells farther from it than that."""
        return 2.0 * BLOCK_SQUARES * float(self._grid["cell_size"])

    def whole(self) -> PrimitiveMap:
        """The map.

        Raises:
            DecodeError: numbers that make none.
        """
        return self._read(np.arange(len(self.box)), self._messages)

    def tiles_with(self, cell: IntArray) -> IntArray:
        """The tiles that have some cells (n,), ascending."""
        return np.array([i for i, head in enumerate(self._heads) if np.isin(cell, head.cell).any()], np.int64)

    def part(self, tiles: IntArray) -> PrimitiveMap:
        """The map of some tiles (n,) alone: near those it is as the whole, and says as much of traffic everywhere.

        Raises:
            DecodeError: numbers that make no map.
        """
        ahead = [self._heads[tile].ahead for tile in tiles.tolist()]
        tiles = np.unique(np.concatenate([tiles, *ahead]))
        if (tiles >= len(self.box)).any():
            raise DecodeError(f"ahead: expected tiles 0 to {len(self.box) - 1}, got {tiles.max()}")
        wanted = np.array([self._heads[tile].at for tile in tiles.tolist()], np.int64)
        return self._read(tiles, self._messages.some(wanted), is_part=True)

    def _read(self, tiles: IntArray, messages: Iterable[bytes], *, is_part: bool = False) -> PrimitiveMap:
        heads = [self._heads[tile] for tile in tiles.tolist()]
        try:
            return self._map_of(heads, messages, is_part=is_part)
        except ValueError as error:
            raise DecodeError(str(error)) from error

    def _map_of(self, heads: list[Head], messages: Iterable[bytes], *, is_part: bool) -> PrimitiveMap:
        shared, cell = self._shared, np.sort(np.concatenate([NO_NUMBERS, *(head.cell for head in heads)]))
        n, m = cell.size, shared.n_modes
        rows: dict[str, Any] = {name: np.empty((n + 1, m)) for name in MODE_COLUMNS[:5]} | {
            "bend": np.empty((n + 1, m, 2)), "gain": np.empty((n + 1, m, 2)), "n_rows": np.empty(n + 1, np.int64),
        }  # fmt: skip
        turning: Columns = {}
        if shared.HasField("schedule"):
            slots, own = turning_shape(shared)
            turning = {name: np.empty((slots, n, own)) for name in ("flow", "pace")}
        ground, moving = _Ground(cell), []
        for message in parsed(messages):
            at = np.searchsorted(cell, ints_of(message, "cell", n_cells_of(message)))
            _fill_rows(rows, at, message.cells)
            for name, column in turning.items():
                of_cells = floats_of(message.schedule, name, at.size * slots * own).reshape(at.size, slots, own)
                column[:, at] = of_cells.swapaxes(0, 1)
            ground.add(message, at)
            moving.append(manoeuvres_of(message.motion))
        _fill_rows(rows, np.array([n]), shared.place_free)
        motion = _in_order([*moving, manoeuvres_of(shared.place_free_motion)])
        part = None
        tessellation: Tessellation = ground.tessellation(self._grid, of_grid=shared.HasField("grid"), is_part=is_part)
        if is_part:
            number = motion["number"][motion["cell"] >= 0]
            part = Part(cell=cell, manoeuvre=number, traffic=self._traffic_in(tessellation, cell))
        _renumber(motion, cell, self._n_placed, drops=is_part)
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
            motion=motion_of(motion, shared.place_free_motion),
            schedule=schedule,
            refit=None if is_part else self._refit,
            part=part,
        )

    def _traffic_in(self, tessellation: Tessellation, cell: IntArray) -> Traffic | None:
        """That of the whole map, for positions in some of its cells."""
        if self._traffic is None:
            self._traffic = (self._counted(tessellation, cell),)
        (traffic,) = self._traffic
        return None if traffic is None else traffic.located_in(tessellation, cell)

    def _counted(self, tessellation: Tessellation, cell: IntArray) -> Traffic | None:
        """Traffic by all tiles, one after the other, with numbers of half the size."""
        n, narrow = self._n_placed, cast(Any, np.int32)
        first = np.empty(n + 1, np.int64)
        for head in self._heads:
            first[head.manoeuvre + 1] = head.n_following
        first[0] = 0
        np.cumsum(first, out=first)
        of = Passages(
            cell=np.empty(n, narrow), mode=np.empty(n, narrow), visits=np.empty(n), seconds=np.empty(n), first=first,
            following=np.empty(first[-1], narrow), count=np.empty(first[-1]),
        )  # fmt: skip
        bounds = {"cell": self.n_cells, "mode": self._shared.n_modes, "following": narrow(0x7FFFFFFF)}
        area, center = np.empty(self.n_cells), np.empty((self.n_cells, 2))
        for message in parsed(self._messages):
            head = self._heads[message.tile]
            area[head.cell], center[head.cell] = floats_of(message, "area", head.cell.size), centers_of(message)
            columns, (transition, _) = motion_columns(message.motion, _COUNTED), ranges(first, head.manoeuvre)
            for name, column in columns.items():
                if name in bounds and not ((column >= 0) & (column < bounds[name])).all():
                    raise ValueError(f"motion: {name}: expected numbers 0 to {bounds[name] - 1}, got others")
                getattr(of, name)[transition if name in _OF_TRANSITIONS else head.manoeuvre] = column
        return Traffic.counted(of, area, center, tessellation, cell)


_OF_TRANSITIONS = ("following", "count")
_COUNTED = ("cell", "mode", "visits", "seconds", *_OF_TRANSITIONS)


class _Ground:
    """Where cells are, as it comes.

    Args:
        cell: (n,) the numbers of all that will.
    """

    def __init__(self, cell: IntArray) -> None:
        self._cell = cell
        self._place, self._area = np.empty((cell.size, 2)), np.empty(cell.size)
        self._square: list[IntArray] = [NO_NUMBERS]
        self._beside: list[IntArray] = [NO_NUMBERS]
        self._beside_place: list[FloatArray] = [np.empty((0, 2))]

    def add(self, message: dirprim_pb2.PrimitiveMap, at: IntArray) -> None:
        """Take the ground of a tile, whose cells are `at` (n,)."""
        self._area[at] = floats_of(message, "area", at.size)
        if message.HasField("grid"):
            self._square.append(ints_of(message.grid, "square", at.size))
            return
        cells, n_beside = message.voronoi, len(message.voronoi.beside)
        self._place[at] = places_of(cells, "x", "y", at.size)
        self._square.append(ints_of(cells.region, "square", len(cells.region.square)))
        self._beside.append(ints_of(cells, "beside", n_beside))
        self._beside_place.append(places_of(cells, "beside_x", "beside_y", n_beside))

    def tessellation(self, grid: dict[str, Any], *, of_grid: bool, is_part: bool) -> Tessellation:
        """The cells.

        Raises:
            ValueError: numbers that make none.
        """
        squares = GridTessellation(**grid, square=np.sort(np.concatenate(self._square)))
        if not is_part:
            return squares if of_grid else VoronoiTessellation(generators=self._place, region=squares)
        if of_grid:
            return LocatedPart.of(squares, np.arange(squares.n_cells), self._area)
        number = np.concatenate([self._cell, *self._beside])
        number, first = np.unique(number, return_index=True)
        generators = np.concatenate([self._place, *self._beside_place])[first]
        all_here = VoronoiTessellation(generators=generators, region=squares)
        return LocatedPart.of(all_here, np.searchsorted(number, self._cell), self._area)


def _numbered(what: str, numbers: list[IntArray]) -> IntArray:
    """(n,) all numbers of cells or manoeuvres, ascending, if they are 0 to n - 1."""
    every = np.sort(np.concatenate(numbers))
    if not np.array_equal(every, np.arange(every.size)):
        raise DecodeError(f"{what}: expected numbers 0 to {every.size - 1}, each once, got others")
    return every


def _in_order(parts: list[Columns]) -> Columns:
    """Columns of manoeuvres in order of their numbers; what they are joined of is let go of as soon as it is."""
    lengths = [part.pop("n_following") for part in parts]
    order = np.argsort(np.concatenate([part["number"] for part in parts]), kind="stable")
    transition, first = ranges(np.append(0, np.cumsum(np.concatenate(lengths))), order)
    return {"first": first} | {
        name: np.concatenate([part.pop(name) for part in parts])[transition if name in _OF_TRANSITIONS else order]
        for name in list(parts[0])
    }


def _renumber(motion: Columns, cell: IntArray, n_placed: int, *, drops: bool) -> None:
    """Number manoeuvres, and their cells, on from 0; without the transitions to others where these are dropped."""
    number, following, placed = motion.pop("number"), motion["following"], motion["cell"] >= 0
    n = n_placed + int((~placed).sum())
    if ((following < 0) | (following >= n)).any():
        raise ValueError(f"first, following: expected transitions to manoeuvres 0 to {n - 1}")
    of_cell = renumbered(motion["cell"], cell)
    if (of_cell[placed] < 0).any():
        raise ValueError(f"motion: expected manoeuvres of {cell.size} cells, got others")
    motion["cell"] = np.where(placed, of_cell, motion["cell"])
    to = renumbered(following, number)
    if drops:
        source = np.repeat(np.arange(number.size), np.diff(motion["first"]))[to >= 0]
        motion["first"] = np.append(0, np.cumsum(np.bincount(source, minlength=number.size)))
        motion["count"] = motion["count"][to >= 0]
    motion["following"] = to[to >= 0] if drops else to


def _fill_rows(rows: dict[str, Any], to: IntArray, part: dirprim_pb2.Primitives) -> None:
    """Rows `to` (n,), of a message's n."""
    n, m = to.size, rows["weight"].shape[1]
    for name in MODE_COLUMNS[:5]:
        rows[name][to] = floats_of(part, name, n * m).reshape(n, m)
    for slope in ("bend", "gain"):
        for i, axis in enumerate(("east", "north")):
            rows[slope][to, :, i] = floats_of(part, f"{slope}_{axis}", n * m).reshape(n, m)
    rows["n_rows"][to] = ints_of(part, "n_rows", n)
