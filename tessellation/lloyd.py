"""Generators at the means of the positions nearest to them: k-means in the plane, linear in positions."""

from __future__ import annotations

import numpy as np

from tessellation._arrays import FloatArray, IntArray, as_floats
from tessellation._kernels import Locator
from tessellation._seeding import means, seeds
from tessellation.gates import nearest_generators
from tessellation.locate import cells_of, voronoi_locator

MAX_STEPS = 100
LEAST_GAIN = 1e-4
"""Of the squared distances; a step that lowers them by less is the last."""
FEW = 8192
"""So many positions are looked up in a tree sooner than a raster of the cells is drawn, which is new at every step."""


def lloyd_generators(
    position: FloatArray,
    *,
    region: Locator,
    n_cells: int,
    rng: np.random.Generator,
    weight: FloatArray | None = None,
) -> FloatArray:
    """Generators by k-means: seeds far from each other, then means of the nearest positions. -> (at most n_cells, 2).

    The order of the positions does not matter, nor where they are or which way they are turned; a position given twice
    counts as one of twice the weight.

    Args:
        position: (n, 2) metres.
        region: squares that hold every position.
        n_cells: at most so many; fewer if there are fewer distinct positions of positive weight.
        rng: chooses the seeds.
        weight: (n,) of each position, not negative; 1 if not given.

    Raises:
        ValueError: no position of positive weight, or arguments out of range.
    """
    weight = np.ones(len(position)) if weight is None else as_floats("weight", weight, "n")
    if weight.shape != position.shape[:1]:
        raise ValueError(f"weight: expected shape ({len(position)},) as positions, got {weight.shape}")
    if (weight < 0).any():
        raise ValueError(f"weight: expected no negative number, got {weight.min()} at {int(weight.argmin())}")
    if not weight.any():
        raise ValueError("weight: expected at least one position of positive weight, got none")
    if n_cells < 1:
        raise ValueError(f"n_cells: expected at least 1, got {n_cells}")
    position, weight = _distinct(position[weight > 0], weight[weight > 0])
    weight = weight / weight.max()
    generators = position[seeds(position, weight, rng.random(min(n_cells, len(position))))]
    generators = generators[np.lexsort(generators.T)]
    before = np.inf
    for _ in range(MAX_STEPS):
        cell = _nearest(generators, region, position)
        moved, spread = means(position, weight, cell, generators)
        if spread >= before * (1.0 - LEAST_GAIN):
            break
        generators, before = moved, spread
    cell = _nearest(generators, region, position)
    return generators[np.bincount(cell, minlength=len(generators)) > 0]


def _nearest(generators: FloatArray, region: Locator, position: FloatArray) -> IntArray:
    """The nearest generator of each position, (n, 2) -> (n,)."""
    if len(position) <= FEW:
        return nearest_generators(position, generators, k=1)[1][:, 0]
    return cells_of(voronoi_locator(generators, region), position)


def _distinct(position: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distinct positions in Morton order, so that neighbours are near in memory, and their weights."""
    along = _along_axes(position, weight)
    low = along.min(axis=0)
    extent = float((along - low).max())
    fine: IntArray = ((along - low) * (65535.0 / extent if extent > 0 else 0.0)).astype(np.int64)
    order = np.lexsort((weight, *along.T, _spread_bits(fine[:, 0]) + 2 * _spread_bits(fine[:, 1])))
    position, weight = position[order], weight[order]
    new = np.append(True, (position[1:] != position[:-1]).any(axis=1))
    return position[new], np.add.reduceat(weight, np.flatnonzero(new))


def _along_axes(position: FloatArray, weight: FloatArray) -> FloatArray:
    """Positions along their principal axes, each towards its longer tail: the same however they were turned."""
    offset = position - position[0]
    offset -= weight @ offset / weight.sum()
    along = offset @ np.linalg.eigh((weight * offset.T) @ offset)[1]
    return np.asarray(along * np.where(weight @ along**3 < 0, -1.0, 1.0))


def _spread_bits(number: IntArray) -> IntArray:
    """Sixteen bits with a zero between any two."""
    for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        number = (number | (number << shift)) & mask
    return number
