"""Compiled building of the raster of candidate generators that `_kernels.locate` reads.

A square of pixels, with the generators that may be nearest somewhere in it, is quartered until one generator is left
or the square is one pixel. Generator g is never nearest in a square of half side r around c if some h is nearer in all
of it: |g - c|^2 - |h - c|^2 > 2 r (|h_x - g_x| + |h_y - g_y|). The margin for rounding is on the side of keeping g, so
the nearest of those kept is, to the last bit, the nearest of all.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from tessellation._kernels import LONGEST_LIST, PixelArray
from tessellation.arrays import FloatArray, IntArray

ROUNDING = 1e-12
"""Relative, some thousand times that of a squared distance."""
PIXEL_MARGIN = 1e-6
"""Pixels: beyond its own side a pixel may hold points, by rounding."""
LARGEST_SIDE = 64
"""Smaller pixels along the side of a pixel that is divided further."""
DEEPEST = 4
"""Divisions of pixels into smaller ones; a pixel of still more candidates lists them all."""


class Frame(NamedTuple):
    """Pixels to fill, and where they lie."""

    x: float
    y: float
    pixels_per_metre: float
    n_x: int
    n_y: int
    rounding: float  # metres, of coordinates


@njit(cache=True)
def grown(array, n):  # type: ignore[no-untyped-def]
    """The array itself if it holds n elements, else a copy of at least twice its size."""
    if n <= array.size:
        return array
    larger = np.empty(max(n, 2 * array.size), array.dtype)
    larger[: array.size] = array
    return larger


@njit(cache=True)
def keep_candidates(
    generators: FloatArray, pool: IntArray, squared: FloatArray, start: int, end: int, x: float, y: float, half: float
) -> int:
    """Copy to pool[end:] those of pool[start:end] that may be nearest within `half` of (x, y). -> their end.

    `squared` goes with `pool`, to work in.
    """
    closest, h = np.inf, -1
    for i in range(start, end):
        east, north = generators[pool[i], 0] - x, generators[pool[i], 1] - y
        squared[i] = east * east + north * north
        if squared[i] < closest:
            closest, h = squared[i], pool[i]
    top = end
    h_x, h_y = generators[h, 0], generators[h, 1]
    least = half * half * ROUNDING
    for i in range(start, end):
        g = pool[i]
        bound = 2.0 * half * (abs(h_x - generators[g, 0]) + abs(h_y - generators[g, 1]))
        if squared[i] - closest <= bound + ROUNDING * (squared[i] + closest) + least:
            pool[top], squared[top] = g, squared[i]
            top += 1
    if top - end <= 2 or top - end > 2 * LONGEST_LIST:
        return top
    kept = end
    for i in range(end, top):  # the others may rule out one that the nearest does not
        g = pool[i]
        g_x, g_y, away = generators[g, 0], generators[g, 1], squared[i]
        ruled_out = False
        for j in range(end, top):
            h_x, h_y, other = generators[pool[j], 0], generators[pool[j], 1], squared[j]
            bound = 2.0 * half * (abs(h_x - g_x) + abs(h_y - g_y))
            ruled_out |= away - other > bound + ROUNDING * (away + other) + least
        if not ruled_out:
            pool[kept], squared[kept] = g, away
            kept += 1
    return kept


@njit(cache=True)
def listed(generators: FloatArray, pool: IntArray, start: int, end: int, entry: FloatArray, top: int) -> FloatArray:
    """`entry` with (x, y, cell) of pool[start:end] from `top` on."""
    entry = grown(entry, top + 3 * (end - start))
    for i in range(start, end):
        at = top + 3 * (i - start)
        entry[at], entry[at + 1], entry[at + 2] = generators[pool[i], 0], generators[pool[i], 1], pool[i]
    return entry


@njit(cache=True, nogil=True)
def fill(
    frame: Frame,
    generators: FloatArray,
    candidate: IntArray,
    covered: PixelArray,
    refinement: int,
    deepest: bool,
    entry: FloatArray,
    top: int,
) -> tuple[PixelArray, FloatArray, int, IntArray, IntArray]:
    """Values for all pixels of a frame.

    Args:
        frame: the pixels.
        generators: (n_cells, 2) metres.
        candidate: (k,) those that may be nearest in the frame, ascending.
        covered: (n_y / refinement + 1, n_x / refinement + 1) how many squares south-west of a corner are covered.
        refinement: pixels along the side of a square.
        deepest: list all candidates of a pixel, however many.
        entry: lists of candidates so far.
        top: their end.

    Returns:
        (n_y n_x,) values; entry; its end; (crowded, 3) pixels that need smaller ones, each with the start and the
        end of its candidates in the next; those.
    """
    value = np.full(frame.n_x * frame.n_y, -1, np.int32)
    crowded = np.empty((16, 3), np.int64)
    n_crowded = 0
    waiting = np.empty(1024, np.int64)
    n_waiting = 0
    pool = np.empty(4 * candidate.size + 1024, np.int64)
    pool[: candidate.size] = candidate
    squared = np.empty(pool.size)
    whole = 1
    while whole < max(frame.n_x, frame.n_y):
        whole *= 2
    stack = np.empty((4 * 64, 5), np.int64)
    stack[0] = 0, 0, whole, 0, candidate.size
    n_stack = 1
    while n_stack > 0:
        n_stack -= 1
        west, south, side, start, end = stack[n_stack]
        east, north = min(west + side, frame.n_x), min(south + side, frame.n_y)
        if west >= east or south >= north:
            continue
        w, s = west // refinement, south // refinement
        e, n = (east - 1) // refinement + 1, (north - 1) // refinement + 1
        if covered[n, e] - covered[n, w] - covered[s, e] + covered[s, w] == 0:
            continue
        pool, squared = grown(pool, 2 * end - start), grown(squared, 2 * end - start)
        half = 0.5 * side / frame.pixels_per_metre
        top_kept = keep_candidates(
            generators,
            pool,
            squared,
            start,
            end,
            frame.x + (west + 0.5 * side) / frame.pixels_per_metre,
            frame.y + (south + 0.5 * side) / frame.pixels_per_metre,
            half + PIXEL_MARGIN / frame.pixels_per_metre + frame.rounding,
        )
        start, end = end, top_kept
        if end - start == 1:
            for row in range(south, north):
                below, above = covered[row // refinement], covered[row // refinement + 1]
                for column in range(west, east):
                    c = column // refinement
                    if above[c + 1] - above[c] - below[c + 1] + below[c] > 0:
                        value[row * frame.n_x + column] = pool[start]
        elif side > 1:
            middle = side // 2
            for quarter in range(4):
                stack[n_stack] = west + quarter % 2 * middle, south + quarter // 2 * middle, middle, start, end
                n_stack += 1
        elif end - start <= LONGEST_LIST:
            entry = listed(generators, pool, start, end, entry, top)
            value[south * frame.n_x + west] = -2 - (8 * top + end - start - 1)
            top += 3 * (end - start)
        elif deepest:
            entry = grown(entry, top + 4)
            entry[top : top + 4] = float(end - start), 0.0, 0.0, 0.0
            entry = listed(generators, pool, start, end, entry, top + 4)
            value[south * frame.n_x + west] = -2 - 8 * top
            top += 4 + 3 * (end - start)
        else:
            if n_crowded == crowded.shape[0]:
                larger = np.empty((2 * n_crowded, 3), np.int64)
                larger[:n_crowded] = crowded
                crowded = larger
            waiting = grown(waiting, n_waiting + end - start)
            waiting[n_waiting : n_waiting + end - start] = pool[start:end]
            crowded[n_crowded] = south * frame.n_x + west, n_waiting, n_waiting + end - start
            n_crowded += 1
            n_waiting += end - start
    return value, entry, top, crowded[:n_crowded], waiting
