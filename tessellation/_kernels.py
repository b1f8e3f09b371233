"""Compiled point location: which cell covers a point, in a time that does not grow with the number of cells."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from tessellation._arrays import FloatArray, IntArray
from tessellation._compiling import COMPILED

PixelArray = npt.NDArray[np.int32]

LONGEST_LIST = 8
"""Candidates in a pixel; one with more is divided further. Three bits of a pixel's value hold their number."""
HEADER = 6
"""Numbers before the values of smaller pixels."""
BATCH = 256
"""Points located together, so that the memory they need is fetched at the same time."""


class Locator(NamedTuple):
    """A raster over the plane that names the cell of every pixel, or the few cells that share it.

    A pixel's value is its cell; -1 where there is none; and -2 - (8 i + n - 1) where the nearest of n generators
    decides: entry[i:] holds (x, y, cell) of each, cells ascending. With n = 1 entry[i:] holds instead
    (x, y, pixels per metre, m, column, row) of m x m smaller pixels, counted from (x, y) on, of which theirs is the
    first column and row, and then their values; or, if m = 0, (k, 0, 0, 0) and k generators. Smaller pixels know where
    they lie, so the value of a pixel may be given to its neighbours.
    """

    origin_x: float
    origin_y: float
    pixels_per_metre: float
    pixel: PixelArray  # (n_y, n_x)
    entry: FloatArray  # (n,)
    block: int = 0  # smaller pixels along the side of each pixel, where all have such or no cell; see `blocks`


@njit(inline="always", **COMPILED)
def nearest_listed(entry: FloatArray, at: int, n: int, x: float, y: float) -> int:
    """The cell of the nearest of n generators listed at entry[at:]; of the first if several are."""
    closest, found = np.inf, -1.0
    for i in range(at, at + 3 * n, 3):
        east, north = x - entry[i], y - entry[i + 1]
        squared, cell = east * east + north * north, entry[i + 2]  # read anyhow: a branch would be guessed wrong
        nearer = squared < closest
        found = cell if nearer else found
        closest = squared if nearer else closest
    return int(found)


@njit(inline="always", **COMPILED)
def nearest(entry: FloatArray, value: int, x: float, y: float) -> int:
    """The cell at (x, y) in a pixel that several share: of the nearest generator, of the first if several are."""
    at = (-2 - value) >> 3
    n = ((-2 - value) & 7) + 1
    while n == 1:
        side = int(entry[at + 3])
        if side == 0:
            n = int(entry[at])
            at += 4
            break
        column = min(max((x - entry[at]) * entry[at + 2] - entry[at + 4], 0.0), side - 1.0)
        row = min(max((y - entry[at + 1]) * entry[at + 2] - entry[at + 5], 0.0), side - 1.0)
        value = int(entry[at + HEADER + int(row) * side + int(column)])
        at = (-2 - value) >> 3
        n = ((-2 - value) & 7) + 1 if value < -1 else 0
    if n > 0:
        value = nearest_listed(entry, at, n, x, y)
    return value


@njit(inline="always", **COMPILED)
def locate(locator: Locator, x: float, y: float) -> int:
    """The cell that covers (x, y); -1 where none does. Written so that NaN falls outside."""
    column = (x - locator.origin_x) * locator.pixels_per_metre
    row = (y - locator.origin_y) * locator.pixels_per_metre
    n_y, n_x = locator.pixel.shape
    if not (0.0 <= column < n_x and 0.0 <= row < n_y):
        return -1
    value = locator.pixel[int(row), int(column)]
    if value >= -1:
        return value
    return nearest(locator.entry, value, x, y)


@njit(nogil=True, **COMPILED)
def locate_all(locator: Locator, position: FloatArray, cell: IntArray) -> float:
    """(n, 2) positions -> (n,) cells, as `locate` finds them one by one.

    A point waits for its pixel, and then for its candidates, to come from memory; and it makes the processor guess how
    many they are. In batches the memory is asked for before it is needed, and points of as many candidates go together.
    """
    return locate_batches(locator, position, cell, np.empty((LONGEST_LIST + 3, BATCH), np.int64))


@njit(nogil=True, **COMPILED)
def locate_batches(locator: Locator, position: FloatArray, cell: IntArray, room: IntArray) -> float:
    """`locate_all` in (LONGEST_LIST + 3, BATCH) numbers of room: to allocate it takes as long as to locate a batch."""
    n_y, n_x = locator.pixel.shape
    pixel, entry = locator.pixel.ravel(), locator.entry
    value, shared, member, n_members = room[0], room[1], room[1:], room[LONGEST_LIST + 2]
    touched = 0.0
    for start in range(0, position.shape[0], BATCH):
        n, n_shared = min(BATCH, position.shape[0] - start), 0
        for i in range(n):
            column = (position[start + i, 0] - locator.origin_x) * locator.pixels_per_metre
            row = (position[start + i, 1] - locator.origin_y) * locator.pixels_per_metre
            inside = 0.0 <= column < n_x and 0.0 <= row < n_y
            value[i] = int(row) * n_x + int(column) if inside else -1
        for i in range(n):
            value[i] = pixel[max(value[i], 0)] if value[i] >= 0 else -1
        for i in range(n):
            cell[start + i] = value[i]
            shared[n_shared] = i
            n_shared += value[i] < -1
        n_members[: LONGEST_LIST + 1] = 0
        for k in range(n_shared):
            i = shared[k]
            at, n_candidates = (-2 - value[i]) >> 3, ((-2 - value[i]) & 7) + 1
            member[n_candidates, n_members[n_candidates]] = i
            n_members[n_candidates] += 1
            touched += entry[at] + entry[at + 3 * n_candidates - 1]
        for n_candidates in range(1, LONGEST_LIST + 1):
            for k in range(n_members[n_candidates]):
                i = member[n_candidates, k]
                x, y = position[start + i, 0], position[start + i, 1]
                if n_candidates == 1:
                    cell[start + i] = nearest(entry, value[i], x, y)
                    continue
                at = (-2 - value[i]) >> 3
                cell[start + i] = nearest_listed(entry, at, n_candidates, x, y)
    return touched  # so that the compiler does not take the fetching for idle
