"""The gamma distribution of speed (Eq. 3), by shape and rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln, xlogy

from dirprim_filter.arrays import FloatArray, as_floats


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
