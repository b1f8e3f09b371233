"""Soft gates: how much of each datum a cell has.

A datum belongs wholly to the cell of its nearest generator. Cells beside it have a share that falls with the datum's
distance d to the border they have in common, exp(-(d / h)^2 / 2), where h is `softness` times the half of the distance
between the two generators: metres, that shrink as cells do. It is the gate of a mixture of experts (Jacobs et al.
1991), taken from the place alone: what a cell learns from beside it does not depend on how well it does there.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from tessellation._gating import count_members, fill_members
from tessellation.arrays import FloatArray, IntArray
from tessellation.protocols import Members

N_NEAREST = 8
"""Cells that may have a share in a datum."""
LEAST_SHARE = 0.02
"""A lesser share is none."""


def nearest_generators(position: FloatArray, generators: FloatArray, *, k: int) -> tuple[FloatArray, IntArray]:
    """Distances and numbers of the k nearest generators, nearest first; fewer if there are fewer. (n, 2) -> (n, k)."""
    k = min(k, len(generators))
    distance, cell = cKDTree(generators).query(position, k=k, workers=-1)
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
    apart = np.linalg.norm(generators[cell] - generators[cell[:, :1]], axis=2)
    apart[:, 0] = np.inf
    beyond = np.zeros_like(distance)
    beyond[:, 1:] = (distance[:, 1:] ** 2 - distance[:, :1] ** 2) / (2.0 * apart[:, 1:])
    return beyond, 0.5 * apart


def members_of(position: FloatArray, generators: FloatArray, *, softness: float) -> tuple[Members, IntArray]:
    """Every cell's members, and the cell of each datum's nearest generator (n,).

    Args:
        position: (n, 2) metres.
        generators: (n_cells, 2) metres, no two the same.
        softness: reach of a cell beyond its border, as a share of half the distance to the next; 0 for hard cells.
    """
    distance, cell = nearest_generators(position, generators, k=N_NEAREST if softness > 0 else 1)
    beyond, half_apart = border_distance(generators, distance, cell)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.exp(-0.5 * (beyond / (softness * half_apart)) ** 2)
    share[:, 0] = 1.0
    share[share < LEAST_SHARE] = 0.0
    start = count_members(cell, share, len(generators))
    row, weight = fill_members(cell, share, start)
    return Members(start, row, weight, generators), np.ascontiguousarray(cell[:, 0])


def residents(cell: IntArray, center: FloatArray) -> Members:
    """Members that lie in their cell, each with weight 1: gates without softness, of cells of any kind.

    Args:
        cell: (n,) of each datum; a negative one has none.
        center: (n_cells, 2) metres.
    """
    column, share = cell[:, None], (cell[:, None] >= 0).astype(np.float64)
    start = count_members(column, share, len(center))
    return Members(start, *fill_members(column, share, start), np.array(center, dtype=np.float64))


def part_of_members(members: Members, cells: IntArray) -> Members:
    """The members of some cells alone, which are then numbered from 0."""
    length = np.diff(members.start)[cells]
    start = np.concatenate([[0], np.cumsum(length)])
    pick = np.arange(start[-1]) - np.repeat(start[:-1] - members.start[cells], length)
    return Members(start, members.row[pick], members.weight[pick], members.center[cells])
