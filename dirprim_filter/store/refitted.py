"""A map whose cells are in part those that were, and in part fitted anew."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.primitives.motion import FLOATS, Motion
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.schedule import Schedule
from dirprim_filter.store.contents import FILLERS, Contents
from dirprim_filter.store.passages import Passages
from dirprim_filter.store.tile_fit import Finished
from dirprim_filter.store.tiles import Tile


def refitted(
    learned: PrimitiveMap, finished: dict[Tile, Finished], stale: set[Tile], min_vehicles: int
) -> PrimitiveMap:  # fmt: skip
    """The map with the cells of stale tiles fitted anew, and the transitions from and to them counted anew.

    Args:
        learned: the map as it was.
        finished: of the stale tiles, and of those whose cells vehicles go to from there or come from.
        stale: tiles.
        min_vehicles: what fewer did is left out.
    """
    former, n_cells = Contents.of(learned), learned.tessellation.n_cells
    new = [(finished[tile].cells, finished[tile].contents) for tile in sorted(stale)]
    rows = _Rows.of(former, n_cells, new)
    numbers = _Manoeuvres.of(former, n_cells, new, rows.n_own)
    transition = _transitions(learned, numbers, finished, min_vehicles)
    motion = replace(
        learned.motion, **numbers.column, first=transition.indptr.astype(np.int64),
        following=transition.indices.astype(np.int64), count=transition.data.astype(np.float64),
    )  # fmt: skip
    return rows.of_map(learned, motion)


@dataclass(frozen=True, slots=True)
class _Rows:
    """Columns of primitives, of no more modes than a cell has."""

    column: dict[str, FloatArray]  # (n_cells + 1, modes, ...)
    n_rows: IntArray
    n_own: int
    n_borrowed: int
    schedule: Schedule | None

    @classmethod
    def of(cls, former: Contents, n_cells: int, new: list[tuple[IntArray, Contents]]) -> _Rows:
        kept = np.ones(n_cells, np.bool_)
        for cells, _ in new:
            kept[cells] = False
        sources = [(np.flatnonzero(kept), former, np.flatnonzero(kept))]
        sources += [(cells, part, np.arange(cells.size)) for cells, part in new]
        used = [_used(part, own) for _, part, own in sources]
        n_own, n_borrowed = max(1, *(u[0] for u in used)) + 1, max(u[1] for u in used)
        k = former.column["weight"].shape[1] - former.n_own_modes - former.n_borrowed_modes  # place-free
        column = {
            name: np.full((kept.size + 1, n_own + n_borrowed + k, *values.shape[2:]), FILLERS[name])
            for name, values in former.column.items()
        }
        n_rows = np.zeros(kept.size + 1, np.int64)
        for cells, part, own in [*sources, (np.array([-1]), former, np.array([-1]))]:
            moves, stands = part.n_own_modes - 1, n_own - 1
            m, b = min(moves, stands), min(part.n_borrowed_modes, n_borrowed)
            for name, values in part.column.items():
                into, of = column[name], values[own]
                into[cells, :m], into[cells, stands] = of[:, :m], of[:, moves]
                into[cells, n_own : n_own + b] = of[:, moves + 1 : moves + 1 + b]
                into[cells, n_own + n_borrowed :] = of[:, of.shape[1] - k :]
            n_rows[cells] = part.n_rows[own]
        n_rows[-1] = n_rows[:-1].sum()
        return cls(column, n_rows, n_own, n_borrowed, _schedule_of(former, kept.size, sources, n_own))

    def of_map(self, learned: PrimitiveMap, motion: Motion) -> PrimitiveMap:
        """The map with these columns."""
        c = self.column
        return replace(
            learned, n_rows=self.n_rows, n_borrowed_modes=self.n_borrowed, motion=motion,
            direction=VonMisesMixture(
                weight=c["weight"], mean_direction=c["mean_direction"], concentration=c["concentration"]
            ),
            speed=Gamma(shape=c["shape"], rate=c["rate"]), bend=c["bend"], gain=c["gain"],
            schedule=self.schedule,
        )  # fmt: skip


def _schedule_of(
    former: Contents, n_cells: int, sources: list[tuple[IntArray, Contents, IntArray]], n_own: int
) -> Schedule | None:  # fmt: skip
    """Of so many modes; `sources` are cells, the map that they come from, and which they are there."""
    if former.schedule is None:
        return None
    flow, pace = np.ones((2, len(former.schedule.flow), n_cells, n_own))
    for cells, part, own in sources:
        if part.schedule is None:
            raise ValueError("schedule: expected one of every part, got none")
        m = min(part.n_own_modes, n_own) - 1
        for into, of in ((flow, part.schedule.flow), (pace, part.schedule.pace)):
            into[:, cells, :m], into[:, cells, -1] = of[:, own, :m], of[:, own, -1]
    return replace(former.schedule, flow=flow, pace=pace)


def _used(part: Contents, rows: IntArray) -> tuple[int, int]:
    """How many columns of modes in motion, and of borrowed ones, rows need."""
    moves, weight = part.n_own_modes - 1, part.column["weight"][rows]
    own, borrowed = weight[:, :moves], weight[:, moves + 1 : moves + 1 + part.n_borrowed_modes]
    return tuple(int(np.flatnonzero(w.any(axis=0)).max(initial=-1)) + 1 for w in (own, borrowed))  # type: ignore[return-value]


@dataclass(frozen=True, slots=True)
class _Manoeuvres:
    """Columns of manoeuvres in order of their cells, and which of them are those that were."""

    column: dict[str, Any]
    former: IntArray  # (all that were,) their numbers now; -1 of those that are no more
    renewed: BoolArray  # (z,) whether fitted anew

    @classmethod
    def of(cls, former: Contents, n_cells: int, new: list[tuple[IntArray, Contents]], n_own: int) -> _Manoeuvres:
        gone = np.zeros(n_cells + 1, np.bool_)
        for cells, _ in new:
            gone[cells] = True
        kept = np.flatnonzero(~gone[former.motion.cell])  # of no place is of cell -1, the last, which stays
        sources = [(former, kept, former.motion.cell[kept])]
        sources += [(part, np.arange(part.motion.n_placed), cells[part.motion.cell[: part.motion.n_placed]])
                    for cells, part in new]  # fmt: skip
        cell = np.concatenate([of for _, _, of in sources])
        order = np.argsort(np.where(cell < 0, gone.size, cell), kind="stable")
        column = {
            name: np.concatenate([getattr(part.motion, name)[own] for part, own, _ in sources])[order]
            for name in FLOATS
        }
        mode = np.concatenate([
            np.where((part.motion.mode[own] == part.n_own_modes - 1) & (of >= 0), n_own - 1, part.motion.mode[own])
            for part, own, of in sources
        ])  # fmt: skip
        column |= {"cell": cell[order], "mode": mode[order]}
        now = np.empty(order.size, np.int64)
        now[order] = np.arange(order.size)
        number = np.full(len(former.motion), -1)
        number[kept] = now[: kept.size]
        return cls(column, number, order >= kept.size)

    def of_cells(self, cells: IntArray) -> IntArray:
        """Those of some cells (c,), ascending."""
        cell = self.column["cell"][: np.count_nonzero(self.column["cell"] >= 0)]
        begin, end = (np.searchsorted(cell, cells, side=side) for side in ("left", "right"))
        length = end - begin
        return np.asarray(np.arange(length.sum()) + np.repeat(begin - np.cumsum(length) + length, length))


def _transitions(
    learned: PrimitiveMap, numbers: _Manoeuvres, finished: dict[Tile, Finished], min_vehicles: int
) -> csr_array:
    """(z, z) how often one manoeuvre followed the other, of all ways: in tiles, from one to another, and as before."""
    z, motion = numbers.renewed.size, learned.motion
    flow, share, tile = np.ones(z), np.ones(z), np.full(z, -1)
    ends = []
    source = np.repeat(np.arange(len(motion)), np.diff(motion.first))
    before, after = numbers.former[source], numbers.former[motion.following]
    kept = (before >= 0) & (after >= 0)
    former = csr_array((motion.count[kept], (before[kept], after[kept])), shape=(z, z))
    for i, part in enumerate(finished.values()):
        of_part = numbers.of_cells(part.cells)
        flow[of_part], share[of_part], tile[of_part] = part.flow[: of_part.size], part.share, i
        known = part.ends.manoeuvre >= 0
        number = np.full(part.ends.manoeuvre.size, -1)
        number[known] = of_part[part.ends.manoeuvre[known]]
        ends.append(part.ends._replace(manoeuvre=number))
    followed = Passages.together(ends).followed()
    renewed = numbers.renewed[followed.one] | numbers.renewed[followed.other]
    across = followed.some(renewed & (tile[followed.one] != tile[followed.other])).counted(z, min_vehicles).tocoo()
    one, other, count = [np.asarray(across.row, np.int64)], [np.asarray(across.col, np.int64)], [across.data]
    for i, part in enumerate(finished.values()):
        of_part, inner = np.flatnonzero(tile == i), part.inner.tocoo()
        if numbers.renewed[of_part].any():
            one.append(of_part[inner.row])
            other.append(of_part[inner.col])
            count.append(inner.data)
    row, column = np.concatenate(one), np.concatenate(other)
    anew = csr_array((np.concatenate(count) * flow[column] / share[row], (row, column)), shape=(z, z))
    total = csr_array(former + anew)
    total.eliminate_zeros()
    total.sort_indices()
    return total
