"""Compiled: kernel densities of a vehicle's futures on a grid, and the area where they are high as triangles.

Forecasts come for every vehicle each second of the log: in numpy their regions took as long as tracking did.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from tessellation.arrays import FloatArray, IntArray


class Knobs(NamedTuple):
    """What `highest_density` says of them, by its names there."""

    n_squares: int
    finest_m: float
    narrowest: float
    widest: float
    reach: float
    neighbour: int
    neighbours_among: int
    company: float
    spared: float
    eased: float
    faintest: float


@njit(cache=True, nogil=True)
def regions(
    path: FloatArray, probability: FloatArray, knobs: Knobs
) -> tuple[FloatArray, IntArray, IntArray, IntArray]:  # fmt: skip
    """The regions of one vehicle, one after the other.

    Args:
        path: (n_samples, n_steps, 2) metres.
        probability: (k,) of each region.
        knobs: as `highest_density` has them.

    Returns:
        (n, 2) vertices, metres; (m, 3) triangles, of the vertices of their own region; (k,) how many vertices each
        has, and (k,) how many triangles.
    """
    n_samples, n_steps, _ = path.shape
    west, south, east, north = path[0, 0, 0], path[0, 0, 1], path[0, 0, 0], path[0, 0, 1]
    for a in range(n_samples):
        for s in range(n_steps):
            west, east = min(west, path[a, s, 0]), max(east, path[a, s, 0])
            south, north = min(south, path[a, s, 1]), max(north, path[a, s, 1])
    side = max(max(east - west, north - south) / knobs.n_squares, knobs.finest_m)
    margin = math.ceil(knobs.reach * knobs.narrowest) * side
    west, south = west - margin, south - margin
    columns = math.ceil((east + margin - west) / side) + 1
    rows = math.ceil((north + margin - south) / side) + 1
    place = np.empty((n_samples, n_steps, 2))
    for a in range(n_samples):
        for s in range(n_steps):
            place[a, s, 0] = (path[a, s, 1] - south) / side
            place[a, s, 1] = (path[a, s, 0] - west) / side
    stride = max(n_samples // knobs.neighbours_among, 1)
    kernel = np.empty(n_steps)
    neighbour_distances(path, stride, min(knobs.neighbour, (n_samples - 1) // stride), kernel)
    for s in range(n_steps):
        kernel[s] = min(max(kernel[s] / side, knobs.narrowest), knobs.widest)
    k, size = probability.size, 3 * rows * columns
    height = np.zeros((k, rows, columns))
    highest_densities(place, kernel, knobs.reach, probability, knobs.company, knobs.spared, knobs.eased, height)
    for i in range(k):
        for r in range(rows):
            for c in range(columns):
                height[i, r, c] = math.log(max(height[i, r, c], knobs.faintest))
    vertex, triangle = np.empty((k * size, 2)), np.empty((k * size, 3), np.int64)
    n_vertices, n_triangles = np.zeros(k, np.int64), np.zeros(k, np.int64)
    v = t = 0
    for i in range(k):
        is_tall = rows > columns  # cut across the longer axis: edges are finer along it
        of_axes = np.ascontiguousarray(height[i].T) if is_tall else height[i]
        n_vertices[i], n_triangles[i] = triangles_above(of_axes, vertex[v:], triangle[t:])
        for a in range(v, v + n_vertices[i]):
            x, y = vertex[a, 0], vertex[a, 1]
            if is_tall:
                x, y = y, x
            vertex[a, 0], vertex[a, 1] = west + side * x, south + side * y
        if is_tall:  # mirrored: the other way round is counter-clockwise then
            for b in range(t, t + n_triangles[i]):
                triangle[b, 0], triangle[b, 2] = triangle[b, 2], triangle[b, 0]
        v, t = v + n_vertices[i], t + n_triangles[i]
    return vertex[:v].copy(), triangle[:t].copy(), n_vertices, n_triangles


@njit(cache=True)
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
            nearest[:] = np.inf
            for j in range(n):
                dx = path[i * stride, k, 0] - path[j * stride, k, 0]
                dy = path[i * stride, k, 1] - path[j * stride, k, 1]
                squared, place = dx * dx + dy * dy, nth
                while place > 0 and nearest[place - 1] > squared:
                    nearest[place] = nearest[place - 1]
                    place -= 1
                nearest[place] = min(nearest[place], squared)
            of_sample[i] = math.sqrt(nearest[nth])
        out[k] = np.median(of_sample)


@njit(cache=True)
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
    widest = 2 * int(reach * kernel.max() + 0.5) + 1
    of_row, of_column = np.empty(widest), np.empty(widest)
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
        at_sample.sort()
        least = company / (2.0 * math.pi * kernel[s] ** 2)
        enough = n_samples - np.searchsorted(at_sample, least)
        for k in range(probability.size):
            level = at_sample[int((1.0 - probability[k]) * n_samples)]
            if enough >= (probability[k] - spared) * n_samples:
                level = max(level, least)
            for i in range(first_row, last_row):
                for j in range(first_column, last_column):
                    height[k, i, j] = max(height[k, i, j], density[i, j] / (eased * level))
        density[first_row:last_row, first_column:last_column] = 0.0


@njit(cache=True)
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


@njit(cache=True)
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
    n_vertices = n_triangles = n_left = 0
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
                sw = _share(end[right], vertex_of[left, i], end[left, i], j, 0, n_right, c - 1, vertex, n_vertices)
                n_vertices += sw == n_vertices
                se = _share(end[left], vertex_of[right, j], end[right, j], i, 0, n_left, c, vertex, n_vertices)
                n_vertices += se == n_vertices
                ne = _share(end[left], vertex_of[right, j], end[right, j], i, 1, n_left, c, vertex, n_vertices)
                n_vertices += ne == n_vertices
                nw = _share(end[right], vertex_of[left, i], end[left, i], j, 1, n_right, c - 1, vertex, n_vertices)
                n_vertices += nw == n_vertices
                triangle[n_triangles] = np.array([sw, se, ne])
                triangle[n_triangles + 1] = np.array([sw, ne, nw])
                n_triangles += 2
            if not meets:
                p = peak[left, i]
                vertex[n_vertices, 0] = c - 1 + height[p, c - 1] / (height[p, c - 1] - height[p, c])
                vertex[n_vertices, 1] = p
                triangle[n_triangles] = np.array([vertex_of[left, i, 0], n_vertices, vertex_of[left, i, 1]])
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
                triangle[n_triangles] = np.array([vertex_of[right, j, 0], vertex_of[right, j, 1], n_vertices])
                n_vertices += 1
                n_triangles += 1
        n_left = n_right
    return n_vertices, n_triangles


@njit(cache=True)
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


@njit(cache=True)
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
