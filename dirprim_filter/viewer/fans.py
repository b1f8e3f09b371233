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


KNOBS = _kernels.Knobs(
    n_squares=N_SQUARES, finest_m=FINEST_M, narrowest=KERNEL_SQUARES, widest=WIDEST_KERNEL, reach=KERNEL_REACH,
    neighbour=NEIGHBOUR, neighbours_among=NEIGHBOURS_AMONG, company=SOME_COMPANY, spared=SPARED, corner=CORNER,
    faintest=FAINTEST,
)  # fmt: skip


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
    share = np.array(probabilities, np.float64)
    vertex, triangle, n_vertices, n_triangles = _kernels.fans(np.ascontiguousarray(paths, np.float64), share, KNOBS)
    last_vertex, last_triangle = np.cumsum(n_vertices).tolist(), np.cumsum(n_triangles).tolist()
    first_vertex, first_triangle = [0, *last_vertex], [0, *last_triangle]
    return [
        Fan(vertex[first_vertex[i] : last_vertex[i]], triangle[first_triangle[i] : last_triangle[i]])
        for i in range(share.size)
    ]
