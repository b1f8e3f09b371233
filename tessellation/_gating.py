"""Members sorted by cell, and redistributed: without a fold, in halves, or united."""

from __future__ import annotations

import numpy as np

from tessellation._arrays import BoolArray, FloatArray, IntArray

FEW = 1 << 16
"""Numbers below are sorted by counting, which is stable and several times as fast."""


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


def sort_by_cell(
    row: IntArray, cell: IntArray, share: FloatArray, n_cells: int
) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows, cells and shares (n,), in order of the rows, as the rows and shares of each cell, from start to start."""
    order = _sorted_by(cell, n_cells)
    return _starts(np.bincount(cell, minlength=n_cells)), row[order], share[order]


def leave_out(
    start: IntArray, row: IntArray, weight: FloatArray, fold: IntArray, n_folds: int
) -> tuple[IntArray, IntArray, FloatArray]:
    """Members of cell c without those of fold f, as cell c * n_folds + f."""
    begin, member, _ = _dealt(start, fold[row] != np.arange(n_folds)[:, None])
    return begin, row[member], weight[member]


def halve(
    start: IntArray,
    row: IntArray,
    weight: FloatArray,
    position: FloatArray,
    border: FloatArray,
    reach: FloatArray,
    least: float,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Members of the two halves of each cell, as cells 2 c and 2 c + 1.

    border: (n_cells, 4) a point of the border and the unit vector across it, from the first half to the second.
    """
    cell = np.repeat(np.arange(start.size - 1), np.diff(start))
    of_first = ((position[row] - border[cell, :2]) * border[cell, 2:]).sum(axis=1)
    beyond = np.maximum(np.stack([of_first, -of_first]), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        gate = np.where(beyond > 0.0, np.exp(-0.5 * (beyond / reach[cell]) ** 2), 1.0)
    share = weight * gate
    begin, member, half = _dealt(start, share >= least)
    return begin, row[member], share[half, member]


def unite(start: IntArray, row: IntArray, weight: FloatArray, pair: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Members of the union of two cells, pair: (n, 2); of a datum that both have, the greater share."""
    length = np.diff(start)[pair.ravel()]
    first = _starts(length)
    member = np.arange(first[-1]) - np.repeat(first[:-1] - start[pair.ravel()], length)
    united = np.repeat(np.arange(pair.size) // 2, length)
    order = np.lexsort((row[member], united))
    member, united = member[order], united[order]
    new = np.append(True, (np.diff(united) != 0) | (np.diff(row[member]) != 0))[: member.size]
    share = np.maximum.reduceat(weight[member], np.flatnonzero(new)) if member.size else weight[:0]
    return _starts(np.bincount(united[new], minlength=len(pair))), row[member[new]], share


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
