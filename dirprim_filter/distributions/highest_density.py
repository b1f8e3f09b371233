"""Where samples lie: highest density regions of positions, at one instant or at several.

At each instant a highest density region (Hyndman 1996): the least area that holds the share of the samples, found where
a kernel density estimate is above the quantile of its own values at the samples. Of a vehicle's rollouts the region is
the union over all instants, a fan, which holds the share at each of them; it splits where rollouts do, which an ellipse
or a ribbon could not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray

N_SQUARES = 24
"""Of the grid along the longer side of a region: finer could not be seen."""
FINEST_M = 0.75
"""Side of a square at least."""
KERNEL_SQUARES = 1.5
"""Standard deviation of the kernel: wide enough that regions of one instant and the next touch."""
KERNEL_REACH = 3.0
"""Of its standard deviations: so far around the samples the grid goes."""
EASED = 0.85
"""The level is lowered by this factor: edges are straight between nodes, and samples of one place have an area."""
FAINTEST = 1e-3
"""Of the level: so small a density is drawn as none."""
HALVES = np.array([[0, 1, 2], [0, 2, 3]])
"""Of a square, by its corners."""


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
        paths: (n_samples, n_steps, 2) metres, rollouts of one vehicle; one step for the region of one instant.
        probabilities: above 0, below 1.
    """
    origin, heights, side = _heights(np.ascontiguousarray(paths, np.float64), np.array(probabilities, np.float64))
    regions = []
    for height in heights:
        corner = np.ascontiguousarray(triangles_above(height)).view(np.complex128)  # numbers sort faster than rows
        vertex, which = np.unique(corner, return_inverse=True)
        regions.append(Region(origin + side * vertex.view(np.float64).reshape(-1, 2), which.reshape(-1, 3)))
    return regions


def triangles_above(height: FloatArray) -> FloatArray:
    """The area where a function on a grid is at least 0: (rows, columns) -> (n, 3, 2) column and row of each corner.

    Squares that are high at all corners are taken together along their row. Others are halved, and the halves cut where
    the function, linear in each, is 0 (Doi and Koide 1991: in triangles nothing is ambiguous).
    """
    high = height >= 0
    whole = high[:-1, :-1] & high[:-1, 1:] & high[1:, :-1] & high[1:, 1:]
    ends = np.diff(np.pad(whole.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    (row, first), (_, last) = np.nonzero(ends > 0), np.nonzero(ends < 0)
    run = np.stack([first, row, last, row, last, row + 1, first, row + 1], axis=1).reshape(-1, 4, 2)
    square = np.argwhere(~whole)[:, None, ::-1] + np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    half = square[:, HALVES].reshape(-1, 3, 2)
    h = height[half[..., 1], half[..., 0]]
    n_high = (h >= 0).sum(axis=1)
    parts = [run[:, HALVES].reshape(-1, 3, 2), half[n_high == 3]]
    for n in (1, 2):
        corner, of = half[n_high == n], h[n_high == n]
        turn = (((of >= 0) == (n == 1)).argmax(axis=1)[:, None] + np.arange(3)) % 3  # the odd corner first
        corner, of = np.take_along_axis(corner, turn[..., None], 1), np.take_along_axis(of, turn, 1)
        share = of[:, :1, None] / (of[:, :1] - of[:, 1:])[..., None]
        crossing = corner[:, :1] + share * (corner[:, 1:] - corner[:, :1])
        tip = np.hstack([corner[:, :1], crossing])
        trunk = np.hstack([crossing[:, :1], corner[:, 1:], crossing[:, 1:]])
        parts.append(tip if n == 1 else trunk[:, HALVES].reshape(-1, 3, 2))
    return np.concatenate(parts).astype(np.float64)


def _heights(path: FloatArray, probability: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """How many times its level the density is at the nodes of a grid, at the instant where that is most.

    Returns:
        (2,) where the first node is, metres; (k, rows, columns) the logarithm; metres between nodes.
    """
    low, high = path.min(axis=(0, 1)), path.max(axis=(0, 1))
    side = max(float((high - low).max()) / N_SQUARES, FINEST_M)
    margin = math.ceil(KERNEL_REACH * KERNEL_SQUARES) * side
    columns, rows = (int(n) + 1 for n in np.ceil((high - low + 2.0 * margin) / side))
    place = ((path - (low - margin)) / side)[..., ::-1].swapaxes(0, 1)
    height = highest_densities(place, probability, (rows, columns))
    return low - margin, np.log(np.maximum(height, FAINTEST)), side


def highest_densities(place: FloatArray, probability: FloatArray, shape: tuple[int, int]) -> FloatArray:
    """How many times its step's level the density is at each node of a grid, at the step where that is most.

    The level is the density at so many of the step's samples that the probability is held.

    Args:
        place: (n_steps, n_samples, 2) row and column of each sample.
        probability: (k,).
        shape: rows and columns of the grid.

    Returns:
        (k, rows, columns).
    """
    from scipy.ndimage import map_coordinates  # noqa: PLC0415 - a tracker that forecasts nothing does without

    off = (np.arange(n) - place[:, :, axis, None] for axis, n in enumerate(shape))
    down, across = (np.exp(-0.5 * (each / KERNEL_SQUARES) ** 2) for each in off)
    density = down.swapaxes(1, 2) @ across
    at_sample = np.sort([map_coordinates(d, p.T, order=1) for d, p in zip(density, place, strict=True)], axis=1)
    level = EASED * at_sample[:, ((1.0 - probability) * place.shape[1]).astype(np.int64)]
    return np.stack([(density / of[:, None, None]).max(axis=0) for of in level.T])
