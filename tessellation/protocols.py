"""What every division of the plane into cells can do, and what a model must do to live in them."""

from typing import NamedTuple, Protocol, TypeVar

from tessellation._arrays import AnyArray, FloatArray, IntArray

OUTSIDE = -1
"""The cell of a position that no cell covers."""


class Tessellation(Protocol):
    """A division of a part of the plane into cells, numbered 0 to n_cells - 1.

    What compiled code needs to find the cell of a point follows from these: see `locate.locator_of`.
    """

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

    def cell_of(self, position: FloatArray) -> IntArray:
        """The cell of each position; `OUTSIDE` where no cell covers it. (..., 2) -> (...)."""
        ...

    def polygons(self) -> list[FloatArray]:
        """One (k, 2) polygon for each cell, counter-clockwise, not closed."""
        ...


class Members(NamedTuple):
    """Which data each of several cells has, and how much of each.

    Cell c has the data row[start[c]:start[c + 1]], ascending, each with a weight in (0, 1] times the datum's own: 1 for
    those that lie in the cell, less for those beside it.
    """

    start: IntArray  # (n_cells + 1,)
    row: IntArray  # (p,)
    weight: FloatArray  # (p,)
    center: FloatArray  # (n_cells, 2) metres


Data_contra = TypeVar("Data_contra", contravariant=True)
Cells = TypeVar("Cells", bound=tuple[AnyArray, ...])


class CellModel(Protocol[Data_contra, Cells]):
    """A model of what happens in a cell, which knows nothing of where cells end.

    `Cells`, the parameters of any number of cells, is a NamedTuple of arrays whose first axis counts the cells. A cell
    without members must have parameters too: those that hold where nothing is known.
    """

    def fit(self, position: FloatArray, data: Data_contra, members: Members) -> Cells:
        """The parameters of each cell, from its members alone; the same, whichever other cells are asked for."""
        ...

    def log_density(
        self, cells: Cells, position: FloatArray, data: Data_contra, row: IntArray, cell: IntArray
    ) -> FloatArray:
        """Natural log of the density that cell[i] gives to datum row[i]. (p,), (p,) -> (p,)."""
        ...
