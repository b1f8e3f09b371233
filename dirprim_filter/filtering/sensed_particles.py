"""The particle filter with a sensor's model: errors that are biased, correlated and not round."""

from __future__ import annotations

from typing import Self

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import _kernels, _measuring, _resampling, _sensing
from dirprim_filter.filtering._sensing import Axes, Carried
from dirprim_filter.filtering.measurements import measured_motion
from dirprim_filter.filtering.particle_filter import ParticleFilter
from dirprim_filter.filtering.protocols import Evidence
from dirprim_filter.primitives import PrimitiveMap
from dirprim_filter.sensor import Sensor


class SensedParticles(ParticleFilter):
    """A `ParticleFilter` whose measurements err as a `Sensor` says, latency aside: that is the tracker's.

    A covariance that a detection reports is not used: that of the calibrated sensor replaces it.

    Args:
        primitive_map: how vehicles move at each place.
        config: the filter's knobs.
        sensor: how measured positions err.
    """

    def __init__(self, primitive_map: PrimitiveMap, config: FilterConfig, sensor: Sensor) -> None:
        super().__init__(primitive_map, config)
        along, across = sensor.along, sensor.across
        self._spread = max(along.spread_m, across.spread_m)
        self._axes = Axes(
            bias=(along.bias_m, across.bias_m),
            correlated=(along.correlated_variance, across.correlated_variance),
            white=(along.white_variance, across.white_variance),
            forgets=(1.0 / along.correlation_s, 1.0 / across.correlation_s),
        )
        self._carried = _no_errors(self.belief.n_slots, config.n_particles)

    def reserve(self, n_slots: int) -> None:
        """Make room for so many slots."""
        super().reserve(n_slots)
        if n_slots > self._carried.since_s.size:
            larger = _no_errors(n_slots, self.config.n_particles)
            for new, column in zip(larger, self._carried, strict=True):
                new[: column.shape[0]] = column
            self._carried = larger

    def begin(self, slot: IntArray, key: AnyArray, measured: Detections) -> None:
        """Initialise beliefs from one measurement each and the primitive at its place."""
        self.belief.step += 1
        cloud, columns = self.belief.cloud, _columns(measured)
        self.belief.unweighed_s[slot] = 0.0
        first = (slot, np.asarray(key), measured.position)
        self.split(_kernels.scatter, (self._primitives, cloud), first, (self._spread,), each_ns=150.0)
        known = np.flatnonzero(~np.isnan(measured.direction) | ~np.isnan(measured.speed))
        if known.size:
            drawn = np.full((known.size, 8), 0.0)  # as they were drawn: the position is already used
            drawn[:, [_measuring.XX, _measuring.YY]] = self._spread**-2
            drawn[:, :2], drawn[:, 6:] = columns[known, :2], columns[known, 2:]
            spread = np.full(known.size, self._spread)
            self.split(_measuring.weigh_at_birth, (cloud,), (slot[known], drawn, spread), (self._noise,), each_ns=60.0)
        self.split(
            _sensing.begin, (self._table, cloud, self._carried), (slot, columns), (self._axes, self._spread),
            each_ns=60.0,
        )  # fmt: skip

    def sibling(self) -> Self:
        """One that moves by the same map, without beliefs."""
        other = super().sibling()
        other._carried = _no_errors(other.belief.n_slots, self.config.n_particles)
        return other

    def copy(self, source: IntArray, target: IntArray) -> None:
        """Make the beliefs of `target` those of `source`. (v,), (v,)."""
        super().copy(source, target)
        for column in self._carried:
            column[target] = column[source]

    def predict(self, slot: IntArray, dt_s: FloatArray) -> None:
        """Move the particles by the map's motion model. (v,), (v,) seconds."""
        super().predict(slot, dt_s)
        self._carried.since_s[slot] += dt_s

    def log_likelihood(self, slot: IntArray, measured: Detections) -> FloatArray:
        """Log density of measurements under the beliefs, outliers aside. (v,), v rows -> (v,)."""
        result = np.empty(slot.size)
        self.split(
            _sensing.log_likelihood, (self.belief.cloud, self._carried), (slot, _columns(measured), result),
            (self._axes, self._noise), each_ns=20.0,
        )  # fmt: skip
        return result

    def weigh(self, slot: IntArray, measured: Detections) -> Evidence:
        """Weigh the particles by measurements, and learn of the errors they carry."""
        self.belief.step += 1
        evidence = np.empty((slot.size, 2))
        self.split(
            _sensing.weigh, (self.belief.cloud, self._carried),
            (slot, _columns(measured), self._outlier_share(slot), evidence), (self._axes, self._noise), each_ns=10.0,
        )  # fmt: skip
        return self._judged(evidence)

    def resample(self, slot: IntArray) -> None:
        """Systematic resampling of the beliefs whose effective sample size has fallen. (v,)."""
        self.belief.step += 1
        below = self.config.resample_below * self.config.n_particles
        self.split(_resampling.resample, (self.belief.cloud, self._carried), (slot,), (self._axes, below), each_ns=15.0)


def knobs_of(sensor: Sensor) -> dict[str, float]:
    """The knobs of `FilterConfig` and `TrackingConfig`, by name, that a sensor determines.

    The noise of a round error holds for gates alone; it is as wide as the sensor's errors are in any direction.
    """
    axes = (sensor.along, sensor.across)
    known = {
        "noise_m": float(np.sqrt(max(a.spread_m for a in axes) ** 2 + sum(a.bias_m**2 for a in axes))),
        "outlier_probability": sensor.outlier_share,
        "detection_probability": sensor.detection_probability,
        "clutter_density": sensor.clutter_density,
    }
    return {name: value for name, value in known.items() if value is not None}


def _no_errors(n_slots: int, n_particles: int) -> Carried:
    return Carried(
        np.zeros((n_slots, n_particles, 2)), np.zeros((n_slots, 2)), np.zeros(n_slots), np.zeros(n_slots, np.bool_)
    )


def _columns(measured: Detections) -> FloatArray:
    """(v, 4) position, direction and speed."""
    return np.column_stack([measured.position, *measured_motion(measured)])
