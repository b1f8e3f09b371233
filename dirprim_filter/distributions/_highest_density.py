"""Compiled: kernel densities of a vehicle's rollouts on a grid, and the area where they are high as triangles.

Forecasts come for every vehicle each second of the log: in numpy their regions took as long as tracking did.
"""

import math

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from tessellation._compiling import COMPILED


@njit(**COMPILED)
def neighbour_distances(path: FloatArray, stride: int, nth: int, out: FloatArray) -> None:
    """The median distance of samples to their nth nearest, at each step; the first is the sample itself.

    Args:
        path: (n_samples, n_steps, 2).
        stride: one sample in so many is looked at.
        nth: which neighbour.
        out: (n_steps,) is filled.
    """
    n = (len(path) + stride - 1) // stride
    nearest, of_sample = np.empty(nth + 1), np.empty(n)
    for k in range(path.shape[1]):
        for i in range(n):
            for place in range(nth + 1):
                nearest[place] = np.inf
            for j in range(n):
                dx = path[i * stride, k, 0] - path[j * stride, k, 0]
                dy = path[i * stride, k, 1] - path[j * stride, k, 1]
                squared, place = dx * dx + dy * dy, nth
                while place > 0 and nearest[place - 1] > squared:
                    nearest[place] = nearest[place - 1]
                    place -= 1
                nearest[place] = min(nearest[place], squared)
            of_sample[i] = math.sqrt(nearest[nth])
        _sort(of_sample)
        out[k] = 0.5 * (of_sample[(n - 1) // 2] + of_sample[n // 2])


@njit(**COMPILED)
def highest_densities(
    place: FloatArray, kernel: FloatArray, reach: float, probability: FloatArray, company: float, spared: float,
    eased: float, height: FloatArray,
) -> None:  # fmt: skip
    """How many times its step's level the density is at each node of a grid, at the step where that is most.

    The level is the density at so many of the step's samples that the probability is held; see `highest_density`.

    Args:
        place: (n_samples, n_steps, 2) row and column of each sample, from 0 to the last but one.
        kernel: (n_steps,) standard deviation in nodes.
        reach: standard deviations.
        probability: (k,).
        company: of the density at a lone sample: the least level,
        spared: unless the step would lack more than this of its probability.
        eased: the level is lowered by this factor.
        height: (k, rows, columns) zeros; is filled.
    """
    n_samples, n_steps, _ = place.shape
    rows, columns = height.shape[1:]
    density, at_sample = np.zeros((rows, columns)), np.empty(n_samples)
    widest = 0.0
    for s in range(n_steps):
        widest = max(widest, kernel[s])
    of_row, of_column = np.empty(2 * int(reach * widest + 0.5) + 1), np.empty(2 * int(reach * widest + 0.5) + 1)
    for s in range(n_steps):
        radius = int(reach * kernel[s] + 0.5)
        first_row, first_column, last_row, last_column = rows, columns, 0, 0
        for a in range(n_samples):
            r, c = round(place[a, s, 0]), round(place[a, s, 1])
            _bell(place[a, s, 0] - (r - radius), kernel[s], of_row[: 2 * radius + 1])
            _bell(place[a, s, 1] - (c - radius), kernel[s], of_column[: 2 * radius + 1])
            low_r, high_r = max(r - radius, 0), min(r + radius + 1, rows)
            low_c, high_c = max(c - radius, 0), min(c + radius + 1, columns)
            for i in range(low_r, high_r):
                for j in range(low_c, high_c):
                    density[i, j] += of_row[i - r + radius] * of_column[j - c + radius]
            first_row, last_row = min(first_row, low_r), max(last_row, high_r)
            first_column, last_column = min(first_column, low_c), max(last_column, high_c)
        for a in range(n_samples):
            r, c = int(place[a, s, 0]), int(place[a, s, 1])
            up, right = place[a, s, 0] - r, place[a, s, 1] - c
            at_sample[a] = (1.0 - up) * ((1.0 - right) * density[r, c] + right * density[r, c + 1]) + up * (
                (1.0 - right) * density[r + 1, c] + right * density[r + 1, c + 1]
            )
        _sort(at_sample)
        least = company / (2.0 * math.pi * kernel[s] ** 2)
        enough = 0
        for a in range(n_samples):
            enough += at_sample[a] >= least
        for k in range(probability.size):
            level = at_sample[int((1.0 - probability[k]) * n_samples)]
            if enough >= (probability[k] - spared) * n_samples:
                level = max(level, least)
            for i in range(first_row, last_row):
                for j in range(first_column, last_column):
                    height[k, i, j] = max(height[k, i, j], density[i, j] / (eased * level))
        for i in range(first_row, last_row):
            for j in range(first_column, last_column):
                density[i, j] = 0.0


@njit(**COMPILED)
def _sort(value: FloatArray) -> None:
    """Sort in place, after Shell (1959): numpy's own takes four seconds to compile."""
    gap = value.size // 2
    while gap > 0:
        for i in range(gap, value.size):
            moved, j = value[i], i
            while j >= gap and value[j - gap] > moved:
                value[j] = value[j - gap]
                j -= gap
            value[j] = moved
        gap //= 2


@njit(**COMPILED)
def _bell(middle: float, deviation: float, out: FloatArray) -> None:
    """Fill a normal density at 0, 1, 2, ...; each is the one before times a factor that itself shrinks by another."""
    curvature = 1.0 / deviation**2
    value = math.exp(-0.5 * curvature * middle**2) / (math.sqrt(2.0 * math.pi) * deviation)
    factor = math.exp(curvature * (middle - 0.5))
    shrinks = math.exp(-curvature)
    for i in range(out.size):
        out[i] = value
        value *= factor
        factor *= shrinks


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
