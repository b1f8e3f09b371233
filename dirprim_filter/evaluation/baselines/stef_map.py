"""STeF-map without its periods: in each square of a grid a histogram of eight directions.

Source: Molina, Cielniak, Krajnik and Duckett, Modelling and predicting rhythmic flow patterns in dynamic environments,
2018. There the weight of each direction is a sum of periodic functions of time; here it is its mean. A pseudo-count,
shared evenly by the directions, makes the density finite everywhere; the paper has none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray, as_floats
from dirprim_filter.distributions.angles import TWO_PI
from tessellation import GridTessellation

N_DIRECTIONS = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class StefMap:
    """A histogram of directions for each square; off the grid all are as likely.

    Attributes:
        cells: the squares that hold data.
        log_histogram: (n_cells + 1, 8) natural log of the density in each bin, per radian; the last is uniform, so
            that index `OUTSIDE` gathers it. Bins are centred on east, north-east and so on.
    """

    cells: GridTessellation
    log_histogram: FloatArray

    @classmethod
    def fit(cls, position: FloatArray, direction: FloatArray, *, cell_size: float, pseudo_count: float) -> Self:
        """Count the rows of each square.

        Args:
            position: (n, 2) metres, n >= 1.
            direction: (n,) radians.
            cell_size: metres, the side of a square.
            pseudo_count: rows, positive, that each square has besides, of all directions alike.

        Raises:
            ValueError: shapes that do not fit, or no row.
        """
        cells = GridTessellation.covering(position, cell_size=cell_size)
        of_row = cells.cell_of(position) * N_DIRECTIONS + _bin(as_floats("direction", direction, "n"))
        count = np.bincount(of_row, minlength=(cells.n_cells + 1) * N_DIRECTIONS).reshape(-1, N_DIRECTIONS)
        share = (count + pseudo_count / N_DIRECTIONS) / (count.sum(axis=1, keepdims=True) + pseudo_count)
        return cls(cells=cells, log_histogram=np.log(share * N_DIRECTIONS / TWO_PI))

    def direction_log_density(self, position: FloatArray, direction: FloatArray) -> FloatArray:
        """Natural log of p(direction | position), per radian. (..., 2), (...) -> (...)."""
        return self.log_histogram[self.cells.cell_of(position), _bin(np.asarray(direction))]


def _bin(direction: FloatArray) -> IntArray:
    return np.rint(direction * N_DIRECTIONS / TWO_PI).astype(np.int64) % N_DIRECTIONS
