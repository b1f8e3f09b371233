"""Knowing nothing: every direction is as likely as every other, and every speed of a range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions.angles import TWO_PI


@dataclass(frozen=True, slots=True, kw_only=True)
class Uninformative:
    """1 / (2 pi) = 0.159 for every direction, and a uniform density of speed from 0 to `max_speed`.

    Attributes:
        max_speed: m/s, positive.

    Raises:
        ValueError: `max_speed` is not a positive number.
    """

    max_speed: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.max_speed) and self.max_speed > 0):
            raise ValueError(f"max_speed: expected a positive speed in m/s, got {self.max_speed}")

    def direction_log_density(self, position: FloatArray, direction: FloatArray) -> FloatArray:
        """Natural log of p(direction | position), per radian. (..., 2), (...) -> (...)."""
        return np.full(np.broadcast_shapes(position.shape[:-1], direction.shape), -np.log(TWO_PI))

    def speed_log_density(self, position: FloatArray, speed: FloatArray) -> FloatArray:
        """Natural log of p(speed | position), per m/s; -inf out of range. (..., 2), (...) -> (...)."""
        inside = (speed >= 0) & (speed <= self.max_speed)
        shape = np.broadcast_shapes(position.shape[:-1], speed.shape)
        return np.broadcast_to(np.where(inside, -np.log(self.max_speed), -np.inf), shape)

    def log_density(self, position: FloatArray, direction: FloatArray, speed: FloatArray) -> FloatArray:
        """Natural log of p(direction, speed | position), per radian and m/s. (..., 2), (...), (...) -> (...)."""
        return self.direction_log_density(position, direction) + self.speed_log_density(position, speed)
