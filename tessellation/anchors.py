"""A point in each cell: where to stand a mark of the cell, or to ask what holds in it."""

from __future__ import annotations

import numpy as np

from tessellation._arrays import FloatArray
from tessellation.protocols import Tessellation

_TOWARDS_CORNERS = (0.0, 0.3, 0.6, 0.9)
"""Points that are tried, from the middle of a polygon's corners towards each."""


def anchors(tessellation: Tessellation) -> FloatArray:
    """A point of each cell: its centre, where that lies in it. -> (n_cells, 2) metres.

    A generator may lie where its cell is cut off, or beyond the edge of the region: then it is the point nearest to the
    generator of a few in the polygon that are in the cell. A cell that has no such point keeps its centre.
    """
    found = tessellation.centers.copy()
    cell = np.arange(tessellation.n_cells)
    astray = cell[tessellation.cell_of(found) != cell]
    polygons = tessellation.polygons() if astray.size else []
    for c in astray.tolist():
        corners = polygons[c]
        if not len(corners):
            continue
        middle = corners.mean(axis=0)
        tried = np.concatenate([middle + share * (corners - middle) for share in _TOWARDS_CORNERS])
        tried = tried[tessellation.cell_of(tried) == c]
        if len(tried):
            found[c] = tried[np.argmin(((tried - found[c]) ** 2).sum(axis=1))]
    return found
