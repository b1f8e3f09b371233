"""Soft gates: how much of each datum a cell has.

A datum belongs wholly to the cell of its nearest generator. Cells beside it have a share that falls with the datum's
distance d to the border they have in common, exp(-(d / h)^2 / 2), where h is `softness` times the half of the distance
between the two generators: metres, that shrink as cells do. It is the gate of a mixture of experts (Jacobs et al.
1991), taken from the place alone: what a cell learns from beside it does not depend on how well it does there.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from tessellation._arrays import FloatArray, IntArray
from tessellation._gating import border_distance, sort_by_cell
from tessellation.protocols import Members

N_NEAREST = 8
"""Cells that may have a share in a datum."""
LEAST_SHARE = 0.02
"""A lesser share is none."""
WORTH_THREADS = 16_384
"""So many neighbours are looked up sooner by all threads; fewer, sooner than these have started."""


def nearest_generators(position: FloatArray, generators: FloatArray, *, k: int) -> tuple[FloatArray, IntArray]:
    """Distances and numbers of the k nearest generators, nearest first; fewer if there are fewer. (n, 2) -> (n, k)."""
    k = min(k, len(generators))
    workers = -1 if len(position) * k >= WORTH_THREADS else 1
    distance, cell = cKDTree(generators).query(position, k=k, workers=workers)
    return np.asarray(distance, np.float64).reshape(-1, k), np.asarray(cell, dtype=np.int64).reshape(-1, k)


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
    by_cell = sort_by_cell(row, cell[row, column], share[row, column], len(generators))
    return Members(*by_cell, generators), cell[:, 0]


def residents(cell: IntArray, center: FloatArray) -> Members:
    """Members that lie in their cell, each with weight 1: gates without softness, of cells of any kind.

    Args:
        cell: (n,) of each datum; a negative one has none.
        center: (n_cells, 2) metres.
    """
    row = np.flatnonzero(cell >= 0)
    by_cell = sort_by_cell(row, cell[row], np.ones(row.size), len(center))
    return Members(*by_cell, np.array(center, dtype=np.float64))


def part_of_members(members: Members, cells: IntArray) -> Members:
    """The members of some cells alone, which are then numbered from 0."""
    length = np.diff(members.start)[cells]
    start = np.concatenate([[0], np.cumsum(length)])
    pick = np.arange(start[-1]) - np.repeat(start[:-1] - members.start[cells], length)
    return Members(start, members.row[pick], members.weight[pick], members.center[cells])
