"""Some cells of a tessellation, numbered anew."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from tessellation._arrays import FloatArray, IntArray
from tessellation.protocols import OUTSIDE, Tessellation


@dataclass(frozen=True, slots=True, kw_only=True)
class PartOfCells:
    """Some cells of a tessellation; the others are outside.

    Attributes:
        whole: the tessellation.
        cells: (n_cells,) which of its cells these are, ascending.
        number: (all cells + 1,) the number of each here; `OUTSIDE` of the others and, last, of `OUTSIDE`.
    """

    whole: Tessellation
    cells: IntArray
    number: IntArray

    @classmethod
    def of(cls, whole: Tessellation, cells: IntArray) -> Self:
        """The cells (n,), ascending."""
        number = np.full(whole.n_cells + 1, OUTSIDE)
        number[cells] = np.arange(cells.size)
        return cls(whole=whole, cells=cells, number=number)

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return int(self.cells.size)

    @property
    def centers(self) -> FloatArray:
        """(n_cells, 2) metres."""
        return np.asarray(self.whole.centers[self.cells])

    @property
    def area(self) -> FloatArray:
        """(n_cells,) square metres."""
        return np.asarray(self.whole.area[self.cells])

    def cell_of(self, position: FloatArray) -> IntArray:
        """The cell of each position; `OUTSIDE` where it is none of these. (..., 2) -> (...).

        Raises:
            ValueError: the last axis is not 2, or a coordinate is not finite.
        """
        return np.asarray(self.number[self.whole.cell_of(position)])

    def polygons(self) -> list[FloatArray]:
        """One (k, 2) polygon for each cell, counter-clockwise, not closed."""
        every = self.whole.polygons()
        return [every[cell] for cell in self.cells.tolist()]
