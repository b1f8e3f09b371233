"""Fitting the tiles of a map: squares of a few tiles, each a task that needs nothing of the others."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from typing import NamedTuple, Self

import numpy as np

from dirprim_filter.arrays import IntArray
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.refit import Counted, Refit
from dirprim_filter.store.basis import Basis
from dirprim_filter.store.fading import Fading
from dirprim_filter.store.lattice import Lattice
from dirprim_filter.store.recorded_ways import Box, recordings_at, sampled
from dirprim_filter.store.store import Store
from dirprim_filter.store.tile_fit import Finished, TileFit
from dirprim_filter.store.tiles import HALO_M, TILE_SQUARES, Tile, Whereabouts, around, tiles_at

READ_TILES = 4
"""Side of the squares of tiles whose recordings are read once for all of them."""


class Square(NamedTuple):
    """Tiles that are fitted together."""

    tiles: list[Tile]
    changed: set[Tile]  # of them, those where it is of interest what no cell covers
    recordings: list[tuple[int, str]]  # see `recordings_at`


class Fitted(NamedTuple):
    """What came of a square."""

    tiles: dict[Tile, Finished]
    n_rows: int  # in changed tiles
    n_outside: int  # of these, where no cell is


class Fitting(NamedTuple):
    """What the tiles of a map are fitted by."""

    basis: Basis
    homes: dict[Tile, IntArray]  # which cells have their centres there
    store: Store
    counted: Counted
    ends: dict[Tile, int]  # see `ends_of`

    @classmethod
    def of(cls, learned: PrimitiveMap, refit: Refit, counted: Counted, store: Store, ends: dict[Tile, int]) -> Self:
        """Of a map, and the store that its tiles are fitted to."""
        return cls(Basis.of(learned, refit), _homes(learned, store.config.lattice), store, counted, ends)

    @property
    def halo_m(self) -> float:
        """Metres around a tile that are learned from."""
        return max(HALO_M, self.basis.reach_m)

    @property
    def rings(self) -> int:
        """Tiles around one that its halo reaches into."""
        return int(np.ceil(self.halo_m / self._side_m))

    @property
    def _side_m(self) -> float:
        return TILE_SQUARES * self.store.config.lattice.square_m

    def squares(self, tiles: Iterable[Tile], changed: set[Tile], there: Whereabouts) -> list[Square]:
        """Tiles whose recordings are read together, in order, and those that changed."""
        found: defaultdict[Tile, list[Tile]] = defaultdict(list)
        for east, north in sorted(tiles):
            found[east // READ_TILES, north // READ_TILES].append((east, north))
        lattice = self.store.config.lattice
        return [
            Square(some, changed & set(some), recordings_at(self.boxes(some), there, lattice))
            for some in found.values()
        ]

    def boxes(self, tiles: list[Tile]) -> list[Box]:
        """In and around each."""
        side_m, halo_m = self._side_m, self.halo_m
        boxes = []
        for tile in tiles:
            low, fading = np.array(tile) * side_m, self.fading(tile)
            boxes.append(Box(low - halo_m, low + side_m + halo_m, fading and fading.slowly))
        return boxes

    def fading(self, tile: Tile) -> Fading | None:
        """How vehicles age there: a place ages as it is seen anew."""
        if not self.counted.half_life_s:
            return None
        end_ns = max((self.ends[near] for near in around({tile}, self.rings) & self.ends.keys()), default=0)
        return Fading(half_life_s=self.counted.half_life_s, now_ns=self.counted.now_ns).until(end_ns)


def fitted_square(square: Square, fitting: Fitting) -> Fitted:
    """The tiles that have cells, and what none covers in those that changed."""
    found, n_rows, n_outside = {}, 0, 0
    store, basis, counted = fitting.store, fitting.basis, fitting.counted
    samples = sampled(
        store, fitting.boxes(square.tiles), most_rows=counted.most_rows, min_vehicles=counted.min_vehicles,
        recordings=square.recordings,
    )  # fmt: skip
    for tile, sample in zip(square.tiles, samples, strict=True):
        if tile in fitting.homes:
            fit = TileFit.of(basis, fitting.homes[tile], tile, sample, fading=fitting.fading(tile))
            found[tile] = fit.finished(basis, counted)
        if tile in square.changed:
            position = sample.ways.position
            here = position[(tiles_at(position, store.config.lattice) == tile).all(axis=1)]
            n_outside += int(np.count_nonzero(basis.own.cells.cell_of(here) < 0))
            n_rows += len(here)
    return Fitted(found, n_rows, n_outside)


def _homes(learned: PrimitiveMap, lattice: Lattice) -> dict[Tile, IntArray]:
    """The tiles that centres of cells lie in, and which cells these are."""
    tile, of = np.unique(tiles_at(learned.tessellation.centers, lattice), axis=0, return_inverse=True)
    order = np.argsort(of, kind="stable")
    cells = np.split(order, np.cumsum(np.bincount(of, minlength=len(tile)))[:-1])
    return {(east, north): own for (east, north), own in zip(tile.tolist(), cells, strict=True)}
