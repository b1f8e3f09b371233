"""A map out of its messages: whole, or the tiles of it that are wanted.

The whole is gone through twice, a message at a time: first for what is in each, then for what it holds. So no more is
held than the map that is made. Of a map in parts its summary is read, and no tile before it is wanted.

Source: dirprim.proto, see `map_tiles`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Protocol

import numpy as np
from google.protobuf.message import DecodeError

from dirprim_filter.arrays import IntArray
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording.schemas.joined_tiles import NO_NUMBERS, OF_PARTS, JoinedTiles, are_some_of
from dirprim_filter.recording.schemas.map_summary import MapSummary
from dirprim_filter.recording.schemas.tile_message import (
    TileColumns,
    check_lengths,
    columns_of,
    numbers_of,
    parsed,
    shared_part,
    the_only,
)
from tessellation.tiles import BLOCK_SQUARES

DENSE_SQUARES = 1 << 18
"""Up to so many squares, 1.5 km at 3 m, a raster of the whole map is small."""
WHOLE_CELLS = 20_000
"""A map of no more is read whole: it takes 0.2 GB with all that is made of it."""


class Messages(Protocol):
    """The encoded tiles of a map, which can be gone through more than once."""

    def __iter__(self) -> Iterator[bytes]:
        """All of them, in an order that stays."""
        ...

    def some(self, wanted: IntArray) -> Iterable[bytes]:
        """Of these those that are wanted, by where they stand in that order."""
        ...


def whole_map(messages: Messages) -> PrimitiveMap:
    """The map of all its tiles.

    Raises:
        DecodeError: bytes that are no such message, another version of it, a tile that is missing, twice there or of
            another map, columns of a wrong length, or numbers that make no map.
    """
    tiles: set[int] = set()
    shared: set[bytes] = set()
    cells, manoeuvres = [], []
    for message in parsed(messages):
        if message.tile in tiles:
            raise DecodeError(f"tile {message.tile}: expected once, got twice")
        check_lengths(message)
        tiles.add(message.tile)
        cell, manoeuvre = numbers_of(message)
        cells.append(cell)
        manoeuvres.append(manoeuvre)
        shared.add(shared_part(message))
    said = the_only(shared, tiles)
    cell, n_placed = _numbered("cells", cells), _numbered("manoeuvres", manoeuvres).size
    try:
        joined = JoinedTiles(cell, said, n_placed)
        for message in parsed(messages):
            joined.add(columns_of(message))
        return joined.whole()
    except ValueError as error:
        raise DecodeError(str(error)) from error


class TiledMap:
    """A map of which tiles can be read by themselves; those of the last part are kept.

    Args:
        messages: its tiles.
        summary: of the map.
        at: (n_tiles,) which of the messages each is.
    """

    def __init__(self, messages: Messages, summary: MapSummary, at: IntArray) -> None:
        self._messages, self._at, self.summary = messages, at, summary
        self._held: dict[int, TileColumns] = {}

    @property
    def is_large(self) -> bool:
        """Whether there is much to gain by reading some tiles alone: else rasters are of the whole, and small."""
        n_squares = self.summary.grid.n_x * self.summary.grid.n_y
        return self.summary.n_cells > WHOLE_CELLS and n_squares > DENSE_SQUARES

    @property
    def margin_m(self) -> float:
        """What is at a place depends on no cells farther from it than that."""
        return 2.0 * BLOCK_SQUARES * float(self.summary.grid.cell_size)

    def tiles_with(self, cell: IntArray) -> IntArray:
        """The tiles of the last part that have some cells (n,), ascending."""
        return np.array(sorted(i for i, tile in self._held.items() if np.isin(cell, tile.cell).any()), np.int64)

    def part(self, tiles: IntArray) -> PrimitiveMap:
        """The map of some tiles (n,) alone: near those it is as the whole.

        Raises:
            DecodeError: numbers that make no map.
        """
        wanted = set(tiles.tolist())
        self._held = {tile: columns for tile, columns in self._held.items() if tile in wanted}
        self._read(wanted - self._held.keys())
        cell = np.sort(np.concatenate([NO_NUMBERS, *(tile.cell for tile in self._held.values())]))
        if not are_some_of(cell, self.summary.n_cells):
            raise DecodeError(f"cells: expected numbers 0 to {self.summary.n_cells - 1}, each once, got others")
        try:
            joined = JoinedTiles(cell, self.summary.shared, self.summary.n_manoeuvres)
            for tile in sorted(self._held):
                joined.add(self._held[tile])
            return joined.part(self.summary.totals)
        except ValueError as error:
            raise DecodeError(str(error)) from error

    def _read(self, tiles: set[int]) -> None:
        """Take in these."""
        for message in parsed(self._messages.some(self._at[sorted(tiles)]) if tiles else ()):
            if message.tile not in tiles:
                raise DecodeError(f"expected tiles {sorted(tiles)}, got {message.tile}")
            self._held[message.tile] = columns_of(message, OF_PARTS)
            if shared_part(message) != self.summary.shared_bytes:
                raise DecodeError("expected the tiles of one map, got tiles of several")
        if missing := tiles - self._held.keys():
            raise DecodeError(f"expected tiles {sorted(tiles)}, got none of {sorted(missing)}")


def places_in(messages: Messages, n_tiles: int) -> IntArray:
    """(n_tiles,) which of the messages each tile is, by going through them all.

    Raises:
        DecodeError: a tile that is missing, or twice there.
    """
    at = np.full(n_tiles, -1)
    for i, message in enumerate(parsed(messages)):
        if message.tile >= n_tiles or at[message.tile] >= 0:
            raise DecodeError(f"tile {message.tile}: expected each of {n_tiles} once")
        at[message.tile] = i
    if (at < 0).any():
        raise DecodeError(f"expected tiles 0 to {n_tiles - 1}, got {int((at >= 0).sum())} of them")
    return at


def _numbered(what: str, numbers: list[IntArray]) -> IntArray:
    """(n,) all numbers of cells or manoeuvres, ascending, if they are 0 to n - 1."""
    every = np.sort(np.concatenate([NO_NUMBERS, *numbers]))
    if not np.array_equal(every, np.arange(every.size)):
        raise DecodeError(f"{what}: expected numbers 0 to {every.size - 1}, each once, got others")
    return every
