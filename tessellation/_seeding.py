"""Compiled k-means: the start of Arthur and Vassilvitskii (2007) by a tree, and the steps of Lloyd (1982).

The tree is over positions in Morton order: leaves of `LEAF` positions, node i over nodes 2i and 2i + 1. Each node knows
its box, the sum of its positions' weight times squared distance to the nearest seed, and the largest squared distance;
so a seed is drawn, and changes those it is nearest to, without a visit to the others.
"""

import numpy as np
from numba import njit

from tessellation.arrays import FloatArray, IntArray

LEAF = 16


@njit(cache=True)
def boxes(position: FloatArray, n_leaves: int) -> FloatArray:
    """(2 n_leaves, 4) west, south, east, north of every node; an empty one is inside out."""
    box = np.empty((2 * n_leaves, 4))
    box[:, :2], box[:, 2:] = np.inf, -np.inf
    for i in range(position.shape[0]):
        node = box[n_leaves + i // LEAF]
        node[0], node[1] = min(node[0], position[i, 0]), min(node[1], position[i, 1])
        node[2], node[3] = max(node[2], position[i, 0]), max(node[3], position[i, 1])
    for i in range(n_leaves - 1, 0, -1):
        left, right = box[2 * i], box[2 * i + 1]
        box[i, 0], box[i, 1] = min(left[0], right[0]), min(left[1], right[1])
        box[i, 2], box[i, 3] = max(left[2], right[2]), max(left[3], right[3])
    return box


@njit(cache=True, nogil=True)
def seeds(position: FloatArray, weight: FloatArray, uniform: FloatArray) -> IntArray:
    """k-means++: positions, each drawn by weight times squared distance to those before. -> at most (k,) row numbers.

    Args:
        position: (n, 2) metres, in an order that keeps neighbours together.
        weight: (n,) positive.
        uniform: (k,) random numbers in [0, 1).
    """
    n = position.shape[0]
    n_leaves = 1
    while n_leaves * LEAF < n:
        n_leaves *= 2
    box = boxes(position, n_leaves)
    squared = np.full(n, np.inf)  # to the nearest seed
    mass, largest = np.zeros(2 * n_leaves), np.full(2 * n_leaves, np.inf)
    for i in range(n):
        mass[n_leaves + i // LEAF] += weight[i]
    for i in range(n_leaves - 1, 0, -1):
        mass[i] = mass[2 * i] + mass[2 * i + 1]
    chosen = np.empty(uniform.size, np.int64)
    changed, stack = np.empty(n_leaves, np.int64), np.empty(128, np.int64)
    for k in range(uniform.size):
        if not mass[1] > 0.0:
            return chosen[:k]
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
    return chosen


@njit(cache=True, nogil=True)
def means(
    position: FloatArray, weight: FloatArray, cell: IntArray, generators: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """One step of Lloyd's: the cells' means, their weights, and the weighted squared distance to the generators.

    A cell of no position keeps its generator.
    """
    moved, mass = np.zeros_like(generators), np.zeros(generators.shape[0])
    spread = 0.0
    for i in range(position.shape[0]):
        c = cell[i]
        east, north = position[i, 0] - generators[c, 0], position[i, 1] - generators[c, 1]
        moved[c, 0] += weight[i] * east
        moved[c, 1] += weight[i] * north
        mass[c] += weight[i]
        spread += weight[i] * (east * east + north * north)
    for c in range(generators.shape[0]):
        share = 1.0 / mass[c] if mass[c] > 0.0 else 0.0
        moved[c, 0] = generators[c, 0] + share * moved[c, 0]
        moved[c, 1] = generators[c, 1] + share * moved[c, 1]
    return moved, mass, spread
