"""Directional regression by Gaussian processes: one for the cosine and one for the sine of the direction.

Source: Wang and Gelfand, Modeling space and space-time directional data using projected Gaussian processes, 2014;
the informative-vector rule is that of Lawrence, Seeger and Herbrich, Fast sparse Gaussian process methods: the
informative vector machine, 2003: take the row whose prediction is least certain. Both processes share one kernel
(squared exponential plus noise), whose parameters maximise the likelihood of the rows that were taken.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import erfcx, log_ndtr
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from dirprim_filter.arrays import FloatArray, IntArray, as_floats
from dirprim_filter.distributions.angles import TWO_PI

SubsetRule = Literal["random", "informative"]

POOL_ROWS = 5000
"""The informative-vector rule chooses among so many rows, drawn at random."""
KERNEL_ROWS = 300
LONGEST_M = 100.0
"""Bound of the kernel's length: further than the junctions of the paper are wide."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DirectionalGaussianProcess:
    """Gaussian processes on (cos, sin) of the direction, made into a density on the circle.

    The density is that of the angle of a round normal vector with the predicted mean and variance: a projected normal.

    Attributes:
        process: predicts mean and variance of (cos, sin) at a position.
    """

    process: GaussianProcessRegressor

    @classmethod
    def fit(
        cls,
        position: FloatArray,
        direction: FloatArray,
        *,
        n_rows: int,
        subset: SubsetRule,
        rng: np.random.Generator,
    ) -> DirectionalGaussianProcess:
        """Fit to a subset of the rows, as the cost grows with the cube of its size.

        Args:
            position: (n, 2) metres, n >= 1.
            direction: (n,) radians.
            n_rows: the most rows to take.
            subset: how they are chosen. The kernel's parameters are learned from `KERNEL_ROWS` random rows in either
                case: the informative ones lie too far apart to estimate the noise.
            rng: chooses.

        Raises:
            ValueError: shapes that do not fit.
        """
        position, direction = as_floats("position", position, "n 2"), as_floats("direction", direction, "n")
        unit = np.column_stack([np.cos(direction), np.sin(direction)])
        order = rng.permutation(direction.size)
        some, chosen = order[:KERNEL_ROWS], order[:n_rows]
        kernel = ConstantKernel(0.5, (1e-3, 10.0)) * RBF(10.0, (0.5, LONGEST_M)) + WhiteKernel(0.1, (1e-5, 2.0))
        process = GaussianProcessRegressor(kernel=kernel)
        with warnings.catch_warnings():
            # A parameter at its bound is a result: a field of directions can be rougher or smoother than we look for.
            warnings.simplefilter("ignore", ConvergenceWarning)
            kernel = process.fit(position[some], unit[some]).kernel_
        if subset == "informative":
            pool = order[:POOL_ROWS]
            chosen = pool[least_certain_rows(position[pool], kernel, n_rows)]
        process = GaussianProcessRegressor(kernel=kernel, optimizer=None)
        return cls(process=process.fit(position[chosen], unit[chosen]))

    def direction_log_density(self, position: FloatArray, direction: FloatArray) -> FloatArray:
        """Natural log of p(direction | position), per radian. (n, 2), (n,) -> (n,)."""
        mean, std = self.process.predict(as_floats("position", position, "n 2"), return_std=True)
        turn = np.asarray(direction) - np.arctan2(mean[:, 1], mean[:, 0])
        return projected_normal_log_density(turn, np.hypot(mean[:, 0], mean[:, 1]) / std[:, 0])


def least_certain_rows(position: FloatArray, kernel: ConstantKernel, n_rows: int) -> IntArray:
    """Rows in the order in which the greatest predictive variance takes them: a pivoted Cholesky factorisation.

    Args:
        position: (n, 2) metres.
        kernel: signal plus noise.
        n_rows: how many to take, all of them if there are fewer.
    """
    signal, noise = kernel.k1, kernel.k2.noise_level
    variance = signal.diag(position).copy()
    n = min(n_rows, len(position))
    factor = np.zeros((n, len(position)))
    taken = np.empty(n, np.int64)
    for i in range(n):
        row = int(np.argmax(variance))
        taken[i] = row
        column = signal(position[row : row + 1], position)[0] - factor[:i, row] @ factor[:i]
        # The row itself is seen through noise, so its variance falls to a part of it and not to nothing.
        factor[i] = column / np.sqrt(variance[row] + noise)
        variance = np.maximum(variance - factor[i] ** 2, 0.0)
        variance[taken[: i + 1]] = -1.0
    return taken


def projected_normal_log_density(turn: FloatArray, signal: FloatArray) -> FloatArray:
    """Natural log of the density of the angle of a round normal vector in the plane, per radian. Broadcasts.

    Args:
        turn: radians from the direction of the vector's mean.
        signal: the length of the mean over the standard deviation of an axis, at least 0.

    With u = signal cos(turn): e^{-signal^2 / 2} (1 + sqrt(2 pi) u Phi(u) e^{u^2 / 2}) / (2 pi) (Mardia and Jupp
    2000, section 3.5.6), each side of 0 in the form that neither overflows nor cancels.
    """
    u, v = signal * np.cos(turn), signal * np.sin(turn)
    ahead = np.maximum(u, 1e-300)
    gain = np.log(ahead) - 0.5 * np.log(TWO_PI) + log_ndtr(ahead) - 0.5 * v**2
    towards = np.logaddexp(-0.5 * signal**2 - np.log(TWO_PI), gain)
    behind = np.minimum(u, 0.0)
    rest = 1.0 + behind * np.sqrt(np.pi / 2) * erfcx(-behind / np.sqrt(2.0))
    # 1 / u^2 for large u, where the sum above has lost its digits.
    rest = np.where(behind < -1e4, 1.0 / np.maximum(behind**2, 1.0), np.maximum(rest, 1e-16))
    away = -0.5 * signal**2 - np.log(TWO_PI) + np.log(rest)
    return np.asarray(np.where(u > 0, towards, away))
