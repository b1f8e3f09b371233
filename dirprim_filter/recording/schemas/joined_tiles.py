"""A map, or a part of one, out of its tiles.

Source of the tables: `map_tiles`. What they hold is checked where it is made into a value: numbers of cells and
manoeuvres here, all others by `Motion`, `PrimitiveMap` and what these consist of.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dirprim_filter.arrays import AnyArray, IntArray
from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.primitives.leader import LeaderResponse
from dirprim_filter.primitives.motion import FLOATS, Motion
from dirprim_filter.primitives.part import Part, renumbered
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.traffic import Passages, Totals, Traffic
from dirprim_filter.recording.schemas.arrow_message import ArrowMessage, Columns
from dirprim_filter.recording.schemas.map_tiles import LEADER, MANOEUVRE, ROW, ranges
from tessellation import GridTessellation, Tessellation, VoronoiTessellation
from tessellation.located_part import LocatedPart

MOST_MODES = 4096
"""Of a cell: no map has so many, and kernels make room for them."""


class JoinedTiles:
    """Tiles of one map as one.

    Args:
        shared: what every tile repeats.
        tiles: at least one.
        n_placed: manoeuvres of places in the whole map; left out, all are here.

    Attributes:
        number: (n,) which cells of the map are here, ascending.

    Raises:
        ValueError: a table or a column is missing, or of another type.
    """

    def __init__(self, shared: ArrowMessage, tiles: Sequence[ArrowMessage], *, n_placed: int | None = None) -> None:
        self._shared, self._tiles, self._of_grid = shared, tiles, shared.text("kind") == "grid"
        if shared.text("kind") not in ("grid", "voronoi"):
            raise ValueError(f"kind: expected grid or voronoi, got {shared.text('kind')!r}")
        self._cells = self._joined("cell", floats=(*ROW, "area", "place"), whole=("number", "n_rows"))
        order = np.argsort(self._cells["number"], kind="stable")
        self._cells = {name: column[order] for name, column in self._cells.items()}
        self.number: IntArray = self._cells.pop("number")
        parts = [_manoeuvres(tile, "manoeuvre", "transition", with_arrived=True) for tile in tiles]
        free = _manoeuvres(shared, "free_manoeuvre", "free_transition")
        parts.append(free | {"arrived": np.zeros(free["cell"].size)})
        self._motion, here = _in_order(parts), int(sum((part["cell"] >= 0).sum() for part in parts))
        self._n_placed = here if n_placed is None else n_placed

    def _joined(self, name: str, **columns: Any) -> Columns:
        parts = [tile.table(name, **columns) for tile in self._tiles]
        widths = {of: {column.shape[1:] for column in (part[of] for part in parts)} for of in parts[0]}
        if uneven := [of for of, shapes in widths.items() if len(shapes) > 1]:
            raise ValueError(f"{name}.{uneven[0]}: expected tiles of one map, got tiles of several")
        return {of: np.concatenate([part[of] for part in parts]) for of in parts[0]}

    def whole(self) -> PrimitiveMap:
        """The map, where all tiles are here.

        Raises:
            ValueError: numbers that make none.
        """
        if not np.array_equal(self.number, np.arange(self.number.size)):
            raise ValueError(f"cells: expected numbers 0 to {self.number.size - 1}, each once, got others")
        if not np.array_equal(self._renumbered(), np.arange(self._n_placed)):
            raise ValueError(f"manoeuvres: expected numbers 0 to {self._n_placed - 1}, each once, got others")
        squares = self._squares()
        cells = squares if self._of_grid else VoronoiTessellation(generators=self._cells["place"], region=squares)
        return self._map(cells)

    def part(self, totals: Totals | None) -> PrimitiveMap:
        """The map of these tiles alone, and its traffic if there are totals of the whole's.

        Raises:
            ValueError: numbers that make none.
        """
        cells, number = self._located(), self._renumbered()
        if not are_some_of(number, self._n_placed):
            raise ValueError(f"manoeuvres: expected numbers 0 to {self._n_placed - 1}, each once, got others")
        arrived = self._motion["arrived"][: number.size]
        if not (np.isfinite(arrived) & (arrived >= 0)).all():
            raise ValueError("arrived: expected no negative and no infinite numbers")
        traffic = None if totals is None else Traffic.of_part(_passages(self._motion, number), arrived, cells, totals)
        _drop_others(self._motion)
        return self._map(cells, part=Part(cell=self.number, manoeuvre=number, traffic=traffic))

    def _renumbered(self) -> IntArray:
        """Number manoeuvres, and their cells, on from 0; those that are not here -1. -> (z,) of places, their numbers.

        Raises:
            ValueError: transitions to manoeuvres that the whole map does not have, or cells that are not here.
        """
        motion = self._motion
        number, following, placed = motion["number"], motion["following"], motion["cell"] >= 0
        n = self._n_placed + int((~placed).sum())
        if ((following < 0) | (following >= n)).any():
            raise ValueError(f"following: expected transitions to manoeuvres 0 to {n - 1}")
        of_cell = renumbered(motion["cell"], self.number)
        if (of_cell[placed] < 0).any():
            raise ValueError(f"motion: expected manoeuvres of {self.number.size} cells, got others")
        motion["cell"] = np.where(placed, of_cell, motion["cell"])
        motion["following"] = renumbered(following, number)
        return np.asarray(number[placed])

    def _squares(self) -> GridTessellation:
        of = self._shared
        square = [tile.table("square", whole=("number",))["number"] for tile in self._tiles]
        return GridTessellation(
            origin=np.array([of.number("origin_x"), of.number("origin_y")]), cell_size=of.number("cell_size"),
            n_x=of.whole_number("n_x"), n_y=of.whole_number("n_y"), square=np.sort(np.concatenate(square)),
        )  # fmt: skip

    def _located(self) -> LocatedPart:
        """The cells, with the borders that they have among all."""
        squares = self._squares()
        if self._of_grid:
            return LocatedPart.of(squares, np.arange(squares.n_cells), self._cells["area"])
        beside = self._joined("beside", whole=("cell",), floats=("place",))
        number, first = np.unique(np.concatenate([self.number, beside["cell"]]), return_index=True)
        generators = np.concatenate([self._cells["place"], beside["place"]])[first]
        all_here = VoronoiTessellation(generators=generators, region=squares)
        return LocatedPart.of(all_here, np.searchsorted(number, self.number), self._cells["area"])

    def _map(self, cells: Tessellation, *, part: Part | None = None) -> PrimitiveMap:
        shared, of = self._shared, self._cells
        last = shared.table("place_free", floats=ROW, whole=("n_rows",))
        if any(last[name].shape != (1, *of[name].shape[1:]) for name in last) or of["weight"].shape[-1] > MOST_MODES:
            raise ValueError(f"place_free: expected one row, as wide as those of the cells, at most {MOST_MODES} modes")
        rows = {name: np.concatenate([of[name], last[name]]) for name in last}
        n, m = rows["weight"].shape
        return PrimitiveMap(
            tessellation=cells,
            direction=VonMisesMixture(**{name: rows[name] for name in ROW[:3]}),
            speed=Gamma(**{name: rows[name] for name in ROW[3:5]}),
            n_rows=rows["n_rows"],
            n_place_free_modes=shared.whole_number("n_place_free_modes"),
            **{name: _folded(name, rows[name], (n, m, 2)) for name in ROW[5:]},
            motion=self._whole_motion(),
            part=part,
        )

    def _whole_motion(self) -> Motion:
        shared, motion = self._shared, self._motion
        leaders = shared.table("leader", floats=LEADER)
        of_leader: list[dict[str, Any]] = [
            {name: column[i] if column.ndim > 1 else float(column[i]) for name, column in leaders.items()}
            for i in range(shared.rows("leader"))
        ]
        columns: dict[str, Any] = {
            name: motion[name] for name in (*FLOATS, "cell", "mode", "first", "following", "count")
        }
        columns |= {name: shared.number(name) for name in ("course_rate", "strength", "spread")}
        return Motion(**columns, leader=LeaderResponse(**of_leader[0]) if of_leader else None)


def are_some_of(number: IntArray, n: int) -> bool:
    """Whether numbers (k,) are some of 0 to n - 1, ascending, each once."""
    return not number.size or bool(number[0] >= 0 and (number[1:] > number[:-1]).all() and number[-1] < n)


def _folded(name: str, column: AnyArray, shape: tuple[int, ...]) -> AnyArray:
    if column.size != np.prod(shape):
        raise ValueError(f"{name}: expected {shape} numbers, got {column.shape}")
    return column.reshape(shape)


def _manoeuvres(of: ArrowMessage, name: str, transitions: str, *, with_arrived: bool = False) -> Columns:
    """Columns of manoeuvres and of the transitions from them."""
    floats = (*FLOATS, "arrived") if with_arrived else FLOATS
    columns = of.table(name, floats=floats, whole=MANOEUVRE)
    after, n = of.table(transitions, floats=("count",), whole=("following",)), columns["n_following"]
    if ((n < 0) | (n > after["count"].size)).any() or n.sum() != after["count"].size:
        raise ValueError(f"n_following: expected numbers that sum to {after['count'].size} transitions, got others")
    return columns | after


def _in_order(parts: list[Columns]) -> Columns:
    """Columns of manoeuvres in order of their numbers, with `first` for where their transitions begin."""
    order = np.argsort(np.concatenate([part["number"] for part in parts]), kind="stable")
    n_following = np.concatenate([part["n_following"] for part in parts])
    transition, first = ranges(np.append(0, np.cumsum(n_following)), order)
    columns: Columns = {"first": first}
    for name in parts[0].keys() - {"n_following"}:
        column = np.concatenate([part[name] for part in parts])
        columns[name] = column[transition if name in ("following", "count") else order]
    return columns


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
    for name in ("following", "count"):
        motion[name] = motion[name][here]
