"""Which is given to which? One to one, so that the sum of what the pairs gain is greatest.

Source: Crouse, On implementing 2D rectangular assignment algorithms, 2016, as scipy has it; of each connected component
by itself, as most of them are a single pair.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from dirprim_filter.arrays import FloatArray, IntArray

FEW_PAIRS = 32
"""So many are sooner assigned than divided into components."""


def best_pairs(row: IntArray, column: IntArray, gain: FloatArray) -> IntArray:
    """Of pairs with a gain, no pair twice, those of the best assignment, ascending.

    Args:
        row: (p,) what is given.
        column: (p,) to what.
        gain: (p,) what it is worth; pairs that are worth nothing are never chosen.
    """
    useful = np.flatnonzero(gain > 0)
    if useful.size <= 1:
        return useful
    if useful.size <= FEW_PAIRS:
        return np.sort(_best(useful, row, column, gain))
    component = _components(row[useful], column[useful])
    order = np.argsort(component, kind="stable")
    parts = np.split(useful[order], np.flatnonzero(np.diff(component[order])) + 1)
    return np.sort(np.concatenate([part if part.size == 1 else _best(part, row, column, gain) for part in parts]))


def _components(row: IntArray, column: IntArray) -> IntArray:
    """(p,) the connected component of each pair, in the graph whose edges the pairs are."""
    i, j = (np.unique(of, return_inverse=True)[1] for of in (row, column))
    n = int(i.max() + j.max()) + 2
    graph = coo_array((np.ones(row.size, np.int8), (i, i.max() + 1 + j)), shape=(n, n))
    return connected_components(graph, directed=False)[1][i].astype(np.int64)


def _best(part: IntArray, row: IntArray, column: IntArray, gain: FloatArray) -> IntArray:
    i, j = (np.unique(of[part], return_inverse=True)[1] for of in (row, column))
    worth, pair = np.zeros((i.max() + 1, j.max() + 1)), np.full((i.max() + 1, j.max() + 1), -1, np.int64)
    worth[i, j], pair[i, j] = gain[part], part
    chosen = pair[linear_sum_assignment(worth, maximize=True)]
    return chosen[chosen >= 0]
