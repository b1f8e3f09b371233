"""Compiled k-means: the start of Arthur and Vassilvitskii (2007) by a tree, and the steps of Lloyd (1982).

The tree is over positions in Morton order: leaves of `LEAF` positions, node i over nodes 2i and 2i + 1. Each node knows
its box, the sum of its positions' weight times squared distance to the nearest seed, and the largest squared distance;
so a seed is drawn, and changes those it is nearest to, without a visit to the others.
"""

import numpy as np
from numba import njit

from tessellation._arrays import FloatArray, IntArray
from tessellation._compiling import COMPILED

LEAF = 16


def boxes(position: FloatArray) -> FloatArray:
    """(2 n_leaves, 4) west, south, east, north of every node; an empty one is inside out."""
    n_leaves = 1
    while n_leaves * LEAF < len(position):
        n_leaves *= 2
    box = np.empty((2 * n_leaves, 4))
    box[:, :2], box[:, 2:] = np.inf, -np.inf
    first = np.arange(0, len(position), LEAF)
    leaf = slice(n_leaves, n_leaves + first.size)
    box[leaf, :2], box[leaf, 2:] = np.minimum.reduceat(position, first), np.maximum.reduceat(position, first)
    while n_leaves > 1:
        child = box[n_leaves : 2 * n_leaves]
        n_leaves //= 2
        box[n_leaves : 2 * n_leaves, :2] = np.minimum(child[::2, :2], child[1::2, :2])
        box[n_leaves : 2 * n_leaves, 2:] = np.maximum(child[::2, 2:], child[1::2, 2:])
    return box


def seeds(position: FloatArray, weight: FloatArray, uniform: FloatArray) -> IntArray:
    """k-means++: positions, each drawn by weight times squared distance to those before. -> at most (k,) row numbers.

    Args:
        position: (n, 2) metres, in an order that keeps neighbours together.
        weight: (n,) positive.
        uniform: (k,) random numbers in [0, 1).
    """
    box = boxes(position)
    n_leaves = len(box) // 2
    mass = np.zeros(2 * n_leaves)
    mass[n_leaves:] = np.bincount(np.arange(len(position)) // LEAF, weight, minlength=n_leaves)
    for i in range(n_leaves - 1, 0, -1):
        mass[i] = mass[2 * i] + mass[2 * i + 1]
    chosen, changed = np.empty(uniform.size, np.int64), np.empty(n_leaves, np.int64)
    infinite = np.full(len(position) + 2 * n_leaves, np.inf)
    squared, largest = infinite[: len(position)], infinite[len(position) :]
    return chosen[: _draw(position, weight, uniform, box, mass, squared, largest, chosen, changed)]


@njit(nogil=True, error_model="numpy", **COMPILED)
def _draw(
    position: FloatArray, weight: FloatArray, uniform: FloatArray, box: FloatArray, mass: FloatArray,
    squared: FloatArray, largest: FloatArray, chosen: IntArray, changed: IntArray,
) -> int:  # fmt: skip
    """Fill `chosen` (k,) with `seeds`. -> how many there are; fewer than k where all others are of one place with them.

    Args:
        position: (n, 2) metres.
        weight: (n,) of each.
        uniform: (k,) random numbers.
        box: (2 n_leaves, 4) of the nodes.
        mass: (2 n_leaves,) weight in each node.
        squared: (n,) infinite: distance of each position to the nearest seed, and
        largest: (2 n_leaves,) infinite: its most in each node.
        chosen: (k,) to be filled.
        changed: (n_leaves,) to work in.
    """
    n, n_leaves = weight.size, changed.size
    stack = np.empty(128, np.int64)
    for k in range(uniform.size):
        if not mass[1] > 0.0:
            return k
        left = uniform[k] * mass[1]
        node = 1
        while node < n_leaves:
            node *= 2
            if mass[node + 1] > 0.0 and (left >= mass[node] or mass[node] == 0.0):
                left -= mass[node]
                node += 1
        seed = -1
        start = (node - n_leaves) * LEAF
        for i in range(start, min(start + LEAF, n)):
            share = weight[i] * (squared[i] if k > 0 else 1.0)
            if share > 0.0 and (left >= 0.0 or seed < 0):
                seed = i
            left -= share
        chosen[k] = seed
        x, y = position[seed, 0], position[seed, 1]
        n_changed, n_stack = 0, 1
        stack[0] = 1
        while n_stack > 0:
            n_stack -= 1
            node = stack[n_stack]
            east = max(box[node, 0] - x, x - box[node, 2], 0.0)
            north = max(box[node, 1] - y, y - box[node, 3], 0.0)
            if east * east + north * north >= largest[node]:
                continue
            if node < n_leaves:
                stack[n_stack], stack[n_stack + 1] = 2 * node, 2 * node + 1
                n_stack += 2
                continue
            mass[node], largest[node] = 0.0, 0.0
            start = (node - n_leaves) * LEAF
            for i in range(start, min(start + LEAF, n)):
                squared[i] = min(squared[i], (position[i, 0] - x) ** 2 + (position[i, 1] - y) ** 2)
                mass[node] += weight[i] * squared[i]
                largest[node] = max(largest[node], squared[i])
            changed[n_changed] = node
            n_changed += 1
        while n_changed > 0 and changed[0] > 1:  # towards the root, each parent once
            n_parents = 0
            for i in range(n_changed):
                node = changed[i] // 2
                if n_parents == 0 or changed[n_parents - 1] != node:
                    mass[node] = mass[2 * node] + mass[2 * node + 1]
                    largest[node] = max(largest[2 * node], largest[2 * node + 1])
                    changed[n_parents] = node
                    n_parents += 1
            n_changed = n_parents
    return uniform.size


def means(position: FloatArray, weight: FloatArray, cell: IntArray, generators: FloatArray) -> tuple[FloatArray, float]:
    """One step of Lloyd's: the cells' means, and the weighted squared distance to the generators.

    A cell of no position keeps its generator.
    """
    total = np.zeros((3, len(generators)))
    spread = _sum_offsets(position, weight, cell, generators, total)
    return generators + (total[:2] / np.where(total[2] > 0.0, total[2], 1.0)).T, spread


@njit(nogil=True, error_model="numpy", **COMPILED)
def _sum_offsets(
    position: FloatArray, weight: FloatArray, cell: IntArray, generators: FloatArray, total: FloatArray
) -> float:
    """Add weight times offset, and weight, to `total` (3, n_cells). -> the weighted squared offsets."""
    spread = 0.0
    for i in range(weight.size):
        c = cell[i]
        east, north = position[i, 0] - generators[c, 0], position[i, 1] - generators[c, 1]
        total[0, c] += weight[i] * east
        total[1, c] += weight[i] * north
        total[2, c] += weight[i]
        spread += weight[i] * (east * east + north * north)
    return spread
