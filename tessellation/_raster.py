"""Compiled building of the raster of candidate generators that `_kernels.locate` reads.

A square of pixels, with the generators that may be nearest somewhere in it, is quartered until one generator is left
or the square is one pixel. Generator g is never nearest in a square of half side r around c if some h is nearer in all
of it: |g - c|^2 - |h - c|^2 > 2 r (|h_x - g_x| + |h_y - g_y|). The margin for rounding is on the side of keeping g, so
the nearest of those kept is, to the last bit, the nearest of all.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from tessellation._arrays import FloatArray, IntArray
from tessellation._compiling import COMPILED
from tessellation._kernels import LONGEST_LIST, PixelArray

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


@njit(**COMPILED)
def grown_whole(array: IntArray, n: int) -> IntArray:
    """The array itself if it holds n elements, else a copy of at least twice its size."""
    if n <= array.size:
        return array
    larger = np.empty(max(n, 2 * array.size), np.int64)
    for i in range(array.size):
        larger[i] = array[i]
    return larger


@njit(**COMPILED)
def grown(array: FloatArray, n: int) -> FloatArray:
    """Likewise."""
    if n <= array.size:
        return array
    larger = np.empty(max(n, 2 * array.size))
    for i in range(array.size):
        larger[i] = array[i]
    return larger


@njit(**COMPILED)
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


@njit(nogil=True, **COMPILED)
def fill(
    frame: Frame,
    generators: FloatArray,
    candidate: IntArray,
    covered: PixelArray,
    refinement: int,
    deepest: bool,
    entry: FloatArray,
    top: int,
    value: PixelArray,
) -> tuple[FloatArray, int, IntArray, int, IntArray]:
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
        value: (n_y n_x,) of -1, to be filled.

    Returns:
        entry; its end; crowded: pixels that need smaller ones, each with the start and the end of its candidates in
        the last; how many numbers of that are in use; those candidates.
    """
    crowded = np.empty(48, np.int64)
    n_crowded = 0
    waiting = np.empty(1024, np.int64)
    n_waiting = 0
    pool = np.empty(4 * candidate.size + 1024, np.int64)
    for i in range(candidate.size):
        pool[i] = candidate[i]
    squared = np.empty(pool.size)
    whole = 1
    while whole < max(frame.n_x, frame.n_y):
        whole *= 2
    stack = np.empty((4 * 64, 5), np.int64)
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3], stack[0, 4] = 0, 0, whole, 0, candidate.size
    n_stack = 1
    while n_stack > 0:
        n_stack -= 1
        west, south, side = stack[n_stack, 0], stack[n_stack, 1], stack[n_stack, 2]
        start, end = stack[n_stack, 3], stack[n_stack, 4]
        east, north = min(west + side, frame.n_x), min(south + side, frame.n_y)
        if west >= east or south >= north:
            continue
        w, s = west // refinement, south // refinement
        e, n = (east - 1) // refinement + 1, (north - 1) // refinement + 1
        if covered[n, e] - covered[n, w] - covered[s, e] + covered[s, w] == 0:
            continue
        pool, squared = grown_whole(pool, 2 * end - start), grown(squared, 2 * end - start)
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
                stack[n_stack, 0], stack[n_stack, 1] = west + quarter % 2 * middle, south + quarter // 2 * middle
                stack[n_stack, 2], stack[n_stack, 3], stack[n_stack, 4] = middle, start, end
                n_stack += 1
        elif deepest or end - start <= LONGEST_LIST:
            long = end - start > LONGEST_LIST
            at = top + 4 * long
            value[south * frame.n_x + west] = -2 - (8 * top + (0 if long else end - start - 1))
            entry = grown(entry, at + 3 * (end - start))
            if long:
                entry[top], entry[top + 1], entry[top + 2], entry[top + 3] = end - start, 0.0, 0.0, 0.0
            for i in range(start, end):
                entry[at], entry[at + 1], entry[at + 2] = generators[pool[i], 0], generators[pool[i], 1], pool[i]
                at += 3
            top = at
        else:
            crowded = grown_whole(crowded, n_crowded + 3)
            crowded[n_crowded], crowded[n_crowded + 1] = south * frame.n_x + west, n_waiting
            waiting = grown_whole(waiting, n_waiting + end - start)
            for i in range(start, end):
                waiting[n_waiting] = pool[i]
                n_waiting += 1
            crowded[n_crowded + 2] = n_waiting
            n_crowded += 3
    return entry, top, crowded, n_crowded, waiting
