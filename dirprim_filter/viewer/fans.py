"""Where forecasts say a vehicle may be: the fan that holds a share of its sampled futures at every instant.

At each instant a highest density region (Hyndman 1996): the least area that holds the share of the samples, found where
a kernel density estimate is above the quantile of its own values at the samples. The fan is the union of these regions
over all instants, so it splits where futures do, which an ellipse or a ribbon could not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dirprim_filter.viewer import _kernels
from tessellation.arrays import FloatArray, IntArray

N_SQUARES = 24
"""Of the grid along the longer side of a fan: finer could not be seen."""
FINEST_M = 0.75
"""Side of a square at least."""
KERNEL_SQUARES = 1.2
"""Standard deviation of the kernel at least: wide enough that regions of one instant and the next touch."""
WIDEST_KERNEL = 2.2
"""The same at most."""
NEIGHBOUR = 4
"""The kernel of an instant is as wide as the samples' usual distance to so near a neighbour: where they lie thinly, one
alone makes no region."""
SOME_COMPANY = 1.3
"""Of the density at a lone sample: what is less dense is left out,"""
SPARED = 0.1
"""if the fan then lacks no more than this of its share: strays would lie about it like crumbs."""
NEIGHBOURS_AMONG = 60
"""Samples at most by which that is judged."""
KERNEL_REACH = 3.0
CORNER = float(np.exp(-0.25 / KERNEL_SQUARES**2))
"""Of the kernel at the corner of its square to that in the middle: a sample counts as the middle, and may be there."""
FAINTEST = 1e-3
"""Of the level: so small a density is drawn as none."""


class Fan(NamedTuple):
    """An area as triangles that do not overlap, all counter-clockwise.

    Attributes:
        vertex: (n, 2) metres.
        triangle: (m, 3) of vertices.
    """

    vertex: FloatArray
    triangle: IntArray


def fans_of(paths: FloatArray, probabilities: Sequence[float]) -> list[Fan]:
    """The fan of one vehicle for each probability. (n_samples, n_steps, 2) metres."""
    corner, side, shape = _grid(paths)
    distance = np.empty(paths.shape[1])
    some = max(len(paths) // NEIGHBOURS_AMONG, 1)
    _kernels.neighbour_distances(paths, some, min(NEIGHBOUR, -(-len(paths) // some) - 1), distance)
    node = np.rint((paths - corner) / side).astype(np.int64)[..., ::-1]
    height = np.zeros((len(probabilities), *shape))
    _kernels.highest_densities(
        node, np.clip(distance / side, KERNEL_SQUARES, WIDEST_KERNEL), KERNEL_REACH, np.array(probabilities),
        SOME_COMPANY, SPARED, CORNER, height,
    )  # fmt: skip
    return [_above(np.log(np.maximum(times, FAINTEST)), corner, side) for times in height]


def _grid(paths: FloatArray) -> tuple[FloatArray, float, tuple[int, int]]:
    """South-west corner, side of a square and (rows, columns) of nodes of a grid with room for the kernel."""
    low, high = paths.min(axis=(0, 1)), paths.max(axis=(0, 1))
    side = max(float((high - low).max()) / N_SQUARES, FINEST_M)
    margin = np.ceil(KERNEL_REACH * KERNEL_SQUARES) * side
    n_x, n_y = (np.ceil((high - low + 2.0 * margin) / side).astype(np.int64) + 1).tolist()
    return low - margin, side, (n_y, n_x)


def _above(height: FloatArray, corner: FloatArray, side: float) -> Fan:
    """The area where a function on the grid is at least 0, cut across its longer axis: its edges are finer along it."""
    is_tall = height.shape[0] > height.shape[1]
    of_axes = np.ascontiguousarray(height.T) if is_tall else height
    vertex, triangle = np.empty((3 * height.size, 2)), np.empty((3 * height.size, 3), np.int64)
    n_vertices, n_triangles = _kernels.triangles_above(of_axes, vertex, triangle)
    if is_tall:  # mirrored: the other way round is counter-clockwise then
        return Fan(corner + side * vertex[:n_vertices, ::-1], triangle[:n_triangles, ::-1])
    return Fan(corner + side * vertex[:n_vertices], triangle[:n_triangles])
