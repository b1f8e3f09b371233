"""Compiled point location: which cell covers a point, in a time that does not grow with the number of cells."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tessellation._arrays import FloatArray, IntArray
from tessellation._compiling import inlined, uncounted

PixelArray = npt.NDArray[np.int32]

SIDE = 16
"""Pixels along the side of a block: as wide as a street and what is beside it."""


class Locator(NamedTuple):
    """A raster over the plane that names the cell of every pixel, or the few cells that share it.

    Pixels stand in blocks of `SIDE` x `SIDE`, and only blocks that have cells are kept. A pixel's value is its cell; -1
    where there is none; and -2 - i where the nearest of the generators entry[first[i]:first[i + 1]] decides: (x, y,
    cell) of each, cells ascending.
    """

    origin_x: float
    origin_y: float
    pixels_per_metre: float
    block: PixelArray  # (n_y, n_x) the number of each block, -1 where there is none
    pixel: PixelArray  # (n_blocks, SIDE * SIDE)
    first: IntArray  # (n_lists + 1,)
    entry: FloatArray  # (n, 3)


@inlined
def locate(locator: Locator, x: float, y: float) -> np.int64:
    """The cell that covers (x, y); -1 where none does. Written so that NaN falls outside."""
    column = (x - locator.origin_x) * locator.pixels_per_metre
    row = (y - locator.origin_y) * locator.pixels_per_metre
    n_y, n_x = locator.block.shape
    value = np.int64(-1)
    if 0.0 <= column < n_x * SIDE and 0.0 <= row < n_y * SIDE:
        r, c = np.int64(row), np.int64(column)
        number = locator.block[r // SIDE, c // SIDE]
        if number >= 0:
            value = locator.pixel[number, r % SIDE * SIDE + c % SIDE]
    if value < -1:
        closest, found, at = np.inf, -1.0, -2 - value
        for i in range(locator.first[at], locator.first[at + 1]):
            east, north = x - locator.entry[i, 0], y - locator.entry[i, 1]
            squared, cell = east * east + north * north, locator.entry[i, 2]  # read anyhow: no branch to guess wrong
            nearer = squared < closest
            found = cell if nearer else found
            closest = squared if nearer else closest
        value = np.int64(found)
    return value


@uncounted
def locate_all(locator: Locator, position: FloatArray, cell: IntArray) -> None:
    """(n, 2) positions -> (n,) cells."""
    for i in range(cell.size):
        cell[i] = locate(locator, position[i, 0], position[i, 1])
