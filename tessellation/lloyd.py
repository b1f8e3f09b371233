"""Generators at the means of the positions nearest to them: k-means in the plane (Lloyd 1982)."""

from __future__ import annotations

import numpy as np

from tessellation._arrays import FloatArray, IntArray
from tessellation.gates import nearest_generators

MAX_STEPS = 100
LEAST_GAIN = 1e-4
"""Of the squared distances; a step that lowers them by less is the last."""
SAME_M = 1e-6
"""Positions as near to each other are one: parked vehicles jitter by rounding."""
MOST_DISTANCES = 500_000_000
"""From positions to seeds: of more, seeds are chosen among every second, third, ... position."""


def lloyd_generators(position: FloatArray, *, n_cells: int, rng: np.random.Generator) -> FloatArray:
    """Generators by k-means: seeds far from each other, then means of the nearest positions. -> (at most n_cells, 2).

    The order of the positions does not matter, nor where they are or which way they are turned; a position given twice
    counts as one of twice the weight.

    Args:
        position: (n, 2) metres, n >= 1.
        n_cells: at most so many; fewer if there are fewer distinct positions.
        rng: chooses the seeds.

    Raises:
        ValueError: no cell is asked for.
    """
    if n_cells < 1:
        raise ValueError(f"n_cells: expected at least 1, got {n_cells}")
    position, weight = _distinct(position)
    stride = 1 + len(position) * n_cells // MOST_DISTANCES
    generators = position[::stride][seeds(position[::stride], weight[::stride], rng.random(n_cells))]
    before = np.inf
    for _ in range(MAX_STEPS):
        cell = nearest_generators(position, generators, k=1)[1][:, 0]
        off, n = position - generators[cell], len(generators)
        spread = float(weight @ (off * off).sum(axis=1))
        if spread >= before * (1.0 - LEAST_GAIN):
            break
        total = np.bincount(cell, weight, n)
        moved = np.column_stack([np.bincount(cell, weight * along, n) for along in off.T])
        generators, before = generators + moved / np.where(total > 0, total, 1.0)[:, None], spread
    cell = nearest_generators(position, generators, k=1)[1][:, 0]
    generators = generators[np.bincount(cell, minlength=len(generators)) > 0]
    return generators[np.lexsort(generators.T)]


def seeds(position: FloatArray, weight: FloatArray, uniform: FloatArray) -> IntArray:
    """k-means++ (Arthur and Vassilvitskii 2007): each is drawn by weight times squared distance to those before.

    Args:
        position: (n, 2) metres.
        weight: (n,) positive.
        uniform: (k,) random numbers in [0, 1).

    Returns:
        Row numbers, at most (k,): fewer where all others are of one place with them.
    """
    chosen: list[int] = []
    squared = np.ones(weight.size)
    for u in uniform.tolist():
        cumulative = np.cumsum(weight * squared)
        if not cumulative[-1] > 0.0:
            break
        at = int(np.searchsorted(cumulative, u * cumulative[-1], side="right"))
        away = ((position - position[at]) ** 2).sum(axis=1)
        squared = np.minimum(squared, away) if chosen else away
        chosen.append(at)
    return np.array(chosen, dtype=np.int64)


def _distinct(position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distinct positions, along their principal axes, each towards its longer tail, and how often each is given.

    So they come in the same order however they were turned.
    """
    offset = position - position[0]
    offset -= offset.mean(axis=0)
    along = offset @ np.linalg.eigh(offset.T @ offset)[1]
    along = along * np.where((along**3).sum(axis=0) < 0, -1.0, 1.0)
    position = position[np.lexsort(along.T)]
    new = np.flatnonzero(np.append(True, (np.abs(np.diff(position, axis=0)) > SAME_M).any(axis=1)))
    return position[new], np.diff(np.append(new, len(position))).astype(np.float64)
