"""Compiled: the area where a function on a grid is high, as triangles."""

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from tessellation._compiling import COMPILED


@njit(**COMPILED)
def triangles_above(height: FloatArray, vertex: FloatArray, triangle: IntArray) -> tuple[int, int]:
    """The area where a function on a grid is at least 0, slab by slab between neighbouring columns.

    On each column the function, linear between nodes, is high on intervals. Between two columns the intervals that
    overlap are joined by a quadrilateral; where one meets several it is split between them, and one that meets none
    ends in a tip.

    Args:
        height: (rows, columns).
        vertex: (rows * columns * 3, 2) column and row; the first are filled.
        triangle: (rows * columns * 3, 3) of vertices, counter-clockwise; the first are filled.

    Returns:
        How many vertices, how many triangles.
    """
    rows, columns = height.shape
    most = rows // 2 + 1
    # Each interval of this column and the next: its ends, their vertices, and its highest node.
    end, vertex_of, peak = np.empty((2, most, 2)), np.empty((2, most, 2), np.int64), np.empty((2, most), np.int64)
    west, east = np.empty(2, np.int64), np.empty(2, np.int64)  # vertices of a quadrilateral
    n_vertices = n_triangles = n_left = int(np.int64(0))  # a literal would compile what it is given to once more
    for c in range(columns):
        left, right = (c + 1) % 2, c % 2
        n_right = _intervals(height, c, end[right], peak[right])
        for i in range(n_right):
            for side in range(2):
                vertex[n_vertices, 0], vertex[n_vertices, 1] = c, end[right, i, side]
                vertex_of[right, i, side] = n_vertices
                n_vertices += 1
        for i in range(n_left):
            meets = False
            for j in range(n_right):
                if end[left, i, 0] > end[right, j, 1] or end[right, j, 0] > end[left, i, 1]:
                    continue
                meets = True
                for s in range(2):  # south, north
                    west[s] = _share(
                        end[right], vertex_of[left, i], end[left, i], j, s, n_right, c - 1, vertex, n_vertices
                    )
                    n_vertices += west[s] == n_vertices
                    own = vertex_of[right, j]
                    east[s] = _share(end[left], own, end[right, j], i, s, n_left, c, vertex, n_vertices)
                    n_vertices += east[s] == n_vertices
                t = n_triangles
                triangle[t, 0], triangle[t, 1], triangle[t, 2] = west[0], east[0], east[1]
                triangle[t + 1, 0], triangle[t + 1, 1], triangle[t + 1, 2] = west[0], east[1], west[1]
                n_triangles += 2
            if not meets:
                p = peak[left, i]
                vertex[n_vertices, 0] = c - 1 + height[p, c - 1] / (height[p, c - 1] - height[p, c])
                vertex[n_vertices, 1] = p
                triangle[n_triangles, 0], triangle[n_triangles, 1] = vertex_of[left, i, 0], n_vertices
                triangle[n_triangles, 2] = vertex_of[left, i, 1]
                n_vertices += 1
                n_triangles += 1
        for j in range(n_right if c > 0 else 0):
            meets = False
            for i in range(n_left):
                meets |= not (end[left, i, 0] > end[right, j, 1] or end[right, j, 0] > end[left, i, 1])
            if not meets:
                p = peak[right, j]
                vertex[n_vertices, 0] = c - height[p, c] / (height[p, c] - height[p, c - 1])
                vertex[n_vertices, 1] = p
                triangle[n_triangles, 0], triangle[n_triangles, 1] = vertex_of[right, j, 0], vertex_of[right, j, 1]
                triangle[n_triangles, 2] = n_vertices
                n_vertices += 1
                n_triangles += 1
        n_left = n_right
    return n_vertices, n_triangles


@njit(**COMPILED)
def _intervals(height: FloatArray, c: int, end: FloatArray, peak: IntArray) -> int:
    """Fill the ends and the highest node of each interval of a column; -> how many."""
    rows, n, r = len(height), 0, 0
    while r < rows:
        if height[r, c] < 0.0:
            r += 1
            continue
        low = float(r)
        if r > 0:
            low -= height[r, c] / (height[r, c] - height[r - 1, c])
        top = r
        while r + 1 < rows and height[r + 1, c] >= 0.0:
            r += 1
            if height[r, c] > height[top, c]:
                top = r
        high = float(r)
        if r + 1 < rows:
            high += height[r, c] / (height[r, c] - height[r + 1, c])
        end[n, 0], end[n, 1], peak[n] = low, high, top
        n += 1
        r += 1
    return n


@njit(**COMPILED)
def _share(
    others: FloatArray, own_vertex: IntArray, own: FloatArray, k: int, side: int, n: int, column: int,
    vertex: FloatArray, new: int,
) -> int:  # fmt: skip
    """The vertex where the part of an interval ends that goes to the k-th of those beside it: `new` if it is one.

    That is the interval's own end, unless the next of the others on that side overlaps it too: then half-way between.
    """
    beside = k - 1 if side == 0 else k + 1
    if beside < 0 or beside >= n or others[beside, 1] < own[0] or others[beside, 0] > own[1]:
        return int(own_vertex[side])
    vertex[new, 0] = column
    vertex[new, 1] = 0.5 * (others[beside, 1 - side] + others[k, side])
    return new
