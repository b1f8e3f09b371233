"""Where forecasts say a vehicle may be: the fan that holds a share of its sampled futures at every instant.

At each instant a highest density region (Hyndman 1996): the least area that holds the share of the samples, found where
a kernel density estimate is above the quantile of its own values at the samples. The fan is the union of these regions
over all instants, so it splits where futures do, which an ellipse or a ribbon could not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import gaussian_filter

from tessellation.arrays import AnyArray, BoolArray, FloatArray, IntArray

N_SQUARES = 34
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


def fan_triangles(paths: FloatArray, probabilities: Sequence[float]) -> list[FloatArray]:
    """The fans of one vehicle. (n_samples, n_steps, 2) metres -> of each (n, 3, 2) triangles that do not overlap."""
    corner, side, shape = _grid(paths)
    kernel = np.clip(_kernel_widths(paths) / side, KERNEL_SQUARES, WIDEST_KERNEL)
    density, at_sample = _densities(paths, corner, side, shape, kernel)
    at_sample.sort(axis=1)
    of_two = SOME_COMPANY / (2.0 * np.pi * kernel**2)
    fans = []
    for probability in probabilities:
        level = at_sample[:, int((1.0 - probability) * at_sample.shape[1])]  # (n_steps,)
        in_company = np.maximum(level, of_two)
        enough = (at_sample >= in_company[:, None]).mean(axis=1) >= probability - SPARED
        level = CORNER * np.where(enough, in_company, level)
        highest = (density * (1.0 / level)[:, None, None]).max(axis=0)
        fans.append(corner + side * _above(np.log(np.maximum(highest, FAINTEST))))
    return fans


def _grid(paths: FloatArray) -> tuple[FloatArray, float, tuple[int, int]]:
    """South-west corner, side of a square and (rows, columns) of nodes of a grid with room for the kernel."""
    low, high = paths.min(axis=(0, 1)), paths.max(axis=(0, 1))
    side = max(float((high - low).max()) / N_SQUARES, FINEST_M)
    margin = np.ceil(KERNEL_REACH * KERNEL_SQUARES) * side
    n_x, n_y = (np.ceil((high - low + 2.0 * margin) / side).astype(np.int64) + 1).tolist()
    return low - margin, side, (n_y, n_x)


def _densities(
    paths: FloatArray, corner: FloatArray, side: float, shape: tuple[int, int], kernel: FloatArray
) -> tuple[AnyArray, AnyArray]:
    """Kernel density at each step, (n_steps, rows, columns), and at its samples, (n_steps, n_samples); to a factor."""
    n_samples, n_steps, _ = paths.shape
    column, row = np.rint((paths - corner) / side).astype(np.int64).transpose(2, 1, 0)  # (n_steps, n_samples) each
    step = np.repeat(np.arange(n_steps), n_samples).reshape(n_steps, n_samples)
    flat = np.ravel_multi_index((step, row, column), (n_steps, *shape))
    count = np.bincount(flat.ravel(), minlength=n_steps * shape[0] * shape[1]).reshape(n_steps, *shape)
    density: AnyArray = np.empty(count.shape, np.float32)
    for k, width in enumerate(kernel):
        gaussian_filter(count[k].astype(np.float32), width, output=density[k], mode="constant", truncate=KERNEL_REACH)
    return density, density[step, row, column]


def _kernel_widths(paths: FloatArray) -> FloatArray:
    """(n_steps,) metres: the median distance of the samples of each step to their `NEIGHBOUR`-th nearest."""
    some = paths[:: max(len(paths) // NEIGHBOURS_AMONG, 1)].transpose(1, 0, 2)
    squared = ((some[:, :, None] - some[:, None]) ** 2).sum(axis=-1)
    nth = min(NEIGHBOUR, squared.shape[1] - 1)
    return np.asarray(np.sqrt(np.median(np.partition(squared, nth, axis=2)[..., nth], axis=1)))


def _above(height: FloatArray) -> FloatArray:
    """The area where a function that is linear between nodes is at least 0. (rows, columns) -> (n, 3, 2) of x, y.

    Squares that lie inside are joined along their row; the others are cut as two triangles each.
    """
    high = height >= 0.0
    corners = np.stack([high[:-1, :-1], high[:-1, 1:], high[1:, 1:], high[1:, :-1]])
    whole: BoolArray = np.asarray(corners.all(axis=0))
    cut = np.asarray(corners.any(axis=0)) & ~whole
    row, column = np.nonzero(cut)
    node = np.stack([[column, row], [column + 1, row], [column + 1, row + 1], [column, row + 1]])  # (4, 2, n)
    halves = np.concatenate([node[[0, 1, 2]], node[[0, 2, 3]]], axis=2).transpose(2, 0, 1)  # (2 n, 3, 2)
    return np.concatenate([_runs(whole), _clipped(halves.astype(np.float64), height[halves[..., 1], halves[..., 0]])])


def _runs(whole: BoolArray) -> FloatArray:
    """Two triangles for each run of squares in a row."""
    edge = np.diff(np.pad(whole.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    row, west = np.nonzero(edge == 1)
    _, east = np.nonzero(edge == -1)
    sw, se, ne, nw = (np.stack(at, axis=-1) for at in ((west, row), (east, row), (east, row + 1), (west, row + 1)))
    return np.concatenate([np.stack([sw, se, ne], axis=1), np.stack([sw, ne, nw], axis=1)]).astype(np.float64)


def _clipped(triangle: FloatArray, height: FloatArray) -> FloatArray:
    """The part of each triangle, (n, 3, 2) with heights (n, 3), that lies at least at 0: none, one or two triangles."""
    n_high = (height >= 0.0).sum(axis=1)
    one, two = n_high == 1, n_high == 2
    # The corner that is alone on its side comes first.
    a, b, c, ha, hb, hc = _rotated(triangle[one], height[one], np.argmax(height[one] >= 0.0, axis=1))
    tips = np.stack([a, _crossing(a, b, ha, hb), _crossing(a, c, ha, hc)], axis=1)
    a, b, c, ha, hb, hc = _rotated(triangle[two], height[two], np.argmax(height[two] < 0.0, axis=1))
    ab, ac = _crossing(a, b, ha, hb), _crossing(a, c, ha, hc)
    return np.concatenate([triangle[n_high == 3], tips, np.stack([ab, b, c], axis=1), np.stack([ab, c, ac], axis=1)])


def _rotated(triangle: FloatArray, height: FloatArray, first: IntArray) -> tuple[FloatArray, ...]:
    row, order = np.arange(len(first))[:, None], (first[:, None] + np.arange(3)) % 3
    return *triangle[row, order].transpose(1, 0, 2), *height[row, order].T


def _crossing(a: FloatArray, b: FloatArray, height_a: FloatArray, height_b: FloatArray) -> FloatArray:
    """Where the function is 0 between two corners, one on each side. (n, 2), (n, 2), (n,), (n,) -> (n, 2)."""
    share = height_a / (height_a - height_b)
    return a + share[:, None] * (b - a)
