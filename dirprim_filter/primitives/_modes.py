"""What the compiled fit works on: columns of rows, tables of modes, and the bounds of a fit.

Kernels take each as one array, `columns[SPEED]` and `table[m, MEAN]`: tuples of arrays compile several times as long.
What is said once for a fit stands in its bounds: as a literal argument it would be compiled anew for each value.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions.angles import wrap

COSINE, SINE, SPEED, LOG_SPEED, WEIGHT, EAST, NORTH = range(7)
"""Columns of rows of moving vehicles, or of what stands for several: their means. Metres from the cell's centre."""
N_OF_ROW = 7
LOG_WEIGHT, MEAN, LOG_CONCENTRATION, LOG_SHAPE, LOG_MEAN_SPEED, BEND_EAST, BEND_NORTH, GAIN_EAST, GAIN_NORTH = range(9)
"""Columns of a table of modes, such that steps can be added: of a concentration k, log(1 + k)."""
N_FLAT, N_CURVED = 5, 9
NO_MODE = -1e3
"""The logarithm of a weight of nothing."""


class Bounds(NamedTuple):
    """Priors and bounds of a fit; the first are of `config.LearningConfig`."""

    max_modes: int
    prior_strength: float
    max_concentration: float
    max_shape: float
    dbscan_eps: float
    dbscan_share: float
    bend_scale: float  # rad/m, standard deviation of a bend before it is seen
    gain_scale: float  # 1/m, likewise of a gain
    standing_speed: float  # m/s; slower rows are no members
    parameter_cost: float = 1.0  # of a parameter, in those of BIC
    usual_resultant: float = 0.0  # mean resultant length of a usual mode's directions; 0: uniform
    speed_spread: float = 1.0  # log(mean) - mean(log) of a usual mode's speeds
    curved: bool = False  # whether modes may bend
    tolerance: float = 1e-7  # of the objective per vehicle: a step that gains less is the last
    thorough: bool = True  # whether more modes are tried than the first number that is one too many
    with_speed: bool = True  # whether speeds have a say in whose a row is
    max_iterations: int = 200  # of one climb


class Modes(NamedTuple):
    """Modes of cells, (n_cells, K) each: von Mises over direction (Eq. 1), and for each a gamma of speed (Eq. 3)."""

    weight: FloatArray  # 0 pads
    mean_direction: FloatArray  # radians, at the centre of the cell
    concentration: FloatArray
    shape: FloatArray
    rate: FloatArray  # s/m
    bend: FloatArray  # (n_cells, K, 2) rad/m, how the mean direction turns to the east and to the north of the centre
    gain: FloatArray  # (n_cells, K, 2) 1/m, how the logarithm of the mean speed grows

    @classmethod
    def flat(cls, *columns: FloatArray) -> Modes:
        """Modes of five columns that neither bend nor gain."""
        return cls(*columns, *np.zeros((2, *columns[0].shape, 2)))

    @classmethod
    def of(cls, table: FloatArray) -> Modes:
        """What a kernel has found, (..., K, N_CURVED)."""
        log_weight, mean, log_concentration, log_shape, log_mean_speed = np.moveaxis(table[..., :N_FLAT], -1, 0)
        weight, shape = np.where(log_weight > NO_MODE / 2, np.exp(log_weight), 0.0), np.exp(log_shape)
        slopes = table[..., BEND_EAST:GAIN_EAST], table[..., GAIN_EAST:]
        return cls(weight, mean, np.expm1(log_concentration), shape, shape / np.exp(log_mean_speed), *slopes)

    @classmethod
    def beside(cls, parts: Sequence[Modes]) -> Modes:
        """All modes of the same cells."""
        return cls(*(np.concatenate(columns, axis=1) for columns in zip(*parts, strict=True)))

    def take(self, index: Any) -> Modes:
        """Those at an index of the leading axes."""
        return Modes(*(column[index] for column in self))

    def times(self, share: FloatArray | float) -> Modes:
        """The same of so many times the weight."""
        return self._replace(weight=share * self.weight)

    def at(self, offset: FloatArray) -> Modes:
        """The same where they are seen from offsets (n_cells, 2) from the centres, metres."""
        turned, gained = ((slope * offset[..., None, :]).sum(axis=-1) for slope in (self.bend, self.gain))
        mean_direction = wrap(self.mean_direction + turned)
        return self._replace(mean_direction=mean_direction, rate=self.rate * np.exp(-gained))


def empty_table(*shape: int) -> FloatArray:
    """Room for modes, none of them there yet. -> (*shape, N_CURVED)."""
    table = np.zeros((*shape, N_CURVED))
    table[..., LOG_WEIGHT] = NO_MODE
    return table
