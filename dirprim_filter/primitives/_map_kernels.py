"""The density of modes in cells, p(direction, speed | position), and samples: one table and one sum for all who ask.

Modes stand cell by cell, those of weight 0 left out, all numbers of a mode side by side: a row reads one stretch of
memory.
"""

import math
from typing import NamedTuple, Self

import numpy as np
from scipy.special import gammaln

from dirprim_filter.arrays import FloatArray, IntArray, read_only
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions import von_mises
from dirprim_filter.distributions._elementary import exp, squared_sine, wrap
from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.primitives._modes import Modes
from tessellation._compiling import compiled
from tessellation._kernels import Locator, locate

# Columns of `ModeTable.mode`.
LOG_WEIGHT, LOG_DIRECTION, MEAN, TWICE_CONCENTRATION, LOG_SPEED, SHAPE, RATE = 0, 1, 2, 3, 4, 5, 6
BEND_EAST, BEND_NORTH, GAIN_EAST, GAIN_NORTH, CUMULATIVE, ENVELOPE_Q, ENVELOPE_B = 7, 8, 9, 10, 11, 12, 13
N_OF_MODE = 14
NOTHING = np.empty(0)
SHARPEST = 1e300
"""Of concentrations: some times as many are still numbers."""


class ModeTable(NamedTuple):
    """Modes of any number of cells, and what normalises them, as the kernels take them."""

    first: IntArray  # (n_cells + 1,) cell c has the modes from first[c] to first[c + 1]
    mode: FloatArray  # (n_modes, N_OF_MODE), see above
    center: FloatArray  # (n_cells, 2) metres, where bends and gains are 0

    @classmethod
    def of(cls, modes: Modes, center: FloatArray) -> Self:
        """The table of modes, of which those of weight 0 are left out."""
        used = modes.weight > 0
        weight, mean, concentration, shape, rate, *slopes = (column[used] for column in modes)
        concentration = np.minimum(concentration, SHARPEST)
        mode = np.column_stack([
            np.log(weight), -von_mises.log_normaliser(concentration), mean, 2.0 * concentration,
            shape * np.log(rate) - gammaln(shape), shape, rate, *slopes, np.cumsum(modes.weight, axis=1)[used],
            *random.wrapped_cauchy(concentration),
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
        given = (read_only(NOTHING if column is None else column) for column in (position, direction, speed))
        out = np.empty(len(position))
        log_densities(*self, cell, *given, out)
        return out


class MapTable(NamedTuple):
    """A map's modes, see `ModeTable`, and where its cells are; the last row is the background model's."""

    locator: Locator
    first: IntArray
    mode: FloatArray
    center: FloatArray


@compiled
def log_densities(
    first: IntArray, mode: FloatArray, center: FloatArray, cell: IntArray, position: FloatArray,
    direction: FloatArray, speed: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Fill `out` (n,) with log p(direction, speed | cell), or that of one alone; see `ModeTable.log_density`.

    Of direction or speed what is empty is not asked for. cell: (n,) -1 for the last.
    """
    log_p, of_direction, of_speed = np.empty(mode.shape[0]), direction.size > 0, speed.size > 0
    for i in range(out.size):
        c = cell[i] if cell[i] >= 0 else first.size - 2
        east, north = position[i, 0] - center[c, 0], position[i, 1] - center[c, 1]
        log_v, top, n = 0.0, -np.inf, 0
        if of_speed:
            log_v = math.log(speed[i]) if speed[i] > 0.0 else -np.inf
        for j in range(first[c], first[c + 1]):
            value = mode[j, LOG_WEIGHT]
            if of_direction:
                turned = mode[j, BEND_EAST] * east + mode[j, BEND_NORTH] * north
                half = squared_sine(0.5 * (direction[i] - mode[j, MEAN] - turned))
                value += mode[j, LOG_DIRECTION] - mode[j, TWICE_CONCENTRATION] * half
            if of_speed:
                grown, more = mode[j, GAIN_EAST] * east + mode[j, GAIN_NORTH] * north, mode[j, SHAPE] - 1.0
                value += mode[j, LOG_SPEED] - mode[j, SHAPE] * grown - mode[j, RATE] * speed[i] * math.exp(-grown)
                if more != 0.0:  # at speed 0 the density of shape 1 is the rate
                    value += more * log_v
            log_p[n] = value
            top = max(top, value)
            n += 1
        total = 0.0
        for j in range(n if abs(top) < np.inf else 0):
            total += exp(log_p[j] - top)
        out[i] = top + math.log(total) if total > 0.0 else top
        if of_speed and speed[i] < 0.0:
            out[i] = -np.inf


@compiled
def draw(table: MapTable, position: FloatArray, state: UIntArray, direction: FloatArray, speed: FloatArray) -> None:
    """Fill `direction` and `speed` (n,) with a draw at each position (n, 2). state: (4,) of the random numbers."""
    for i in range(direction.size):
        x, y = position[i, 0], position[i, 1]
        cell = locate(table.locator, x, y)
        cell = cell if cell >= 0 else table.first.size - 2
        u, j, last = random.uniform(state), table.first[cell], table.first[cell + 1] - 1
        while j < last and table.mode[j, CUMULATIVE] <= u:
            j += 1
        turned = table.mode[j, MEAN] + random.draw_turn(
            0.5 * table.mode[j, TWICE_CONCENTRATION], table.mode[j, ENVELOPE_Q], table.mode[j, ENVELOPE_B], state
        )
        rate = table.mode[j, RATE]
        east, north = x - table.center[cell, 0], y - table.center[cell, 1]
        turned += table.mode[j, BEND_EAST] * east + table.mode[j, BEND_NORTH] * north
        rate *= math.exp(-(table.mode[j, GAIN_EAST] * east + table.mode[j, GAIN_NORTH] * north))
        direction[i] = wrap(turned)
        speed[i] = random.draw_gamma(table.mode[j, SHAPE], state) / max(rate, 1e-300)  # of a slope without bounds
