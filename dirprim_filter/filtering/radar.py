"""What a sensor that measures in axes of its own says of particles; a radar's range and bearing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.detections import Detections
from dirprim_filter.distributions.angles import difference


class Measurement(Protocol):
    """A sensor model, which a `ParticleFilter` takes in place of Gaussians of the detections' covariances.

    These still say how wide a belief begins, and gate detections without ids.
    """

    def log_likelihood(self, position: FloatArray, measured: Detections) -> FloatArray:
        """(n, 2) -> (n,) natural log of the density per square metre of one detection, of a vehicle at each place.

        It is densest where the detection says that the vehicle is.
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Radar:
    """Independent Gaussian errors of range and bearing: far away an arc, which no ellipse is.

    Attributes:
        place: (2,) metres, where the radar stands.
        range_m: metres, standard deviation of ranges.
        bearing: radians, that of bearings.
    """

    place: tuple[float, float]
    range_m: float
    bearing: float

    def log_likelihood(self, position: FloatArray, measured: Detections) -> FloatArray:
        """As `Measurement.log_likelihood`: an area of the plane is range times that of range and bearing."""
        (there, ray), (here, at) = self._polar(position), self._polar(measured.position)
        off = ((there - here) / self.range_m) ** 2 + (difference(ray, at) / self.bearing) ** 2
        return np.asarray(-0.5 * off - np.log(2.0 * np.pi * self.range_m * self.bearing * here))

    def with_covariance(self, seen: Detections) -> Detections:
        """Detections with the covariance of these errors: range_m^2 along the ray, (range bearing)^2 across."""
        distance, ray = self._polar(seen.position)
        c, s = np.cos(ray), np.sin(ray)
        axes = np.stack([c, -s, s, c], axis=-1).reshape(-1, 2, 2)  # its columns lie along the ray and across
        root = axes * np.stack([np.full(distance.size, self.range_m), self.bearing * distance], axis=-1)[:, None]
        return replace(seen, covariance=root @ root.swapaxes(1, 2))

    def _polar(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        ray = position - np.array(self.place)
        return np.maximum(np.hypot(*ray.T), 1e-9), np.arctan2(ray[:, 1], ray[:, 0])
