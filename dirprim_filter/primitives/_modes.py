"""What the compiled fit works on: columns of rows, tables of modes, and the bounds of a fit.

Kernels take each as one array, `columns[SPEED]` and `table[m, MEAN]`: tuples of arrays compile several times as long.
What is said once for a fit stands in its bounds: as a literal argument it would be compiled anew for each value.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray

COSINE, SINE, SPEED, LOG_SPEED, WEIGHT, EAST, NORTH = range(7)
"""Columns of rows of moving vehicles, or of what stands for several: their means. Metres from the cell's centre."""
N_COLUMNS = 7
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
    """Parameters of modes, (n_cells, K) or (K,) each."""

    weight: FloatArray
    mean: FloatArray
    concentration: FloatArray
    shape: FloatArray
    rate: FloatArray
    bend_east: FloatArray  # rad/m, how the mean direction turns across the cell
    bend_north: FloatArray
    gain_east: FloatArray  # 1/m, how the logarithm of the mean speed grows across the cell
    gain_north: FloatArray

    @classmethod
    def of(cls, table: FloatArray) -> Modes:
        """What a kernel has found, (..., K, N_CURVED)."""
        log_weight, mean, log_concentration, log_shape, log_mean_speed, *slopes = np.moveaxis(table, -1, 0)
        weight, shape = np.where(log_weight > NO_MODE / 2, np.exp(log_weight), 0.0), np.exp(log_shape)
        return cls(weight, mean, np.expm1(log_concentration), shape, shape / np.exp(log_mean_speed), *slopes)


def empty_table(*shape: int) -> FloatArray:
    """Room for modes, none of them there yet. -> (*shape, N_CURVED)."""
    table = np.zeros((*shape, N_CURVED))
    table[..., LOG_WEIGHT] = NO_MODE
    return table
