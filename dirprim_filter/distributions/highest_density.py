"""Where samples lie: highest density regions of positions, at one instant or at several.

At each instant a highest density region (Hyndman 1996): the least area that holds the share of the samples, found where
a kernel density estimate is above the quantile of its own values at the samples. Of a vehicle's futures the region is
the union over all instants, a fan, which holds the share at each of them; it splits where futures do, which an ellipse
or a ribbon could not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dirprim_filter.distributions import _highest_density
from tessellation.arrays import FloatArray, IntArray

N_SQUARES = 24
"""Of the grid along the longer side of a region: finer could not be seen."""
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
"""if the region then lacks no more than this of its share: strays would lie about it like crumbs."""
NEIGHBOURS_AMONG = 60
"""Samples at most by which that is judged."""
KERNEL_REACH = 3.0
EASED = 0.85
"""The level is lowered by this factor: edges are straight between nodes, and samples of one place have an area."""
FAINTEST = 1e-3
"""Of the level: so small a density is drawn as none."""


KNOBS = _highest_density.Knobs(
    n_squares=N_SQUARES, finest_m=FINEST_M, narrowest=KERNEL_SQUARES, widest=WIDEST_KERNEL, reach=KERNEL_REACH,
    neighbour=NEIGHBOUR, neighbours_among=NEIGHBOURS_AMONG, company=SOME_COMPANY, spared=SPARED, eased=EASED,
    faintest=FAINTEST,
)  # fmt: skip


class Region(NamedTuple):
    """An area as triangles that do not overlap, all counter-clockwise.

    Attributes:
        vertex: (n, 2) metres.
        triangle: (m, 3) of vertices.
    """

    vertex: FloatArray
    triangle: IntArray


def highest_density_regions(paths: FloatArray, probabilities: Sequence[float]) -> list[Region]:
    """The region of each probability, which holds it at every instant.

    Args:
        paths: (n_samples, n_steps, 2) metres, futures of one vehicle; one step for the region of one instant.
        probabilities: above 0, below 1.
    """
    share = np.array(probabilities, np.float64)
    path = np.ascontiguousarray(paths, np.float64)
    vertex, triangle, n_vertices, n_triangles = _highest_density.regions(path, share, KNOBS)
    last_vertex, last_triangle = np.cumsum(n_vertices).tolist(), np.cumsum(n_triangles).tolist()
    first_vertex, first_triangle = [0, *last_vertex], [0, *last_triangle]
    return [
        Region(vertex[first_vertex[i] : last_vertex[i]], triangle[first_triangle[i] : last_triangle[i]])
        for i in range(share.size)
    ]
