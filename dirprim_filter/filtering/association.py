"""Which detection is whose? Gates, the best assignment inside them, and pairs of detections that may be new vehicles.

Global nearest neighbour: of all ways to give each track at most one detection and each detection to at most one track,
the one of greatest likelihood. Source: Blackman and Popoli, Design and Analysis of Modern Tracking Systems, 1999.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from tessellation.arrays import FloatArray, IntArray


class Pairs(NamedTuple):
    """Rows of one side, each with a row of the other. (n,), (n,)."""

    one: IntArray
    other: IntArray


def gated(mean: FloatArray, covariance: FloatArray, position: FloatArray, noise: FloatArray, *, gate: float) -> Pairs:
    """Tracks and detections that may belong together: a tree finds what is near, the ellipse decides.

    Args:
        mean: (t, 2) predicted positions, metres.
        covariance: (t, 2, 2) of them, square metres.
        position: (d, 2) detections.
        noise: (d, 2, 2) their covariance.
        gate: squared Mahalanobis distance of the ellipse.
    """
    if len(mean) == 0 or len(position) == 0:
        return Pairs(np.empty(0, np.int64), np.empty(0, np.int64))
    widest = np.linalg.eigvalsh(noise)[:, -1].max()
    reach = np.sqrt(gate * (np.linalg.eigvalsh(covariance)[:, -1] + widest))
    near = KDTree(position).query_ball_point(mean, reach, return_sorted=True)
    track = np.repeat(np.arange(len(mean)), [len(found) for found in near])
    detection = np.concatenate([np.asarray(found, dtype=np.int64) for found in near])
    off = position[detection] - mean[track]
    spread = covariance[track] + noise[detection]
    distance = np.einsum("ni,ni->n", off, np.linalg.solve(spread, off[..., None])[..., 0])
    inside = distance <= gate
    return Pairs(track[inside], detection[inside])


def within(one: FloatArray, other: FloatArray, *, reach: FloatArray) -> Pairs:
    """Points (n, 2) of one side, and those (m, 2) of the other that are within `reach` (n,) metres of them."""
    if len(one) == 0 or len(other) == 0:
        return Pairs(np.empty(0, np.int64), np.empty(0, np.int64))
    near = KDTree(other).query_ball_point(one, reach, return_sorted=True)
    return Pairs(
        np.repeat(np.arange(len(one)), [len(found) for found in near]),
        np.concatenate([np.asarray(found, dtype=np.int64) for found in near]),
    )


def best_assignment(pairs: Pairs, gain: FloatArray) -> Pairs:
    """Of the pairs those that no row stands in twice and whose gains (n,) add up to the most; ascending by `one`.

    Pairs without a gain are never chosen. Groups of rows that share no pair are solved one by one: a thousand false
    detections far from all tracks cost nothing.
    """
    useful = gain > 0
    one, other, gain = pairs.one[useful], pairs.other[useful], gain[useful]
    if one.size == 0:
        return Pairs(one, other)
    ones, row = np.unique(one, return_inverse=True)
    others, column = np.unique(other, return_inverse=True)
    n = ones.size + others.size
    links = coo_array((np.ones(one.size), (row, column + ones.size)), shape=(n, n))
    _, group = connected_components(links, directed=False)
    order = np.argsort(group[row], kind="stable")
    bounds = np.flatnonzero(np.diff(group[row][order], prepend=-1))
    chosen = [_solved(rows, row, column, gain) for rows in np.split(order, bounds[1:])]
    picked = np.concatenate(chosen)
    picked = picked[np.argsort(one[picked], kind="stable")]
    return Pairs(one[picked], other[picked])


def _solved(rows: IntArray, row: IntArray, column: IntArray, gain: FloatArray) -> IntArray:
    """The pairs chosen of one connected group."""
    if rows.size == 1:
        return rows
    ones, i = np.unique(row[rows], return_inverse=True)
    others, j = np.unique(column[rows], return_inverse=True)
    table = np.zeros((ones.size, others.size))  # no pair, no gain: as good as left alone
    number = np.full(table.shape, -1, np.int64)
    table[i, j], number[i, j] = gain[rows], rows
    best = number[linear_sum_assignment(table, maximize=True)]
    return best[best >= 0]
