"""The density of modes in cells, p(direction, speed | position): one table and one sum for all who ask."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from scipy.special import gammaln

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions import von_mises
from dirprim_filter.distributions._random import wrapped_cauchy
from dirprim_filter.primitives import _map_kernels
from dirprim_filter.primitives._modes import Modes

NOTHING = np.empty(0)
SHARPEST = 1e300
"""Of concentrations: some times as many are still numbers."""


class ModeTable(NamedTuple):
    """Modes of any number of cells, and what normalises them, as the kernels take them."""

    first: IntArray  # (n_cells + 1,) cell c has the modes from first[c] to first[c + 1]
    mode: FloatArray  # (n_modes, N_COLUMNS), see `_map_kernels`
    center: FloatArray  # (n_cells, 2) metres, where bends and gains are 0

    @classmethod
    def of(cls, modes: Modes, center: FloatArray) -> Self:
        """The table of (n_cells, K) modes, of which those of weight 0 are left out."""
        used = modes.weight > 0
        weight, mean, concentration, shape, rate, *slopes = (column[used] for column in modes)
        concentration = np.minimum(concentration, SHARPEST)
        mode = np.column_stack([
            np.log(weight), -von_mises.log_normaliser(concentration), mean, 2.0 * concentration,
            shape * np.log(rate) - gammaln(shape), shape, rate, *slopes, np.cumsum(modes.weight, axis=1)[used],
            *wrapped_cauchy(concentration),
        ])  # fmt: skip
        return cls(np.append(0, np.cumsum(np.count_nonzero(used, axis=1))), mode, np.ascontiguousarray(center))

    def log_density(
        self, cell: IntArray, position: FloatArray, direction: FloatArray | None, speed: FloatArray | None
    ) -> FloatArray:
        """Natural log of the density in cells that need not be the rows' own, per radian and m/s. -> (n,).

        -inf where a cell has no modes, and for a negative speed; of weights that add up to less than 1, so much less.

        Args:
            cell: (n,) -1 for the last.
            position: (n, 2) metres.
            direction: (n,) radians; None for the density of the speed alone.
            speed: (n,) m/s; None for that of the direction alone.
        """
        theta, v = (NOTHING if column is None else column for column in (direction, speed))
        out = np.empty(len(position))
        _map_kernels.log_densities(*self, cell, position, theta, v, out)
        return out
