"""Compiled point location: which cell covers a point."""

from typing import NamedTuple

import numpy as np
from numba import njit

from tessellation.arrays import FloatArray, IntArray


class Locator(NamedTuple):
    """A raster over the plane that names the cell of every pixel; -1 where there is none."""

    origin_x: float
    origin_y: float
    pixels_per_metre: float
    cell: IntArray  # (n_y, n_x)


@njit(cache=True, inline="always")
def locate(locator: Locator, x: float, y: float) -> int:
    """The cell that covers (x, y); -1 where none does. Written so that NaN falls outside."""
    column = (x - locator.origin_x) * locator.pixels_per_metre
    row = (y - locator.origin_y) * locator.pixels_per_metre
    n_y, n_x = locator.cell.shape
    if not (0.0 <= column < n_x and 0.0 <= row < n_y):
        return -1
    return locator.cell[int(row), int(column)]


@njit(cache=True, nogil=True)
def locate_all(locator: Locator, position: FloatArray) -> IntArray:
    """(n, 2) positions -> (n,) cells."""
    cell = np.empty(position.shape[0], np.int64)
    for i in range(position.shape[0]):
        cell[i] = locate(locator, position[i, 0], position[i, 1])
    return cell
