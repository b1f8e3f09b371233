"""What every division of the plane into cells can do."""

from typing import Protocol

from tessellation._kernels import Locator
from tessellation.arrays import FloatArray, IntArray

OUTSIDE = -1
"""The cell of a position that no cell covers."""


class Tessellation(Protocol):
    """A division of a part of the plane into cells, numbered 0 to n_cells - 1."""

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        ...

    @property
    def centers(self) -> FloatArray:
        """(n_cells, 2) the cells' centres, metres."""
        ...

    @property
    def area(self) -> FloatArray:
        """(n_cells,) the cells' areas, square metres."""
        ...

    @property
    def locator(self) -> Locator:
        """The compiled index that kernels ask for the cell of a point."""
        ...

    def cell_of(self, position: FloatArray) -> IntArray:
        """The cell of each position; `OUTSIDE` where no cell covers it. (..., 2) -> (...)."""
        ...

    def neighbors(self, cell: int) -> IntArray:
        """The cells that share a border with `cell`, ascending."""
        ...

    def polygons(self) -> list[FloatArray]:
        """One (k, 2) polygon for each cell, counter-clockwise, not closed."""
        ...
