"""Tiles of a store's lattice: of each it is known which recordings have steps in it."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import NamedTuple, Self

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.store.lattice import Lattice, square_of, unpacked
from dirprim_filter.store.manifest import Entry
from dirprim_filter.store.steps import PASSED_SQUARES
from dirprim_filter.store.tallies import Tally

TILE_SQUARES = 128
"""Side of a tile, a multiple of `steps.PASSED_SQUARES`: vehicles are counted within one."""
HALO_M = 96.0
"""Metres around a tile that are learned from, at least: what distinguishes manoeuvres lies so far ahead."""
Tile = tuple[int, int]
"""East and north, counted from the origin of the lattice."""


def tiles_of(state: IntArray) -> IntArray:
    """(t, 2) the tiles that states are in, in order. (n,)."""
    _, row = np.unique(square_of(state), return_index=True)
    east, north, _, _ = unpacked(state[row])
    return np.unique(np.column_stack([east, north]) // TILE_SQUARES, axis=0)


def traffic_of(passed: Tally) -> Tally:
    """How many vehicles passed places in each tile, summed over its places and ways; `passed` as of `Summary`."""
    east, north, _, _ = unpacked(passed.key[:, 0])
    return Tally.of(np.column_stack([east, north]) // (TILE_SQUARES // PASSED_SQUARES), passed.value)


def tiles_at(position: FloatArray, lattice: Lattice) -> IntArray:
    """(n, 2) the tile of each position. (n, 2) metres."""
    return np.floor(position / (TILE_SQUARES * lattice.square_m)).astype(np.int64)


def around(tiles: Iterable[Tile], rings: int) -> set[Tile]:
    """Tiles, and those up to so many rings around them."""
    beside = range(-rings, rings + 1)
    return {(east + i, north + j) for east, north in tiles for i in beside for j in beside}


class Whereabouts(NamedTuple):
    """Which recordings have steps in which tiles."""

    name: list[str]  # of all recordings, in order
    tile: IntArray  # (t, 2)
    of: IntArray  # (t,) the number of the recording

    @classmethod
    def of_all(cls, recorded: Mapping[str, list[list[int]]]) -> Self:
        """Of what counts in a store, see `Store.recorded`."""
        name = sorted(recorded)
        tile = [each for one in name for each in recorded[one]]
        of = np.repeat(np.arange(len(name)), [len(recorded[one]) for one in name])
        return cls(name, np.array(tile, np.int64).reshape(-1, 2), of)

    def near(self, low: FloatArray, high: FloatArray, lattice: Lattice) -> list[tuple[int, str]]:
        """Number and name of the recordings with steps in tiles that a box meets: its corners (2,), (2,), metres."""
        side_m = TILE_SQUARES * lattice.square_m
        meets = ((self.tile * side_m < high) & ((self.tile + 1) * side_m > low)).all(axis=1)
        return [(i, self.name[i]) for i in np.unique(self.of[meets]).tolist()]


def ends_of(
    recorded: Mapping[str, list[list[int]]], entries: Iterable[Entry], archived: Mapping[str, str]
) -> dict[Tile, int]:
    """When the last recording ends that has steps in a tile, nanoseconds since 1970-01-01.

    Args:
        recorded: what counts in a store, see `Store.recorded`.
        entries: its logs.
        archived: see `Store.archived`.
    """
    there = {(name, tile[0], tile[1]) for name, tiles in recorded.items() for tile in tiles}
    ends: dict[Tile, int] = {}
    for entry in entries:
        name = archived.get(entry.rows, entry.rows)
        for east, north in entry.tiles:
            if (name, east, north) in there:  # of a recording in an archive vehicles may be gone
                ends[east, north] = max(entry.end_ns, ends.get((east, north), entry.end_ns))
    return ends


class Digests(NamedTuple):
    """Which recordings have steps in which tile, as a number of 64 bits for each tile."""

    tile: IntArray  # (t, 2) in order
    digest: IntArray  # (t,)

    @classmethod
    def of(cls, recorded: Mapping[str, list[list[int]]]) -> Self:
        """Of what counts in a store, see `Store.recorded`."""
        recordings: defaultdict[Tile, set[str]] = defaultdict(set)
        for name, tiles in recorded.items():
            for east, north in tiles:
                recordings[east, north].add(name)
        found = sorted(recordings)
        number = [hashlib.sha256(" ".join(sorted(recordings[tile])).encode()).digest()[:8] for tile in found]
        return cls(
            np.array(found, np.int64).reshape(-1, 2),
            np.array([int.from_bytes(each, "little", signed=True) for each in number], np.int64),
        )

    def changed(self, other: Digests) -> set[Tile]:
        """The tiles whose recordings are not the same."""
        ours, theirs = (dict(zip(map(tuple, d.tile.tolist()), d.digest.tolist(), strict=True)) for d in (self, other))
        return {(tile[0], tile[1]) for tile in ours.keys() | theirs.keys() if ours.get(tile) != theirs.get(tile)}
