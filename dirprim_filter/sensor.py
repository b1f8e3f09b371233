"""How a sensor errs: late, biased, correlated over time, and not always there.

A detection z at time t is of the vehicle's position x and course at t - latency. In the vehicle's own axes, along and
across its way, z - x = bias + c + w: w is white, and c a first-order Gauss-Markov process, so that the covariance of
errors at times t and t' is spread^2 (share exp(-|t - t'| / correlation) + (1 - share) [t = t']).

Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 8.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Self

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.config import FilterConfig, TrackingConfig, require_positive
from dirprim_filter.tracks import Tracks

LATEST_S = 5.0
"""Seconds; what is later is a clock that is wrong."""
WIDE = 2.58
"""Standard deviations in half of a 99 % interval."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisError:
    """The error of positions along one of the vehicle's axes.

    Attributes:
        spread_m: metres, standard deviation of the whole error.
        bias_m: metres, its mean: forwards, or to the left.
        correlated_share: of the variance, in [0, 1); the rest is white.
        correlation_s: seconds in which the correlated part forgets all but 1/e of itself.

    Raises:
        ValueError: a number out of range.
    """

    spread_m: float
    bias_m: float = 0.0
    correlated_share: float = 0.0
    correlation_s: float = 1.0

    def __post_init__(self) -> None:
        require_positive(self, skip=("bias_m",), or_zero=("correlated_share",), below_one=("correlated_share",))
        if not math.isfinite(self.bias_m):
            raise ValueError(f"bias_m: expected a number of metres, got {self.bias_m}")

    @property
    def correlated_variance(self) -> float:
        """Of the correlated part, square metres."""
        return self.correlated_share * self.spread_m**2

    def new_variance(self, since_s: FloatArray) -> FloatArray:
        """(n,) square metres: of what an error does not share with that of (n,) seconds before."""
        return self.spread_m**2 - self.correlated_variance * np.exp(-2.0 * since_s / self.correlation_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """A model of a sensor's detections; None where it is not known.

    Attributes:
        along: error along the vehicle's way, forwards.
        across: error across it, to the left.
        latency_s: seconds by which a detection is older than its time.
        detection_probability: of a vehicle in sight, in each frame.
        clutter_density: false detections per square metre in each frame.
        outlier_share: of a vehicle's detections, those that say nothing of where it is.
        uncertainty: half the widths of 99 % intervals, by the names of numbers, as `latency_s` or `along.bias_m`.

    Raises:
        ValueError: a number out of range, or the uncertainty of none.
    """

    along: AxisError
    across: AxisError
    latency_s: float = 0.0
    detection_probability: float | None = None
    clutter_density: float | None = None
    outlier_share: float | None = None
    uncertainty: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 0 <= self.latency_s <= LATEST_S:
            raise ValueError(f"latency_s: expected 0 to {LATEST_S:g} seconds, got {self.latency_s}")
        shares = ("detection_probability", "outlier_share")
        require_positive(self, skip=("along", "across", "latency_s", "uncertainty"), below_one=shares)
        numbers = self.numbers()
        for name, width in self.uncertainty.items():
            if name not in numbers:
                raise ValueError(f"uncertainty: {name}: expected one of {', '.join(numbers)}")
            if isinstance(width, str) or not 0 <= width < math.inf:
                raise ValueError(f"uncertainty: {name}: expected at least 0, got {width}")

    @classmethod
    def white(cls, noise_m: float) -> Self:
        """Uncorrelated errors of the same standard deviation in both axes."""
        return cls(along=AxisError(spread_m=noise_m), across=AxisError(spread_m=noise_m))

    def unseen_covariance(self, direction: FloatArray, speed: FloatArray) -> FloatArray:
        """(n, 2, 2) square metres: what no filter sees of the errors, to be added to each estimated position.

        What lasts of an error, and what is not known of bias and latency, move the detections of a vehicle alike: the
        variance along the course is that of the correlated part, plus that of the bias, plus speed^2 times that of the
        latency. They are considered, not estimated (Schmidt 1966): a filter weighs by what is new of an error.

        Args:
            direction: (n,) radians.
            speed: (n,) m/s.
        """
        along, across, late = (
            (self.uncertainty.get(name, 0.0) / WIDE) ** 2 for name in ("along.bias_m", "across.bias_m", "latency_s")
        )
        axis = np.stack([np.cos(direction), np.sin(direction)], axis=-1)
        along, across = along + self.along.correlated_variance, across + self.across.correlated_variance
        own = along - across + speed**2 * late
        return np.asarray(across * np.eye(2) + own[:, None, None] * axis[:, :, None] * axis[:, None, :])

    def numbers(self) -> dict[str, float | None]:
        """All its numbers, by name."""
        axes = {"along": self.along, "across": self.across}
        own = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in (*axes, "uncertainty")}
        return own | {f"{name}.{f.name}": getattr(axis, f.name) for name, axis in axes.items() for f in fields(axis)}

    @property
    def noise_m(self) -> float:
        """Metres: of a round error that is as wide as this one in any direction, for gates and for Kalman filters."""
        axes = (self.along, self.across)
        return float(np.sqrt(max(a.spread_m for a in axes) ** 2 + sum(a.bias_m**2 for a in axes)))

    def informs(self, config: FilterConfig, tracking: TrackingConfig) -> tuple[FilterConfig, TrackingConfig]:
        """Configurations with what is known of the sensor in place of their own noise, outliers, misses and clutter."""
        config = replace(config, noise_m=self.noise_m)
        if self.outlier_share is not None:
            config = replace(config, outlier_probability=self.outlier_share)
        for name in ("detection_probability", "clutter_density"):
            if (known := getattr(self, name)) is not None:
                tracking = replace(tracking, **{name: known})
        return config, tracking


def without_bias(tracks: Tracks, sensor: Sensor) -> Tracks:
    """Tracks of a sensor's detections, moved by its bias to where the vehicles were: for a map to be learned from.

    The times stay: where a vehicle was a latency ago it was as well.
    """
    along = np.column_stack([np.cos(tracks.direction), np.sin(tracks.direction)])
    across = np.column_stack([-along[:, 1], along[:, 0]])
    off = sensor.along.bias_m * along + sensor.across.bias_m * across
    return replace(tracks, position=tracks.position - off)
