"""Compiled: concentrations and shapes of moments, and what normalises them, by interpolation in tables of scipy's.

Every mode of every iteration asks for them: an iteration each time took a third of the fit.
"""

import math
from typing import Any

import numpy as np
from scipy import special

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions import von_mises
from tessellation._compiling import compiled

NEGLIGIBLE_CONCENTRATION = 1e-8  # below it the circle is uniform to double precision
_NODES = 512
_MAX_SPREAD = 0.6  # where the gamma's shape is below one
_MAX_LOG = math.log(1e7)  # of a concentration or a shape


def _concentration_table() -> FloatArray:
    """What k (1 - R^2) / R is at even R in [0, 1]: from 2 to 1, smooth, so that four nodes give k to nine digits."""
    r = np.linspace(0.0, 1.0, _NODES)[1:-1]
    return np.concatenate([[2.0], von_mises.concentration_of(r) * (1.0 - r * r) / r, [1.0]])


def _shape_table() -> FloatArray:
    """Shape times spread at even spreads in [0, _MAX_SPREAD], likewise; log(shape) - digamma(shape) = spread."""
    spread = np.linspace(0.0, _MAX_SPREAD, _NODES)[1:]
    shape = (3 - spread + np.sqrt((spread - 3) ** 2 + 24 * spread)) / (12 * spread)
    for _ in range(6):  # Minka (2002)
        error = np.log(shape) - special.digamma(shape) - spread
        shape = 1 / (1 / shape + error / (shape * (1 - shape * special.polygamma(1, shape))))
    return np.concatenate([[0.5], shape * spread])


def _gamma_table() -> FloatArray:
    """What Stirling's a (log a - 1) leaves of log Gamma(a), at even log a from 0 on."""
    log_shape = np.linspace(0.0, _MAX_LOG, 2 * _NODES)
    few = np.exp(log_shape[log_shape < math.log(1e3)])
    exact = special.gammaln(few) - few * (np.log(few) - 1.0)
    many = log_shape[few.size :]  # there the difference of two large numbers has few digits
    series = 0.5 * (math.log(2.0 * math.pi) - many) + np.exp(-many) / 12.0 - np.exp(-3.0 * many) / 360.0
    return np.concatenate([exact, series])


_CONCENTRATION, _SHAPE = _concentration_table(), _shape_table()
_K = np.expm1(np.linspace(0.0, _MAX_LOG, 2 * _NODES))
_NORMALISER, _RESULTANT, _GAMMA = von_mises.log_normaliser(_K), von_mises.mean_resultant_length(_K), _gamma_table()


@compiled
def _between(table: FloatArray, x: float) -> float:
    """The cubic through the four nodes around x in [0, 1]."""
    x *= table.size - 1
    first: Any = np.int64(x)
    i = min(max(first, 1), table.size - 3)
    t = x - i
    before, here, next_, beyond = table[i - 1], table[i], table[i + 1], table[i + 2]
    return (
        here * (1.0 - t * t) * (2.0 - t) / 2.0
        + next_ * t * (1.0 + t) * (2.0 - t) / 2.0
        - before * t * (1.0 - t) * (2.0 - t) / 6.0
        - beyond * t * (1.0 - t * t) / 6.0
    )


@compiled
def concentration_from(resultant: float) -> float:
    """`von_mises.concentration_of`."""
    r = min(max(resultant, 0.0), 1.0 - 1e-15)
    return r / (1.0 - r * r) * _between(_CONCENTRATION, r)


@compiled
def resultant_of(log_concentration: float) -> float:
    """`von_mises.mean_resultant_length` by log(1 + k)."""
    return _between(_RESULTANT, log_concentration / _MAX_LOG)


@compiled
def shape_from(spread: float, high: float) -> float:
    """Maximum likelihood shape of a gamma from `spread` = log(mean) - mean(log), bounded to [1, high]."""
    if not spread > 0.5 / high:  # log(a) - psi(a) > 1 / (2 a): no shape below `high` has so little spread
        return high
    if spread >= _MAX_SPREAD:
        return 1.0
    return min(max(_between(_SHAPE, spread / _MAX_SPREAD) / spread, 1.0), high)


@compiled
def log_normaliser(log_concentration: float) -> float:
    """log(2 pi I0(k)) - k by log(1 + k), to 1e-8."""
    return _between(_NORMALISER, log_concentration / _MAX_LOG)


@compiled
def gamma_remainder(log_shape: float) -> float:
    """Log Gamma(a) - a (log a - 1) by log a from 0 on, to 1e-10."""
    return _between(_GAMMA, log_shape / _MAX_LOG)
