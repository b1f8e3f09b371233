"""The gamma distribution of speed (Eq. 3), by shape and rate.

Source: Anderson and Ray, Improved maximum likelihood estimators for the gamma distribution, 1975.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln, xlogy

from dirprim_filter.arrays import AnyArray, FloatArray, as_floats
from dirprim_filter.distributions import _kernels
from dirprim_filter.distributions.weights import counted

MAX_SHAPE = 1e6
"""The default bound of the shape in `fit`: a spread of a thousandth of the mean."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gamma:
    """Gamma(shape, rate), for any number of distributions at once.

    Attributes:
        shape: (...) positive; called alpha in the paper.
        rate: (...) positive, seconds per metre for a speed; called beta in the paper.

    Raises:
        ValueError: shapes differ, or a parameter is not positive.
    """

    shape: FloatArray
    rate: FloatArray

    def __post_init__(self) -> None:
        shape, rate = as_floats("shape", self.shape, "..."), as_floats("rate", self.rate, "...")
        if shape.shape != rate.shape:
            raise ValueError(f"shape, rate: expected one shape (...), got {shape.shape} and {rate.shape}")
        if (shape <= 0).any() or (rate <= 0).any():
            raise ValueError("shape, rate: expected positive numbers")
        object.__setattr__(self, "shape", shape)
        object.__setattr__(self, "rate", rate)

    def __getitem__(self, index: AnyArray | int) -> Gamma:
        """The distributions at `index` of the leading axes."""
        return Gamma(shape=self.shape[index], rate=self.rate[index])

    @property
    def mean(self) -> FloatArray:
        """(...) shape / rate."""
        return self.shape / self.rate

    def log_density(self, value: FloatArray) -> FloatArray:
        """Natural log of the density; -inf below 0; NaN gives NaN. Broadcasts.

        At 0 it is -inf for a shape above 1, the log of the rate for 1, and inf for a shape below 1.
        """
        x = np.asarray(value, dtype=np.float64)
        positive = np.maximum(x, 0.0)
        log_p = (
            xlogy(self.shape, self.rate)
            + xlogy(self.shape - 1.0, positive)
            - self.rate * positive
            - gammaln(self.shape)
        )
        return np.where(x < 0, -np.inf, log_p)

    def sample(self, *, rng: np.random.Generator) -> FloatArray:
        """One draw from each distribution. -> (...)."""
        return np.asarray(rng.standard_gamma(self.shape) / self.rate)


def fit(
    value: FloatArray, *, weight: FloatArray | None = None, min_shape: float = 1.0, max_shape: float = MAX_SHAPE
) -> Gamma:
    """Maximum likelihood over the last axis, the shape's bias reduced as Anderson and Ray do. (..., n) -> (...).

    The likelihood's shape a, by Newton on log(a) - psi(a) = log(mean) - mean(log), becomes a (n - 3) / n + 2 / (3 n)
    for n values; the mean stays. Up to three values give no spread: they get `min_shape`, with their mean. Equal
    values, four or more, give `max_shape` times (n - 3) / n.

    Args:
        value: (..., n) positive where the weight is.
        weight: (..., n) how often each counts; left out, once.
        min_shape: at least so much; below 1 the density has no bound at 0, hence the default.
        max_shape: at most so much.

    Raises:
        ValueError: no value, one that counts and is not positive or not finite (a gamma has no likelihood there:
            leave out the values of standing vehicles), or weights that are negative or all 0.
    """
    x = as_floats("value", value, "... n")
    w = counted("value", x, weight)
    bad = (x <= 0) & (w > 0)
    if bad.any():
        place = tuple(map(int, np.argwhere(bad)[0]))
        raise ValueError(f"value: expected positive numbers, got {x[place]} at {place}; leave it out or weigh it 0")
    n = w.sum(axis=-1)
    mean = (w * x).sum(axis=-1) / n
    # log(mean) - mean(log) as a mean of positive terms d - log(1 + d), d = value / mean - 1, which sum to zero.
    deviation = np.where(w > 0, x, mean[..., None]) / mean[..., None] - 1.0
    spread = (w * (deviation - np.log1p(deviation))).sum(axis=-1) / n
    shape = np.empty(n.size)
    _kernels.gamma_shapes(spread.ravel(), 0.0, max_shape, shape)
    shape = np.clip(shape.reshape(n.shape) * (n - 3.0) / n + 2.0 / (3.0 * n), min_shape, max_shape)
    shape = np.where(n <= 3.0, min_shape, shape)
    return Gamma(shape=shape, rate=shape / mean)
