"""Soft gates: how much of each datum a cell has.

A datum belongs wholly to the cell of its nearest generator. Cells beside it have a share that falls with the datum's
distance d to the border they have in common, exp(-(d / h)^2 / 2), where h is `softness` times the half of the distance
between the two generators: metres, that shrink as cells do. It is the gate of a mixture of experts (Jacobs et al.
1991), taken from the place alone: what a cell learns from beside it does not depend on how well it does there.
"""

from __future__ import annotations

import numpy as np

from tessellation._arrays import BoolArray, FloatArray, IntArray
from tessellation.protocols import Members

N_NEAREST = 8
"""Cells that may have a share in a datum."""
LEAST_SHARE = 0.02
"""A lesser share is none."""
FEW = 1 << 16
"""Numbers below are sorted by counting, which is stable and several times as fast."""
WORTH_THREADS = 16_384
"""So many neighbours are looked up sooner by all threads; fewer, sooner than these have started."""


def nearest_generators(position: FloatArray, generators: FloatArray, *, k: int) -> tuple[FloatArray, IntArray]:
    """Distances and numbers of the k nearest generators, nearest first; fewer if there are fewer. (n, 2) -> (n, k)."""
    from scipy.spatial import cKDTree  # noqa: PLC0415 - tracking with a map does without

    k = min(k, len(generators))
    workers = -1 if len(position) * k >= WORTH_THREADS else 1
    distance, cell = cKDTree(generators).query(position, k=k, workers=workers)
    return np.asarray(distance, np.float64).reshape(-1, k), np.asarray(cell, dtype=np.int64).reshape(-1, k)


def border_distance(generators: FloatArray, distance: FloatArray, cell: IntArray) -> tuple[FloatArray, FloatArray]:
    """How far beyond its border with the first cell each of the others is, and half the distance of the generators.

    Args:
        generators: (n_cells, 2) metres.
        distance: (n, k) to the nearest generators, metres.
        cell: (n, k) which they are.

    Returns:
        (n, k) metres, 0 for the first cell; (n, k) metres, infinite for the first cell.
    """
    beyond, half_apart = np.zeros(distance.shape), np.full(distance.shape, np.inf)
    home = generators[cell[:, 0]]
    for j in range(1, distance.shape[1]):
        east, north = (generators[cell[:, j]] - home).T
        apart = np.hypot(east, north)
        half_apart[:, j] = 0.5 * apart
        difference = distance[:, j] ** 2 - distance[:, 0] ** 2
        beyond[:, j] = np.divide(difference, 2.0 * apart, out=np.full(apart.shape, np.inf), where=apart > 0.0)
    return beyond, half_apart


def members_of(position: FloatArray, generators: FloatArray, *, softness: float) -> tuple[Members, IntArray]:
    """Every cell's members, and the cell of each datum's nearest generator (n,).

    Args:
        position: (n, 2) metres.
        generators: (n_cells, 2) metres, no two the same.
        softness: reach of a cell beyond its border, as a share of half the distance to the next; 0 for hard cells.
    """
    if softness == 0:
        home = nearest_generators(position, generators, k=1)[1][:, 0]
        return residents(home, generators), home
    distance, cell = nearest_generators(position, generators, k=N_NEAREST)
    beyond, half_apart = border_distance(generators, distance, cell)
    share = np.exp(-0.5 * (beyond / (softness * half_apart)) ** 2)
    row, column = np.nonzero(share >= LEAST_SHARE)
    return sort_by_cell(row, cell[row, column], share[row, column], generators), cell[:, 0]


def residents(cell: IntArray, center: FloatArray) -> Members:
    """Members that lie in their cell, each with weight 1: gates without softness, of cells of any kind.

    Args:
        cell: (n,) of each datum; a negative one has none.
        center: (n_cells, 2) metres.
    """
    row = np.flatnonzero(cell >= 0)
    return sort_by_cell(row, cell[row], np.ones(row.size), np.array(center, dtype=np.float64))


def part_of_members(members: Members, cells: IntArray) -> Members:
    """The members of some cells alone, which are then numbered from 0."""
    length = np.diff(members.start)[cells]
    start = _starts(length)
    pick = np.arange(start[-1]) - np.repeat(start[:-1] - members.start[cells], length)
    return Members(start, members.row[pick], members.weight[pick], members.center[cells])


def sort_by_cell(row: IntArray, cell: IntArray, share: FloatArray, center: FloatArray) -> Members:
    """Members of cells at such centres: rows, cells and shares (n,), in order of the rows."""
    order = _sorted_by(cell, len(center))
    return Members(_starts(np.bincount(cell, minlength=len(center))), row[order], share[order], center)


def leave_out(members: Members, fold: IntArray, n_folds: int) -> Members:
    """Members of cell c without those of fold f, as cell c * n_folds + f."""
    start, member, _ = _dealt(members.start, fold[members.row] != np.arange(n_folds)[:, None])
    center = np.repeat(members.center, n_folds, axis=0)
    return Members(start, members.row[member], members.weight[member], center)


def halve(
    members: Members, position: FloatArray, border: FloatArray, reach: FloatArray, center: FloatArray
) -> Members:  # fmt: skip
    """Members of the two halves of each cell, as cells 2 c and 2 c + 1 of centres (2 n_cells, 2).

    border: (n_cells, 4) a point of the border and the unit vector across it, from the first half to the second.
    reach: (n_cells,) metres beyond the border; see `members_of`.
    """
    cell = np.repeat(np.arange(len(border)), np.diff(members.start))
    of_first = ((position[members.row] - border[cell, :2]) * border[cell, 2:]).sum(axis=1)
    beyond = np.maximum(np.stack([of_first, -of_first]), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        gate = np.where(beyond > 0.0, np.exp(-0.5 * (beyond / reach[cell]) ** 2), 1.0)
    share = members.weight * gate
    start, member, half = _dealt(members.start, share >= LEAST_SHARE)
    return Members(start, members.row[member], share[half, member], center)


def unite(members: Members, into: IntArray, center: FloatArray) -> Members:
    """Members of unions of cells: cell c goes into that of number into[c]; of a datum of several, the greatest share.

    center: (n, 2) metres, of the unions.
    """
    united = np.repeat(into, np.diff(members.start))
    order = np.lexsort((members.row, united))
    row, weight, united = members.row[order], members.weight[order], united[order]
    new = np.append(True, (np.diff(united) != 0) | (np.diff(row) != 0))[: row.size]
    share = np.maximum.reduceat(weight, np.flatnonzero(new)) if row.size else weight
    return Members(_starts(np.bincount(united[new], minlength=len(center))), row[new], share, center)


def _sorted_by(cell: IntArray, n_cells: int) -> IntArray:
    """The order of cells numbered from 0 to `n_cells`, those of one cell as they came."""
    return np.argsort(cell.astype(np.uint16) if n_cells <= FEW else cell, kind="stable")


def _dealt(start: IntArray, kept: BoolArray) -> tuple[IntArray, IntArray, IntArray]:
    """What each of k parts of each cell keeps, as cells k c, k c + 1, ...: their starts, the members, the parts.

    kept: (k, n_members).
    """
    n_parts = len(kept)
    cell = np.repeat(np.arange(start.size - 1), np.diff(start))
    part, member = np.nonzero(kept)
    into = cell[member] * n_parts + part
    order = _sorted_by(into, (start.size - 1) * n_parts)
    return _starts(np.bincount(into, minlength=(start.size - 1) * n_parts)), member[order], part[order]


def _starts(count: IntArray) -> IntArray:
    """Where each of those begins that stand one after the other, and where the last ends."""
    return np.concatenate([[0], np.cumsum(count)])
