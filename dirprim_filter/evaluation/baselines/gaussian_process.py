"""Directional regression by Gaussian processes: one for the cosine and one for the sine of the direction.

Source: Wang and Gelfand, Modeling space and space-time directional data using projected Gaussian processes, 2014. Both
processes share one kernel, squared exponential plus noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.special import erfcx, log_ndtr
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from dirprim_filter.arrays import FloatArray, as_floats
from dirprim_filter.distributions.angles import TWO_PI

MAX_ROWS = 1000
"""Drawn at random: the cost grows with the cube of their number."""
SIGNAL_VARIANCE = 0.5
"""Of the cosine and of the sine of an angle of which nothing is known."""


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
        cls, position: FloatArray, direction: FloatArray, *, length: float, noise: float, rng: np.random.Generator
    ) -> Self:
        """Fit to at most `MAX_ROWS` of the rows.

        Args:
            position: (n, 2) metres, n >= 1.
            direction: (n,) radians.
            length: metres, of the kernel.
            noise: standard deviation of a cosine or sine, positive.
            rng: chooses the rows.

        Raises:
            ValueError: shapes that do not fit.
        """
        position, direction = as_floats("position", position, "n 2"), as_floats("direction", direction, "n")
        chosen = rng.permutation(direction.size)[:MAX_ROWS]
        unit = np.column_stack([np.cos(direction), np.sin(direction)])
        kernel = ConstantKernel(SIGNAL_VARIANCE) * RBF(length) + WhiteKernel(noise**2)
        process = GaussianProcessRegressor(kernel=kernel, optimizer=None)
        return cls(process=process.fit(position[chosen], unit[chosen]))

    def direction_log_density(self, position: FloatArray, direction: FloatArray) -> FloatArray:
        """Natural log of p(direction | position), per radian. (n, 2), (n,) -> (n,)."""
        mean, std = self.process.predict(as_floats("position", position, "n 2"), return_std=True)
        turn = np.asarray(direction) - np.arctan2(mean[:, 1], mean[:, 0])
        return projected_normal_log_density(turn, np.hypot(mean[:, 0], mean[:, 1]) / std[:, 0])


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
