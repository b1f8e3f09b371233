"""What every division of the plane into cells can do, and what a model must do to live in them."""

from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from tessellation._arrays import AnyArray, FloatArray, IntArray

OUTSIDE = -1
"""The cell of a position that no cell covers."""


class Tessellation(Protocol):
    """A division of a part of the plane into cells, numbered 0 to n_cells - 1.

    What compiled code needs to find the cell of a point follows from these: see `locate.locator_of`. Map files hold
    cells that have `parameters` too, a dict of numbers and of int64 or float64 arrays (n) or (n, k): the keyword
    arguments by which their class makes them again.
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


Given = TypeVar("Given", bound=Tessellation)


def checked(cells: Given, position: FloatArray) -> Given:
    """The cells, if they say of positions (n, 2) which cell covers them: of cells that users write.

    Raises:
        ValueError: centres or areas of another shape, or cells that do not exist.
    """
    n, name = cells.n_cells, type(cells).__name__
    found = np.asarray(cells.cell_of(position))
    for what, got, shape in (
        ("cell_of", found.shape, (len(position),)),
        ("centers", np.shape(cells.centers), (n, 2)),
        ("area", np.shape(cells.area), (n,)),
    ):
        if got != shape:
            raise ValueError(f"tessellation: expected {name}.{what} of shape {shape}, got {got}")
    if found.dtype.kind not in "iu" or (found.size and not (found.min() >= OUTSIDE and found.max() < n)):
        span = f"{found.min()} to {found.max()}" if found.size else "none"
        raise ValueError(
            f"tessellation: expected {name}.cell_of int64 from {OUTSIDE} to {n - 1}, got {found.dtype}, {span}"
        )
    return cells


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
