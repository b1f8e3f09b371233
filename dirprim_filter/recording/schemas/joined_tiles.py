"""A map, or a part of one, out of the columns of its tiles."""

from __future__ import annotations

from typing import Any

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.primitives.part import Part, renumbered
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.traffic import Passages, Totals, Traffic
from dirprim_filter.recording.schemas import dirprim_pb2
from dirprim_filter.recording.schemas.map_tiles import MODE_COLUMNS
from dirprim_filter.recording.schemas.motion_columns import ALL, OF_TRANSITIONS, motion_of, ranges
from dirprim_filter.recording.schemas.tile_message import Columns, TileColumns, manoeuvres_of, rows_of
from tessellation import GridTessellation, Tessellation, VoronoiTessellation
from tessellation.located_part import LocatedPart

NO_NUMBERS = np.empty(0, np.int64)
OF_PARTS = (*ALL, "arrived")
"""The columns of manoeuvres that it takes to make a part of a map."""


class JoinedTiles:
    """Tiles of one map, taken in one after the other.

    Args:
        cell: (n,) the numbers of all their cells, ascending.
        shared: what every tile repeats.
        n_placed: manoeuvres of places in the whole map.
    """

    def __init__(self, cell: IntArray, shared: dirprim_pb2.PrimitiveMap, n_placed: int) -> None:
        self._cell, self._shared, self._n_placed = cell, shared, n_placed
        n, m = cell.size, shared.n_modes
        self._rows: dict[str, Any] = {name: np.empty((n + 1, m)) for name in MODE_COLUMNS[:5]} | {
            "bend": np.empty((n + 1, m, 2)), "gain": np.empty((n + 1, m, 2)), "n_rows": np.empty(n + 1, np.int64),
        }  # fmt: skip
        self._place, self._area = np.empty((n, 2)), np.empty(n)
        self._square: list[IntArray] = [NO_NUMBERS]
        self._beside: list[IntArray] = [NO_NUMBERS]
        self._beside_place: list[FloatArray] = [np.empty((0, 2))]
        self._motion: list[Columns] = []
        self._fill(np.array([n]), rows_of(shared.place_free, 1, m))

    def add(self, tile: TileColumns) -> None:
        """Take in a tile."""
        at = np.searchsorted(self._cell, tile.cell)
        self._fill(at, tile.rows)
        self._area[at] = tile.area
        if self._shared.HasField("voronoi"):
            self._place[at] = tile.place
        self._square.append(tile.square)
        self._beside.append(tile.beside)
        self._beside_place.append(tile.beside_place)
        self._motion.append(dict(tile.motion))

    def _fill(self, at: IntArray, rows: Columns) -> None:
        for name, column in rows.items():
            self._rows[name][at] = column

    def whole(self) -> PrimitiveMap:
        """The map, where all tiles were taken in.

        Raises:
            ValueError: numbers that make none.
        """
        motion = _in_order([*self._motion, manoeuvres_of(self._shared.place_free_motion)])
        _renumber(motion, self._cell, self._n_placed)
        squares, of_grid = self._squares(), self._shared.HasField("grid")
        cells = squares if of_grid else VoronoiTessellation(generators=self._place, region=squares)
        return self._map(cells, motion)

    def part(self, totals: Totals | None) -> PrimitiveMap:
        """The map of these tiles alone, of columns `OF_PARTS`, and its traffic if there are totals of the whole's.

        Raises:
            ValueError: numbers that make none.
        """
        motion = _in_order([*self._motion, manoeuvres_of(self._shared.place_free_motion, OF_PARTS)])
        cells, number = self._located(), _renumber(motion, self._cell, self._n_placed)
        if not are_some_of(number, self._n_placed):
            raise ValueError(f"manoeuvres: expected numbers 0 to {self._n_placed - 1}, each once, got others")
        arrived = motion.pop("arrived")[: number.size]
        if not (np.isfinite(arrived) & (arrived >= 0)).all():
            raise ValueError("arrived: expected no negative and no infinite numbers")
        traffic = None if totals is None else Traffic.of_part(_passages(motion, number), arrived, cells, totals)
        _drop_others(motion)
        return self._map(cells, motion, part=Part(cell=self._cell, manoeuvre=number, traffic=traffic))

    def _squares(self) -> GridTessellation:
        grid = self._shared.grid if self._shared.HasField("grid") else self._shared.voronoi.region
        return GridTessellation(
            origin=np.array([grid.origin_x, grid.origin_y]), cell_size=grid.cell_size, n_x=grid.n_x, n_y=grid.n_y,
            square=np.sort(np.concatenate(self._square)),
        )  # fmt: skip

    def _located(self) -> LocatedPart:
        """The cells, with the borders that they have among all."""
        squares = self._squares()
        if self._shared.HasField("grid"):
            return LocatedPart.of(squares, np.arange(squares.n_cells), self._area)
        number = np.concatenate([self._cell, *self._beside])
        number, first = np.unique(number, return_index=True)
        generators = np.concatenate([self._place, *self._beside_place])[first]
        all_here = VoronoiTessellation(generators=generators, region=squares)
        return LocatedPart.of(all_here, np.searchsorted(number, self._cell), self._area)

    def _map(self, tessellation: Tessellation, motion: Columns, part: Part | None = None) -> PrimitiveMap:
        shared, rows = self._shared, self._rows
        return PrimitiveMap(
            tessellation=tessellation,
            direction=VonMisesMixture(
                weight=rows["weight"], mean_direction=rows["mean_direction"], concentration=rows["concentration"]
            ),
            speed=Gamma(shape=rows["shape"], rate=rows["rate"]),
            n_rows=rows["n_rows"],
            n_place_free_modes=shared.n_place_free_modes,
            bend=rows["bend"],
            gain=rows["gain"],
            motion=motion_of(motion, shared.place_free_motion),
            part=part,
        )


def are_some_of(number: IntArray, n: int) -> bool:
    """Whether numbers (k,) are some of 0 to n - 1, ascending, each once."""
    return not number.size or bool(number[0] >= 0 and (np.diff(number) > 0).all() and number[-1] < n)


def _in_order(parts: list[Columns]) -> Columns:
    """Columns of manoeuvres in order of their numbers; what they are joined of is let go of as soon as it is."""
    lengths = [part.pop("n_following") for part in parts]
    order = np.argsort(np.concatenate([part["number"] for part in parts]), kind="stable")
    transition, first = ranges(np.append(0, np.cumsum(np.concatenate(lengths))), order)
    return {"first": first} | {
        name: np.concatenate([part.pop(name) for part in parts])[transition if name in OF_TRANSITIONS else order]
        for name in list(parts[0])
    }


def _renumber(motion: Columns, cell: IntArray, n_placed: int) -> IntArray:
    """Number manoeuvres, and their cells, on from 0; those that are not here -1. -> (z,) of places, their numbers.

    Raises:
        ValueError: transitions to manoeuvres that the whole map does not have, or cells that are not here.
    """
    number, following, placed = motion.pop("number"), motion["following"], motion["cell"] >= 0
    n = n_placed + int((~placed).sum())
    if ((following < 0) | (following >= n)).any():
        raise ValueError(f"first, following: expected transitions to manoeuvres 0 to {n - 1}")
    of_cell = renumbered(motion["cell"], cell)
    if (of_cell[placed] < 0).any():
        raise ValueError(f"motion: expected manoeuvres of {cell.size} cells, got others")
    motion["cell"] = np.where(placed, of_cell, motion["cell"])
    motion["following"] = renumbered(following, number)
    return np.asarray(number[placed])


def _passages(motion: Columns, number: IntArray) -> Passages:
    """Of the manoeuvres of places, the first of all (z,)."""
    n = number.size
    source = np.repeat(np.arange(n, dtype=np.int32), np.diff(motion["first"][: n + 1]))
    target = motion["following"][: source.size]
    placed = target < n  # or elsewhere
    return Passages(
        number, motion["cell"][:n], motion["mode"][:n], motion["visits"][:n], motion["seconds"][:n], source[placed],
        target[placed].astype(np.int32), motion["count"][: source.size][placed],
    )  # fmt: skip


def _drop_others(motion: Columns) -> None:
    """Leave out the transitions to manoeuvres that are not here."""
    n, here = motion["cell"].size, motion["following"] >= 0
    source = np.repeat(np.arange(n), np.diff(motion["first"]))[here]
    motion["first"] = np.append(0, np.cumsum(np.bincount(source, minlength=n)))
    for name in OF_TRANSITIONS:
        motion[name] = motion[name][here]
