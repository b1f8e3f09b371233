"""The polygons of a Voronoi tessellation, and their areas.

After Rycroft (2009), "Voro++": a box cut by the bisectors of a generator with those near it, nearest first; once the
farthest corner is within half the distance of the next generator, no other can cut. Corners are offsets from the
generator, so that large coordinates cost no precision.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from tessellation._arrays import FloatArray, IntArray
from tessellation._kernels import Locator
from tessellation.locate import pixels_of

FIRST_NEIGHBORS = 16


class Outlines(NamedTuple):
    """Ragged arrays: cell c has vertex[start[c]:start[c + 1]]."""

    vertex: FloatArray  # (n, 2) metres
    start: IntArray  # (n_cells + 1,)
    area: FloatArray  # (n_cells,) square metres


class Corners(NamedTuple):
    """Corners of convex polygons, polygon by polygon, counter-clockwise."""

    polygon: IntArray  # (n,) which each is of, ascending
    place: FloatArray  # (n, 2) metres from the generator

    def following(self) -> IntArray:
        """(n,) the next corner of the same polygon."""
        n = self.polygon.size
        last = np.append(self.polygon[1:] != self.polygon[:-1], True)[:n]
        first = np.flatnonzero(np.append(True, last[:-1])[:n])
        after = np.arange(1, n + 1)
        after[last] = first
        return after

    def cut(self, to: FloatArray) -> Corners:
        """Where the generators are nearer than others, one for each polygon, at offsets (k, 2)."""
        to = to[self.polygon]
        off = (self.place * to).sum(axis=1) - 0.5 * (to * to).sum(axis=1)
        after = self.following()
        inside, crosses = off <= 0.0, (off <= 0.0) != (off[after] <= 0.0)
        share = np.divide(off, off - off[after], out=np.zeros(off.size), where=crosses)[:, None]
        crossing = self.place + share * (self.place[after] - self.place)
        both = np.column_stack([inside, crosses]).ravel()
        place = np.stack([self.place, crossing], axis=1).reshape(-1, 2)
        return Corners(np.repeat(self.polygon, 2)[both], place[both])


NO_CORNERS = Corners(np.empty(0, np.int64), np.empty((0, 2)))


def outlines(generators: FloatArray, locator: Locator) -> Outlines:
    """The Voronoi polygons, each clipped to the box around the pixels that the cell may own a part of.

    Args:
        generators: (n_cells, 2) metres.
        locator: of the generators in a region.
    """
    n_cells = len(generators)
    box = _boxes(generators, locator)
    owns = np.flatnonzero(box[:, 0] < box[:, 2])
    parts, n_near, tree = [], FIRST_NEIGHBORS, cKDTree(generators) if n_cells else None
    while owns.size and tree is not None:
        n_near = min(n_near, n_cells)
        corner = box[owns][:, [0, 1, 2, 1, 2, 3, 0, 3]].reshape(-1, 2)
        found = Corners(np.repeat(np.arange(owns.size), 4), corner)
        near = np.asarray(tree.query(generators[owns], k=np.arange(1, n_near + 1))[1], np.int64)
        for column in near.T[1:]:
            found = found.cut(generators[column] - generators[owns])
        farthest = np.zeros(owns.size)
        np.maximum.at(farthest, found.polygon, (found.place**2).sum(axis=1))
        last = ((generators[near[:, -1]] - generators[owns]) ** 2).sum(axis=1)
        done = (last >= 4.0 * farthest) | (n_near == n_cells)
        kept = done[found.polygon]
        parts.append(Corners(owns[found.polygon[kept]], found.place[kept]))
        owns, n_near = owns[~done], 4 * n_near
    cell, offset = (np.concatenate(column) for column in zip(*parts, strict=True)) if parts else NO_CORNERS
    order = np.argsort(cell, kind="stable")
    cell, offset = cell[order], offset[order]
    (x, y), (next_x, next_y) = offset.T, offset[Corners(cell, offset).following()].T
    area = np.bincount(cell, weights=0.5 * (x * next_y - next_x * y), minlength=n_cells)
    start = np.searchsorted(cell, np.arange(n_cells + 1))
    return Outlines(offset + generators[cell], start, area.astype(np.float64))


def _boxes(generators: FloatArray, locator: Locator) -> FloatArray:
    """(n_cells, 4) the box around the pixels that list each cell, from its generator; inside out without any."""
    row, column, value = pixels_of(locator)
    listed = np.flatnonzero(value < -1)
    which = -2 - value[listed]
    many = np.diff(locator.first)[which]
    at = np.repeat(locator.first[which] - np.cumsum(many) + many, many) + np.arange(many.sum())
    cell = np.concatenate([value[value >= 0], locator.entry[at, 2].astype(np.int64)])
    pixel = np.concatenate([np.flatnonzero(value >= 0), np.repeat(listed, many)])
    place = np.column_stack([column, row])[pixel]
    low, high = np.full((len(generators), 2), np.inf), np.full((len(generators), 2), -np.inf)
    np.minimum.at(low, cell, place)
    np.maximum.at(high, cell, place + 1.0)
    origin = np.array([locator.origin_x, locator.origin_y]) - generators
    return np.hstack([origin + low / locator.pixels_per_metre, origin + high / locator.pixels_per_metre])
