"""Square cells: those squares of a regular grid that hold data."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tessellation._arrays import FARTHEST_M, SHORTEST_M, FloatArray, IntArray, as_floats, as_places
from tessellation._kernels import SIDE, Locator
from tessellation.locate import Pixels, cells_of, in_blocks

MAX_BLOCKS = 1 << 25
"""A raster takes 4 bytes for each, 134 MB, beside what is covered: 280 km each way at 3 m."""
MAX_SQUARES = MAX_BLOCKS * SIDE**2


@dataclass(frozen=True, slots=True, kw_only=True)
class GridTessellation:
    """Some squares of a regular grid. Square (row, column) covers [origin + size * (column, row), + size).

    Attributes:
        origin: (2,) the south-west corner of square (0, 0), metres.
        cell_size: the side of a square, metres.
        n_x: number of columns.
        n_y: number of rows.
        square: (n_cells,) which squares are cells, ascending: row * n_x + column. The others are `OUTSIDE`.

    Raises:
        ValueError: a size that is not positive, squares out of range or not ascending.
    """

    origin: FloatArray
    cell_size: float
    n_x: int
    n_y: int
    square: IntArray
    locator: Locator = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        origin = as_places("origin", self.origin, "2")
        square = np.ascontiguousarray(self.square, dtype=np.int64)
        if not SHORTEST_M <= self.cell_size <= FARTHEST_M:
            raise ValueError(
                f"cell_size: expected a positive length in metres, {SHORTEST_M:g} to {FARTHEST_M:g}, got "
                f"{self.cell_size}"
            )
        if self.n_x < 1 or self.n_y < 1:
            raise ValueError(f"n_x, n_y: expected at least one column and one row, got {self.n_x} x {self.n_y}")
        _check_extent(self.cell_size, np.array([self.n_x, self.n_y], np.float64))
        n_squares = self.n_x * self.n_y
        if square.ndim != 1 or (square[1:] <= square[:-1]).any():  # a difference of such numbers may wrap
            raise ValueError("square: expected shape (n_cells,) with ascending numbers")
        if square.size and not (square[0] >= 0 and square[-1] < n_squares):
            raise ValueError(f"square: expected numbers from 0 to {n_squares - 1}, got {square[0]} to {square[-1]}")
        object.__setattr__(self, "origin", origin)
        object.__setattr__(self, "square", square)
        pixels = Pixels(*np.divmod(square, self.n_x), np.arange(square.size))
        located = in_blocks(origin, 1.0 / self.cell_size, (self.n_y, self.n_x), pixels)
        object.__setattr__(self, "locator", located)

    @classmethod
    def covering(cls, position: FloatArray, *, cell_size: float) -> GridTessellation:
        """The squares that hold at least one of the positions.

        Args:
            position: (n, 2) metres, n >= 1.
            cell_size: side of a square, metres.

        Raises:
            ValueError: no position, or an extent too large for `cell_size`.
        """
        position = as_floats("position", position, "n 2")
        if position.shape[0] == 0:
            raise ValueError("position: expected at least one position, got none")
        if not 0 < cell_size < np.inf:
            raise ValueError(f"cell_size: expected a positive length in metres, got {cell_size}")
        south_west = position.min(axis=0)
        origin = np.floor(south_west / cell_size) * cell_size
        origin = np.where(origin > south_west, origin - cell_size, origin)  # the product may round above
        raster = (position - origin) * (1.0 / cell_size)  # as `locate` computes it, to the last bit
        extent = np.floor(raster.max(axis=0)) + 1
        _check_extent(cell_size, extent)
        n_x, n_y = int(extent[0]), int(extent[1])
        column, row = raster.astype(np.int64).T
        return cls(origin=origin, cell_size=cell_size, n_x=n_x, n_y=n_y, square=np.unique(row * n_x + column))

    @classmethod
    def empty(cls) -> GridTessellation:
        """No cell at all: every position is `OUTSIDE`."""
        return cls(origin=np.zeros(2), cell_size=1.0, n_x=1, n_y=1, square=np.empty(0, np.int64))

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return int(self.square.size)

    @property
    def centers(self) -> FloatArray:
        """(n_cells, 2) the cells' centres, metres."""
        return self._corner() + self.cell_size / 2

    @property
    def area(self) -> FloatArray:
        """(n_cells,) the cells' areas, square metres."""
        return np.full(self.n_cells, self.cell_size**2)

    def cell_of(self, position: FloatArray) -> IntArray:
        """The cell of each position; `OUTSIDE` where no cell covers it. (..., 2) -> (...).

        Raises:
            ValueError: the last axis is not 2, or a coordinate is not finite.
        """
        position = as_floats("position", position, "... 2")
        return cells_of(self.locator, position.reshape(-1, 2)).reshape(position.shape[:-1])

    def polygons(self) -> list[FloatArray]:
        """One (4, 2) square for each cell, counter-clockwise from its south-west corner."""
        side = self.cell_size * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        return list(self._corner()[:, None, :] + side)

    def _corner(self) -> FloatArray:
        row, column = np.divmod(self.square, self.n_x)
        corner: FloatArray = self.origin + self.cell_size * np.column_stack([column, row])
        return corner


def _check_extent(cell_size: float, extent: FloatArray) -> None:
    if np.ceil(extent / SIDE).prod() > MAX_BLOCKS:
        raise ValueError(
            f"cell_size: {cell_size} m makes {extent[0]:.0f} x {extent[1]:.0f} squares, more than {MAX_SQUARES} in "
            f"blocks of {SIDE} x {SIDE}; choose larger cells or remove far outliers"
        )
