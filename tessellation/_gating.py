"""Compiled sorting of shares by cell."""

import numpy as np
from numba import njit

from tessellation.arrays import FloatArray, IntArray


@njit(cache=True, nogil=True)
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
    for i in range(distance.shape[0]):
        x, y = generators[cell[i, 0], 0], generators[cell[i, 0], 1]
        for j in range(1, distance.shape[1]):
            apart = np.hypot(generators[cell[i, j], 0] - x, generators[cell[i, j], 1] - y)
            half_apart[i, j] = 0.5 * apart
            beyond[i, j] = (distance[i, j] ** 2 - distance[i, 0] ** 2) / (2.0 * apart) if apart > 0.0 else np.inf
    return beyond, half_apart


def sort_by_cell(
    shares: list[tuple[IntArray, IntArray, FloatArray]], n_cells: int
) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows, cells and shares (n,), in order of the rows, as the rows and shares of each cell, from start to start."""
    count = sum((np.bincount(cell, minlength=n_cells) for _, cell, _ in shares), np.zeros(n_cells, np.int64))
    start = np.concatenate([[0], np.cumsum(count)])
    row, weight, place = np.empty(start[-1], np.int64), np.empty(start[-1]), start[:-1].copy()
    for part in shares:
        _sort_in(*part, place, row, weight)
    return start, row, weight


@njit(cache=True, nogil=True)
def _sort_in(
    row: IntArray, cell: IntArray, share: FloatArray, place: IntArray, kept: IntArray, weight: FloatArray
) -> None:
    for a in range(cell.size):
        kept[place[cell[a]]], weight[place[cell[a]]] = row[a], share[a]
        place[cell[a]] += 1


@njit(cache=True, nogil=True)
def leave_out(
    start: IntArray, row: IntArray, weight: FloatArray, fold: IntArray, n_folds: int
) -> tuple[IntArray, IntArray, FloatArray]:
    """Members of cell c without those of fold f, as cell c * n_folds + f."""
    n_cells = start.size - 1
    begin = np.zeros(n_cells * n_folds + 1, np.int64)
    for c in range(n_cells):
        for a in range(start[c], start[c + 1]):
            for f in range(n_folds):
                begin[c * n_folds + f + 1] += fold[row[a]] != f
    for v in range(n_cells * n_folds):
        begin[v + 1] += begin[v]
    kept, share, place = np.empty(begin[-1], np.int64), np.empty(begin[-1]), begin.copy()
    for c in range(n_cells):
        for a in range(start[c], start[c + 1]):
            for f in range(n_folds):
                if fold[row[a]] != f:
                    v = c * n_folds + f
                    kept[place[v]], share[place[v]] = row[a], weight[a]
                    place[v] += 1
    return begin, kept, share


@njit(cache=True, nogil=True)
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
    n_cells = start.size - 1
    begin = np.zeros(2 * n_cells + 1, np.int64)
    kept, share = np.empty(2 * row.size, np.int64), np.empty(2 * row.size)
    n = 0
    for c in range(n_cells):
        for half in range(2):
            for a in range(start[c], start[c + 1]):
                i = row[a]
                beyond = (position[i, 0] - border[c, 0]) * border[c, 2] + (position[i, 1] - border[c, 1]) * border[c, 3]
                beyond = beyond if half == 0 else -beyond
                w = weight[a]
                if beyond > 0.0:
                    w *= np.exp(-0.5 * (beyond / reach[c]) ** 2) if reach[c] > 0.0 else 0.0
                if w >= least:
                    kept[n], share[n] = i, w
                    n += 1
            begin[2 * c + half + 1] = n
    return begin, kept[:n], share[:n]


@njit(cache=True, nogil=True)
def unite(start: IntArray, row: IntArray, weight: FloatArray, pair: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Members of the union of two cells, pair: (n, 2); of a datum that both have, the greater share."""
    begin = np.zeros(len(pair) + 1, np.int64)
    size = 0
    for p in range(len(pair)):
        for c in pair[p]:
            size += start[c + 1] - start[c]
    kept, share = np.empty(size, np.int64), np.empty(size)
    n = 0
    for p in range(len(pair)):
        a, b = start[pair[p, 0]], start[pair[p, 1]]
        end_a, end_b = start[pair[p, 0] + 1], start[pair[p, 1] + 1]
        while a < end_a or b < end_b:
            if b >= end_b or (a < end_a and row[a] < row[b]):
                kept[n], share[n] = row[a], weight[a]
                a += 1
            elif a >= end_a or row[b] < row[a]:
                kept[n], share[n] = row[b], weight[b]
                b += 1
            else:
                kept[n], share[n] = row[a], max(weight[a], weight[b])
                a += 1
                b += 1
            n += 1
        begin[p + 1] = n
    return begin, kept[:n], share[:n]
