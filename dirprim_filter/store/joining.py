"""One map of those of many blocks: of each the cells that lie in it.

A vehicle that leaves a block goes on, in the block's own map, to a manoeuvre of a cell in its halo. In the joined map
that is the manoeuvre of the neighbour's cell there that is most alike in course and speed. What is of no place comes
from the block with the most rows.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import csr_array

from dirprim_filter.arrays import AnyArray, IntArray
from dirprim_filter.primitives._modes import Modes
from dirprim_filter.primitives.motion import FLOATS, Motion
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.store.blocks import Block, places_of
from tessellation import GridTessellation, Tessellation, VoronoiTessellation

COURSE, LOG_PACE = 0.2, 0.25
"""Radians, and of log(speed + 0.3 m/s): by so much manoeuvres are about as far apart."""


def joined(parts: dict[Block, PrimitiveMap]) -> PrimitiveMap:
    """The map of all blocks; of one, its own.

    Args:
        parts: at least one, in order.
    """
    if len(parts) == 1:
        return next(iter(parts.values()))
    maps = list(parts.values())
    own = [np.flatnonzero((places_of(m.tessellation.centers) == block).all(axis=1)) for block, m in parts.items()]
    cells, order = _tessellation(maps, own)
    of_most = maps[int(np.argmax([m.n_rows[-1] for m in maps]))]
    n_own, n_free = (max(getattr(m, name) for m in maps) for name in ("n_own_modes", "n_background_modes"))
    homes = np.split(np.argsort(order), np.cumsum([cell.size for cell in own])[:-1])
    rows = np.append(order, order.size)
    c = {name: column[rows] for name, column in _columns(maps, own, of_most, n_own=n_own, n_free=n_free).items()}
    c["n_rows"][-1] = c["n_rows"][:-1].sum()
    return PrimitiveMap(
        tessellation=cells, n_rows=c.pop("n_rows"), n_background_modes=n_free, modes=Modes(**c),
        motion=_motion(maps, own, homes, cells=cells, of_most=of_most, n_own=n_own),
    )  # fmt: skip


def _tessellation(maps: list[PrimitiveMap], own: list[IntArray]) -> tuple[Tessellation, IntArray]:
    """All cells, and (n,) which of the blocks' cells, one after the other, each is."""
    centers = np.concatenate([m.tessellation.centers[cells] for m, cells in zip(maps, own, strict=True)])
    grids = [m.tessellation for m in maps if isinstance(m.tessellation, GridTessellation)]
    if grids:
        grid = GridTessellation.covering(centers, cell_size=grids[0].cell_size)
        return grid, np.argsort(grid.cell_of(centers), kind="stable")
    regions = [m.tessellation.region for m in maps if isinstance(m.tessellation, VoronoiTessellation)]
    extent = np.concatenate([region.centers for region in regions])
    region = GridTessellation.covering(extent, cell_size=regions[0].cell_size)
    return VoronoiTessellation(generators=centers, region=region), np.arange(len(centers))


def _columns(
    maps: list[PrimitiveMap], own: list[IntArray], of_most: PrimitiveMap, *, n_own: int, n_free: int
) -> dict[str, AnyArray]:
    """Of all primitives, one block's cells after the other's, and last of no place."""
    parts: list[dict[str, AnyArray]] = []
    for m, cells in [*zip(maps, own, strict=True), (of_most, np.array([-1]))]:
        free = n_own + np.arange(n_free - m.n_background_modes, n_free)
        at = np.concatenate([np.arange(m.n_own_modes - 1), [n_own - 1], free])  # in motion, standing, background
        part: dict[str, AnyArray] = {"n_rows": m.n_rows[cells]}
        for name, value in m.modes._asdict().items():  # a mode that a cell does not have weighs nothing
            filler = 1.0 if name in {"shape", "rate"} else 0.0
            part[name] = np.full((cells.size, n_own + n_free, *value.shape[2:]), filler)
            part[name][:, at] = value[cells]
        parts.append(part)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _motion(
    maps: list[PrimitiveMap], own: list[IntArray], homes: list[IntArray], *, cells: Tessellation,
    of_most: PrimitiveMap, n_own: int,
) -> Motion:  # fmt: skip
    """Manoeuvres in order of their cells, and transitions between them; `homes` are the numbers of the own cells."""
    columns: list[dict[str, AnyArray]] = []
    kept: list[IntArray] = []
    for m, mine, home in zip(maps, own, homes, strict=True):
        motion = m.motion
        at = np.full(m.tessellation.n_cells, -1)
        at[mine] = home
        chosen = np.flatnonzero(at[motion.cell[: motion.n_placed]] >= 0)
        column = {name: getattr(motion, name)[chosen] for name in FLOATS}
        column["cell"] = at[motion.cell[chosen]]
        column["mode"] = np.where(motion.mode[chosen] == m.n_own_modes - 1, n_own - 1, motion.mode[chosen])
        columns.append(column)
        kept.append(chosen)
    free = of_most.motion.without_places()
    placed = {name: np.concatenate([column[name] for column in columns]) for name in columns[0]}
    order = np.argsort(placed["cell"], kind="stable")
    placed = {name: column[order] for name, column in placed.items()}
    z = order.size
    numbers = np.split(np.argsort(order), np.cumsum([chosen.size for chosen in kept])[:-1])
    first = np.concatenate([np.zeros(z, np.int64), free.first])
    total = csr_array((free.count, free.following + z, first), shape=(z + len(free), z + len(free)))
    for m, chosen, known in zip(maps, kept, numbers, strict=True):
        target = _targets(m, placed, cells, n_own)
        target[chosen] = known
        source = np.repeat(np.arange(len(m.motion)), np.diff(m.motion.first))
        of = np.full(len(m.motion), -1)
        of[chosen] = known
        there = (of[source] >= 0) & (target[m.motion.following] >= 0)
        pair = of[source[there]], target[m.motion.following[there]]
        total = total + csr_array((m.motion.count[there], pair), shape=total.shape)
    total.sum_duplicates()
    total.sort_indices()
    joint: dict[str, Any] = {name: np.concatenate([column, getattr(free, name)]) for name, column in placed.items()}
    return Motion(
        **joint, first=total.indptr.astype(np.int64), following=total.indices.astype(np.int64),
        count=total.data.astype(np.float64), background_visits=free.background_visits,
        course_rate=free.course_rate, leader=free.leader,
    )  # fmt: skip


def _targets(m: PrimitiveMap, placed: dict[str, AnyArray], cells: Tessellation, n_own: int) -> IntArray:
    """(z,) the joined map's manoeuvre that is most alike each of a block's, in the cell there; -1 where none is."""
    motion, n = m.motion, m.motion.n_placed
    found = np.full(len(motion), -1)
    there = cells.cell_of(m.tessellation.centers)[motion.cell[:n]]
    begin, end = (np.searchsorted(placed["cell"], there, side=side) for side in ("left", "right"))
    stands = motion.mode[:n] == m.n_own_modes - 1
    for i in np.flatnonzero((there >= 0) & (end > begin)).tolist():
        some = slice(begin[i], end[i])
        off = 2.0 * np.sin(0.5 * (placed["course"][some] - motion.course[i])) / COURSE
        slower = (placed["log_pace"][some] - motion.log_pace[i]) / LOG_PACE
        other = 1e6 * ((placed["mode"][some] == n_own - 1) != stands[i])
        found[i] = begin[i] + int(np.argmin(off**2 + slower**2 + other))
    return found
