"""Some cells of a tessellation with a raster of their own: what compiled code asks for the cell of a point."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Self

import numpy as np

from tessellation._arrays import BoolArray, FloatArray, IntArray
from tessellation._kernels import HEADER, LONGEST_LIST, Locator, PixelArray
from tessellation._pickling import from_fields
from tessellation.locate import locator_of
from tessellation.part import PartOfCells
from tessellation.protocols import OUTSIDE, Tessellation


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LocatedPart(PartOfCells):
    """Some cells, with the borders that they have among all.

    Attributes:
        known_area: (n_cells,) square metres; more than in the whole, where that is itself a part of more.
        locator: answers as that of all cells, to the last bit.
    """

    known_area: FloatArray
    locator: Locator = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "locator", renumbered(locator_of(self.whole), self.number))

    def __reduce__(self) -> tuple[partial[Self], tuple[()]]:
        """Without its rasters: see `_pickling`."""
        return from_fields(self)

    @classmethod
    def of(cls, whole: Tessellation, cells: IntArray, area: FloatArray | None = None) -> Self:
        """The cells (n,), ascending; of other areas (n,) than in the whole where they are given."""
        number = np.full(whole.n_cells + 1, OUTSIDE)
        number[cells] = np.arange(cells.size)
        known = whole.area[cells] if area is None else area
        return cls(whole=whole, cells=cells, number=number, known_area=known)

    @property
    def area(self) -> FloatArray:
        """(n_cells,) square metres."""
        return self.known_area


def renumbered(locator: Locator, number: IntArray) -> Locator:
    """The locator of cells by other numbers: (n_cells,), `OUTSIDE` for those that are left out.

    A pixel in which none of its cells is left has none.
    """
    entry = locator.entry.copy()
    pixel = _renumber(locator.pixel, locator.entry, number, entry)
    return locator._replace(pixel=pixel.astype(np.int32), entry=entry)


def _renumber(pixel: IntArray | PixelArray, entry: FloatArray, number: IntArray, out: FloatArray) -> IntArray:
    """The values of pixels by other numbers, see `Locator`; what they name is written to `out`."""
    value = np.asarray(pixel, np.int64).copy()
    is_cell, names = value >= 0, value < OUTSIDE
    value[is_cell] = number[value[is_cell]]
    code, of = np.unique(value[names], return_inverse=True)
    at, n = (-2 - code) >> 3, ((-2 - code) & 7) + 1
    is_left = np.zeros(code.size, np.bool_)
    for k in range(2, LONGEST_LIST + 1):
        which = np.flatnonzero(n == k)
        is_left[which] = _renumber_lists(at[which], k, entry, number, out)
    for i in np.flatnonzero(n == 1).tolist():
        begin, side = int(at[i]), int(entry[at[i] + 3])
        if side == 0:
            is_left[i] = _renumber_lists(at[[i]] + 4, int(entry[begin]), entry, number, out)[0]
        else:
            inner = slice(begin + HEADER, begin + HEADER + side * side)
            out[inner] = _renumber(entry[inner].astype(np.int64), entry, number, out)
            is_left[i] = (out[inner] != OUTSIDE).any()
    value[names] = np.where(is_left, code, OUTSIDE)[of]
    return value


def _renumber_lists(at: IntArray, n: int, entry: FloatArray, number: IntArray, out: FloatArray) -> BoolArray:
    """Lists of n generators each, at `at` (k,); -> (k,) whether one of their cells is left."""
    cell = at[:, None] + 3 * np.arange(n) + 2
    out[cell] = number[entry[cell].astype(np.int64)]
    return np.asarray((out[cell] != OUTSIDE).any(axis=1))
