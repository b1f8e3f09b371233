"""A map out of its messages: whole, or the tiles of it that are wanted.

Of a map in parts its summary is read, and no tile before it is wanted.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Protocol

import numpy as np

from dirprim_filter.arrays import IntArray
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording.schemas.arrow_message import ArrowMessage
from dirprim_filter.recording.schemas.joined_tiles import JoinedTiles, are_some_of
from dirprim_filter.recording.schemas.map_summary import MapSummary, check_version
from dirprim_filter.recording.schemas.map_tiles import SHARED
from tessellation.tiles import BLOCK_SQUARES

DENSE_SQUARES = 1 << 18
"""Up to so many squares, 1.5 km at 3 m, a raster of the whole map is small."""
WHOLE_CELLS = 20_000
"""A map of no more is read whole: it takes 0.2 GB with all that is made of it."""
SEVERAL = "expected the tiles of one map, got tiles of several"


class Messages(Protocol):
    """The encoded tiles of a map, which can be gone through more than once."""

    def __iter__(self) -> Iterator[bytes]:
        """All of them, in an order that stays."""
        ...

    def some(self, wanted: IntArray) -> Iterable[bytes]:
        """Of these those that are wanted, by where they stand in that order."""
        ...


def opened_tiles(messages: Iterable[bytes]) -> Iterator[tuple[int, ArrowMessage]]:
    """The number of each of the tiles, and what it holds.

    Raises:
        ValueError: bytes that are no such message, or another version of it.
    """
    for data in messages:
        message = ArrowMessage(data)
        check_version(message)
        yield message.whole_number("tile"), message


def whole_map(messages: Messages) -> PrimitiveMap:
    """The map of all its tiles.

    Raises:
        ValueError: bytes that are no such message, another version of it, a tile that is missing, twice there or of
            another map, or numbers that make no map.
    """
    tiles: dict[int, ArrowMessage] = {}
    for number, tile in opened_tiles(messages):
        if number in tiles:
            raise ValueError(f"tile {number}: expected once, got twice")
        tiles[number] = tile
    if not tiles:
        raise ValueError("expected at least one tile of a map, got none")
    first = next(iter(tiles.values()))
    n_tiles = first.whole_number("n_tiles")
    # Compared by number: the count comes from the file, and a range of it could be of any length.
    if len(tiles) != n_tiles or min(tiles) != 0 or max(tiles) != n_tiles - 1:
        raise ValueError(f"expected tiles 0 to {n_tiles - 1}, got {len(tiles)} of them")
    if not all(tile is first or tile.part(SHARED).equals(first.part(SHARED)) for tile in tiles.values()):
        raise ValueError(SEVERAL)
    return JoinedTiles(first, list(tiles.values())).whole()


class TiledMap:
    """A map of which tiles can be read by themselves; those of the last part are kept.

    Args:
        messages: its tiles.
        summary: of the map.
        at: (n_tiles,) which of the messages each is.
    """

    def __init__(self, messages: Messages, summary: MapSummary, at: IntArray) -> None:
        self._messages, self._at, self.summary = messages, at, summary
        self._held: dict[int, ArrowMessage] = {}

    @property
    def is_large(self) -> bool:
        """Whether there is much to gain by reading some tiles alone: else rasters are of the whole, and small."""
        n_squares = self.summary.shared.whole_number("n_x") * self.summary.shared.whole_number("n_y")
        return self.summary.n_cells > WHOLE_CELLS and n_squares > DENSE_SQUARES

    @property
    def margin_m(self) -> float:
        """What is at a place depends on no cells farther from it than that."""
        return 2.0 * BLOCK_SQUARES * self.summary.shared.number("cell_size")

    def tiles_with(self, cell: IntArray) -> IntArray:
        """The tiles of the last part that have some cells (n,), ascending."""
        numbers = {i: tile.table("cell", whole=("number",))["number"] for i, tile in self._held.items()}
        return np.array(sorted(i for i, number in numbers.items() if np.isin(cell, number).any()), np.int64)

    def part(self, tiles: IntArray) -> PrimitiveMap:
        """The map of some tiles (n,) alone: near those it is as the whole.

        Raises:
            ValueError: numbers that make no map.
        """
        wanted = set(tiles.tolist())
        self._held = {tile: columns for tile, columns in self._held.items() if tile in wanted}
        self._read(wanted - self._held.keys())
        held = [self._held[tile] for tile in sorted(self._held)]
        joined = JoinedTiles(self.summary.shared, [self.summary.shared, *held], n_placed=self.summary.n_manoeuvres)
        if not are_some_of(joined.number, self.summary.n_cells):
            raise ValueError(f"cells: expected numbers 0 to {self.summary.n_cells - 1}, each once, got others")
        return joined.part(self.summary.totals)

    def _read(self, tiles: set[int]) -> None:
        """Take in these."""
        for number, tile in opened_tiles(self._messages.some(self._at[sorted(tiles)]) if tiles else ()):
            if number not in tiles:
                raise ValueError(f"expected tiles {sorted(tiles)}, got {number}")
            if not tile.part(SHARED).equals(self.summary.shared.part(SHARED)):
                raise ValueError(SEVERAL)
            self._held[number] = tile
        if missing := tiles - self._held.keys():
            raise ValueError(f"expected tiles {sorted(tiles)}, got none of {sorted(missing)}")


def places_in(messages: Messages, n_tiles: int) -> IntArray:
    """(n_tiles,) which of the messages each tile is, by going through them all.

    Raises:
        ValueError: a tile that is missing, or twice there.
    """
    numbers = [number for number, _ in opened_tiles(messages)]
    if len(numbers) != n_tiles or not np.array_equal(np.sort(numbers), np.arange(n_tiles)):
        raise ValueError(f"expected tiles 0 to {n_tiles - 1}, each once, got {len(numbers)} of them")
    return np.argsort(numbers)
