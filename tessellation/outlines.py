"""The polygons of a Voronoi tessellation, their areas, and which of them share a border."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from tessellation._arrays import FloatArray, IntArray
from tessellation._clipping import cut_boxes, owned_squares
from tessellation._kernels import Locator

FIRST_NEIGHBORS = 12
BATCH_NUMBERS = 1 << 19
"""Numbers in the arrays of one batch of cells."""


class Outlines(NamedTuple):
    """Ragged arrays: cell c has vertex[start[c]:start[c + 1]] and neighbor[border[c]:border[c + 1]]."""

    vertex: FloatArray  # (n, 2) metres
    start: IntArray  # (n_cells + 1,)
    area: FloatArray  # (n_cells,) square metres
    neighbor: IntArray
    border: IntArray  # (n_cells + 1,)


def outlines(generators: FloatArray, region: Locator, locator: Locator) -> Outlines:
    """The Voronoi polygons, each clipped to the box around the squares that the cell owns a part of.

    Args:
        generators: (n_cells, 2) metres.
        region: of square cells.
        locator: of the generators in the region.
    """
    n_cells = len(generators)
    refinement = locator.block // region.block if region.block else locator.pixel.shape[1] // region.pixel.shape[1]
    squares_per_metre = region.pixels_per_metre * max(region.block, 1)
    owned = np.repeat(np.array([[1 << 40, 1 << 40, -1, -1]]), n_cells, axis=0)
    owned_squares(locator, refinement, owned)
    owns = np.flatnonzero(owned[:, 0] <= owned[:, 2])
    corner = (owned + np.array([0, 0, 1, 1])) / squares_per_metre
    box = (np.array([region.origin_x, region.origin_y]) - generators)[:, [0, 1, 0, 1]] + corner
    tree = cKDTree(generators)
    parts: list[tuple[IntArray, IntArray, FloatArray, IntArray]] = []  # cells, numbers of vertices, vertices, labels
    n_near = FIRST_NEIGHBORS
    while owns.size:
        n_near = min(n_near, n_cells)
        undone = []
        for batch in np.array_split(owns, -(-owns.size * (n_near + 8) * 2 // BATCH_NUMBERS)):
            near = np.asarray(tree.query(generators[batch], k=np.arange(1, n_near + 1))[1], np.int64)
            vertex, label = np.empty((batch.size, n_near + 8, 2)), np.full((batch.size, n_near + 8), -1)
            n, done = np.empty(batch.size, np.int64), np.empty(batch.size, np.bool_)
            cut_boxes(generators, batch, box[batch], near, vertex, label, n, done)
            used = np.arange(n_near + 8) < np.where(done, n, 0)[:, None]
            parts.append((batch[done], n[done], vertex[used], label[used]))
            undone.append(batch[~done])
        owns = np.concatenate(undone)
        n_near *= 4
    return _joined(generators, parts)


def _joined(generators: FloatArray, parts: list[tuple[IntArray, IntArray, FloatArray, IntArray]]) -> Outlines:
    n_cells = len(generators)
    if not parts:
        start = np.zeros(n_cells + 1, np.int64)
        return Outlines(np.empty((0, 2)), start, np.zeros(n_cells), np.empty(0, np.int64), start)
    cell = np.repeat(np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts]))
    order = np.argsort(cell, kind="stable")
    offset, label = np.concatenate([p[2] for p in parts])[order], np.concatenate([p[3] for p in parts])[order]
    cell = cell[order]
    start = np.searchsorted(cell, np.arange(n_cells + 1))
    following = np.arange(1, cell.size + 1)
    last = start[1:][np.diff(start) > 0] - 1
    following[last] = start[:-1][np.diff(start) > 0]
    (x, y), (next_x, next_y) = offset.T, offset[following].T
    area = np.bincount(cell, weights=0.5 * (x * next_y - next_x * y), minlength=n_cells)
    shared = label >= 0
    pair = np.unique(np.column_stack([cell[shared], label[shared]]), axis=0)
    # A border may leave the box of one of the two cells: it is shared where it lies in both.
    key = pair @ np.array([n_cells, 1])
    pair = pair[np.isin(pair @ np.array([1, n_cells]), key, assume_unique=True)]
    border = np.searchsorted(pair[:, 0], np.arange(n_cells + 1))
    return Outlines(offset + generators[cell], start, area.astype(np.float64), pair[:, 1].copy(), border)
