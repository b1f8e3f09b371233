"""Compiled Voronoi polygons: a box cut by the bisectors of a generator with those near it, nearest first.

After Rycroft (2009), "Voro++": once the farthest corner is within half the distance of the next generator, no other can
cut. Corners are offsets from the generator, so that large coordinates cost no precision.

Arrays are filled number by number, for a slice assigned to a slice costs a second of compiling; and the first
count of corners is no literal, for which the function that is given it would be compiled once more.
"""

import math

import numpy as np
from numba import njit

from tessellation._arrays import BoolArray, FloatArray, IntArray
from tessellation._compiling import COMPILED
from tessellation._kernels import HEADER, Locator
from tessellation._raster import DEEPEST, LARGEST_SIDE

SHORTEST_EDGE = 1e-9
"""Of the box's diagonal: shorter edges are rounding, where four or more cells meet in a point."""


@njit(**COMPILED)
def cut(corner: FloatArray, label: IntArray, n: int, east: float, north: float, name: int, spare: FloatArray) -> int:
    """Cut a convex polygon to where the origin is nearer than (east, north). -> corners left.

    Args:
        corner: (capacity, 2) the first n in use, counter-clockwise.
        label: (capacity,) which generator made the edge that starts at each corner.
        n: corners in use.
        east: of the other generator, from this one, metres.
        north: the same.
        name: the label of the new edge.
        spare: (capacity, 3) to work in.
    """
    bound = 0.5 * (east * east + north * north)
    outside = False
    for i in range(n):
        outside |= corner[i, 0] * east + corner[i, 1] * north > bound
    if not outside:
        return n
    left = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        here = corner[i, 0] * east + corner[i, 1] * north - bound
        there = corner[j, 0] * east + corner[j, 1] * north - bound
        if here <= 0.0:
            spare[left, 0], spare[left, 1], spare[left, 2] = corner[i, 0], corner[i, 1], label[i]
            left += 1
        if (here <= 0.0) != (there <= 0.0):
            share = here / (here - there)
            spare[left, 0] = corner[i, 0] + share * (corner[j, 0] - corner[i, 0])
            spare[left, 1] = corner[i, 1] + share * (corner[j, 1] - corner[i, 1])
            spare[left, 2] = name if here <= 0.0 else label[i]
            left += 1
    for i in range(left):
        corner[i, 0], corner[i, 1], label[i] = spare[i, 0], spare[i, 1], int(spare[i, 2])
    return left


@njit(**COMPILED)
def twice_area(corner: FloatArray, n: int) -> float:
    """Twice the area of a polygon, counter-clockwise positive."""
    total = 0.0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        total += corner[i, 0] * corner[j, 1] - corner[j, 0] * corner[i, 1]
    return total


@njit(**COMPILED)
def box_corners(corner: FloatArray, west: float, south: float, east: float, north: float) -> int:
    """Write the corners of a box, counter-clockwise. -> 4."""
    corner[0, 0], corner[1, 0], corner[2, 0], corner[3, 0] = west, east, east, west
    corner[0, 1], corner[1, 1], corner[2, 1], corner[3, 1] = south, south, north, north
    return int(np.int64(4))  # no literal


@njit(nogil=True, **COMPILED)
def owned_squares(locator: Locator, refinement: int, owned: IntArray) -> None:
    """The columns and rows of the squares that each cell owns a part of: first and last.

    Args:
        locator: of a Voronoi tessellation.
        refinement: its pixels along the side of a square; of a locator in blocks, those within blocks.
        owned: (n_cells, 4) inside out, to be grown: first column and row, last column and row.
    """
    entry = locator.entry
    n_y, n_x = locator.pixel.shape
    room = owned.shape[0] + 8
    corner, spare, label = np.empty((room, 2)), np.empty((room, 3)), np.empty(room, np.int64)
    room = (DEEPEST + 1) * LARGEST_SIDE * LARGEST_SIDE  # one more of blocks
    waiting, place = np.empty(room, np.int64), np.empty((room, 5))
    for row in range(n_y):
        for column in range(n_x):
            if locator.pixel[row, column] == -1:
                continue
            square_x, square_y = column // refinement, row // refinement
            within_block = locator.block > 0
            waiting[0] = locator.pixel[row, column]
            place[0, 0] = locator.origin_x + column / locator.pixels_per_metre
            place[0, 1] = locator.origin_y + row / locator.pixels_per_metre
            place[0, 2] = 1.0 / locator.pixels_per_metre
            place[0, 3], place[0, 4] = square_x, square_y
            n_waiting = 1
            while n_waiting > 0:
                n_waiting -= 1
                value = waiting[n_waiting]
                x, y, width = place[n_waiting, 0], place[n_waiting, 1], place[n_waiting, 2]
                square_x, square_y = int(place[n_waiting, 3]), int(place[n_waiting, 4])
                at = (-2 - value) >> 3
                n = ((-2 - value) & 7) + 1 if value < 0 else 0
                if n == 1:
                    side = int(entry[at + 3])
                    if side > 0:
                        for i in range(side * side):
                            if entry[at + HEADER + i] == -1.0:
                                continue
                            if within_block:
                                square_x = (column * side + i % side) // refinement
                                square_y = (row * side + i // side) // refinement
                            waiting[n_waiting] = int(entry[at + HEADER + i])
                            place[n_waiting, 3], place[n_waiting, 4] = square_x, square_y
                            place[n_waiting, 0] = x + i % side * (width / side)
                            place[n_waiting, 1] = y + i // side * (width / side)
                            place[n_waiting, 2] = width / side
                            n_waiting += 1
                        within_block = False
                        continue
                    n = int(entry[at])
                    at += 4
                for k in range(max(n, 1)):
                    cell = int(entry[at + 3 * k + 2]) if n > 0 else value
                    box = owned[cell]
                    if box[0] <= square_x <= box[2] and box[1] <= square_y <= box[3]:
                        continue
                    owns = n == 0
                    if n > 0:
                        g_x, g_y = entry[at + 3 * k], entry[at + 3 * k + 1]
                        left = box_corners(corner, x - g_x, y - g_y, x - g_x + width, y - g_y + width)
                        for j in range(n):
                            if j != k:
                                to_x, to_y = entry[at + 3 * j] - g_x, entry[at + 3 * j + 1] - g_y
                                left = cut(corner, label, left, to_x, to_y, cell, spare)
                        owns = left > 2 and twice_area(corner, left) > SHORTEST_EDGE * width * width
                    if owns:
                        box[0], box[1] = min(box[0], square_x), min(box[1], square_y)
                        box[2], box[3] = max(box[2], square_x), max(box[3], square_y)


@njit(nogil=True, **COMPILED)
def cut_boxes(
    generators: FloatArray, cell: IntArray, box: FloatArray, near: IntArray, vertex: FloatArray, label: IntArray,
    n_vertices: IntArray, done: BoolArray,
) -> None:  # fmt: skip
    """Polygons of some cells.

    Args:
        generators: (n_cells, 2) metres.
        cell: (c,) the cells to cut out.
        box: (c, 4) their boxes, as offsets from the generator: west, south, east, north.
        near: (c, k) generators near each, nearest first; itself and numbers beyond the last are left out.
        vertex: (c, k + 8, 2) to be filled: counter-clockwise, offsets from the generator.
        label: (c, k + 8) to be filled: the cell beyond the edge that starts at the vertex; it comes with -1, the box.
        n_vertices: (c,) to be filled.
        done: (c,) to be filled: whether no generator beyond `near` can cut further.
    """
    spare = np.empty((vertex.shape[1], 3))
    for c in range(cell.size):
        g_x, g_y = generators[cell[c], 0], generators[cell[c], 1]
        corner, edge = vertex[c], label[c]
        n = box_corners(corner, box[c, 0], box[c, 1], box[c, 2], box[c, 3])
        shortest = SHORTEST_EDGE * math.hypot(box[c, 2] - box[c, 0], box[c, 3] - box[c, 1])
        done[c] = near.shape[1] >= generators.shape[0]
        farthest = 0.0
        for i in range(4):
            farthest = max(farthest, corner[i, 0] ** 2 + corner[i, 1] ** 2)
        for k in range(near.shape[1]):
            h = near[c, k]
            if h == cell[c] or h >= generators.shape[0]:
                continue
            east, north = generators[h, 0] - g_x, generators[h, 1] - g_y
            if east * east + north * north >= 4.0 * farthest:
                done[c] = True
                break
            n = cut(corner, edge, n, east, north, h, spare)
            farthest = 0.0
            for i in range(n):
                farthest = max(farthest, corner[i, 0] ** 2 + corner[i, 1] ** 2)
        left = 0
        for i in range(n):
            j = i + 1 if i + 1 < n else 0
            if math.hypot(corner[j, 0] - corner[i, 0], corner[j, 1] - corner[i, 1]) > shortest:
                corner[left, 0], corner[left, 1], edge[left] = corner[i, 0], corner[i, 1], edge[i]
                left += 1
        n_vertices[c] = left if left > 2 else 0
