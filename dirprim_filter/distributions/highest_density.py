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
        vertex, which = np.unique(triangles_above(height).reshape(-1, 2), axis=0, return_inverse=True)
        regions.append(Region(origin + side * vertex, which.reshape(-1, 3)))
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
    kernel = np.clip(neighbour_distances(path) / side, KERNEL_SQUARES, WIDEST_KERNEL)
    place = ((path - (low - margin)) / side)[..., ::-1].swapaxes(0, 1)
    height = highest_densities(place, kernel, probability, (rows, columns))
    return low - margin, np.log(np.maximum(height, FAINTEST)), side


def neighbour_distances(path: FloatArray) -> FloatArray:
    """(n_steps,) the median distance of some samples to their nth nearest at each step; the first is the sample itself.

    path: (n_samples, n_steps, 2).
    """
    some = path[:: max(len(path) // NEIGHBOURS_AMONG, 1)].swapaxes(0, 1)
    apart = np.linalg.norm(some[:, :, None] - some[:, None], axis=-1)
    nth = min(NEIGHBOUR, some.shape[1] - 1)
    return np.asarray(np.median(np.partition(apart, nth, axis=2)[:, :, nth], axis=1), np.float64)


def highest_densities(
    place: FloatArray, kernel: FloatArray, probability: FloatArray, shape: tuple[int, int]
) -> FloatArray:
    """How many times its step's level the density is at each node of a grid, at the step where that is most.

    The level is the density at so many of the step's samples that the probability is held.

    Args:
        place: (n_steps, n_samples, 2) row and column of each sample, from 0 to the last but one.
        kernel: (n_steps,) standard deviation in nodes.
        probability: (k,).
        shape: rows and columns of the grid.

    Returns:
        (k, rows, columns).
    """
    n_steps, n_samples, _ = place.shape
    bell = []
    for axis in (0, 1):
        off = np.arange(shape[axis]) - place[:, :, axis, None]
        wide = kernel[:, None, None]
        near = np.abs(np.arange(shape[axis]) - np.rint(place[:, :, axis, None])) <= np.floor(KERNEL_REACH * wide + 0.5)
        bell.append(near * np.exp(-0.5 * (off / wide) ** 2) / (np.sqrt(2.0 * np.pi) * wide))
    density = bell[0].swapaxes(1, 2) @ bell[1]
    node = place.astype(np.int64)
    up, right = (place - node)[..., 0], (place - node)[..., 1]
    step, (row, column) = np.arange(n_steps)[:, None], np.moveaxis(node, 2, 0)
    at_sample = (1.0 - up) * ((1.0 - right) * density[step, row, column] + right * density[step, row, column + 1])
    at_sample += up * ((1.0 - right) * density[step, row + 1, column] + right * density[step, row + 1, column + 1])
    at_sample.sort(axis=1)
    least = SOME_COMPANY / (2.0 * np.pi * kernel**2)
    level = at_sample[:, ((1.0 - probability) * n_samples).astype(np.int64)]
    enough = (at_sample >= least[:, None]).sum(axis=1)[:, None] >= (probability - SPARED) * n_samples
    level = EASED * np.where(enough, np.maximum(level, least[:, None]), level)
    return np.stack([(density / of[:, None, None]).max(axis=0) for of in level.T])
