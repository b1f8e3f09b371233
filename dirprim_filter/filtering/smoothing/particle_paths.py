"""The `Paths` of particles: those of one belief at two times are the same ones, moved on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.filtering.smoothing import _kernels
from dirprim_filter.filtering.smoothing._kernels import LEAST_EFFECTIVE, N_COLUMNS, N_STATES, log_gaussian

if TYPE_CHECKING:
    from dirprim_filter.filtering.particle_filter import ParticleFilter

BANDWIDTH = 0.1
"""Share of the particles' covariance, times n^(-1/4), by which their density is smoothed: it may have several modes."""


class ParticlePaths:
    """`Paths` of a particle filter.

    Args:
        of: whose particles are looked at.
    """

    def __init__(self, of: ParticleFilter) -> None:
        self._of = of

    def states(self, slot: IntArray) -> FloatArray:
        """(v, 7, P): x, y, their rates, acceleration, cosine and sine of the direction."""
        cloud = self._of.belief.cloud
        out = np.empty((slot.size, N_COLUMNS, cloud.speed.shape[1]))
        self._of.split(_kernels.columns_of, (cloud, self._of.manoeuvres), (slot, out), (), each_ns=12.0)
        return out

    def weights(self, slot: IntArray) -> FloatArray:
        """(v, P) of the particles."""
        return self._of.belief.cloud.weight[slot]

    def joint(
        self, weight: FloatArray, then: FloatArray, now: FloatArray, *, row: IntArray, vehicle: IntArray,
        dt_s: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:  # fmt: skip
        """As `Paths.joint`; the time between does not matter."""
        mean, covariance = np.empty((row.size, 2 * N_COLUMNS)), np.empty((row.size, 2 * N_STATES, 2 * N_STATES))
        self._of.split(_kernels.joint_moments, (weight, then, now), (row, vehicle, mean, covariance), (), each_ns=40.0)
        return mean, covariance

    def arrivals(self, now: FloatArray, mean: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As `Paths.arrivals`, by a kernel density of the particles."""
        d, n = mean.shape[1], now.shape[2]
        before, weight, density = np.full(n, 1.0 / n), np.empty((len(now), n)), np.empty(len(now))
        for i, state in enumerate(now[:, :d]):
            fit = log_gaussian(state.T - mean[i], covariance[i] + BANDWIDTH * n**-0.25 * np.cov(state))
            near = np.exp(fit - fit.max())
            density[i] = fit.max() + np.log(near.mean())
            _kernels.tempered(before, near / near.sum(), LEAST_EFFECTIVE * n, weight[i])
        return density, weight
