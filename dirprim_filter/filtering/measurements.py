"""Measurements of a sensor and their errors.

A false detection has any course, and any speed below `FASTEST`: of densities 1/(2 pi) and 1/`FASTEST`. What a measured
course and speed say for a vehicle is the ratio of their densities to these.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.distributions import gaussian
from dirprim_filter.estimates import Estimates
from dirprim_filter.sensor import Sensor

TAIL = 6.0
"""How many times as wide as its Gaussian the tail of a position's error is, Student's t of two degrees of freedom."""
LOST = 1e-3
"""Share of wrong positions by which it is judged whether a belief explains one, where none are said to be wrong."""
FASTEST = 60.0
"""m/s; an outlier of a measured speed, or a false detection's, lies anywhere below it."""


class Evidence(NamedTuple):
    """How well beliefs explain their measurements.

    Attributes:
        log_density: (v,) natural log of the density of each measurement given those before it: per square metre of
            position; that of course and speed is a ratio to a false detection's, see above.
        is_unexplained: (v,) where an outlier explains it better, or nothing does.
        is_moved: (v,) whose belief was moved: samples were, not only weighed, or there are none.
    """

    log_density: FloatArray
    is_unexplained: BoolArray
    is_moved: BoolArray


def measured_covariance(measured: Detections, config: FilterConfig) -> FloatArray:
    """(n, 2, 2) of the positions' errors, square metres: the sensor's where reported, else the configured noise."""
    unknown = np.isnan(measured.covariance[:, 0, 0])
    return np.where(unknown[:, None, None], config.noise_m**2 * np.eye(2), measured.covariance)


def innovation(
    moments: FloatArray, measured: Detections, since_s: FloatArray, config: FilterConfig, sensor: Sensor | None
) -> FloatArray:  # fmt: skip
    """(v,) squared distances of measurements from the means of beliefs of moments (v, 10), in their covariance.

    Of a sensor's error counts what is new, (v,) seconds after the vehicle's last measurement: as beliefs are weighed.
    """
    if sensor is not None:
        measured = of_sensor(measured, moments[:, 5], since_s, sensor)
    spread = moments[:, [2, 3, 3, 4]].reshape(-1, 2, 2) + measured_covariance(measured, config)
    return gaussian.squared_distance(measured.position - moments[:, :2], spread)


def of_sensor(measured: Detections, course: FloatArray, since_s: FloatArray, sensor: Sensor) -> Detections:
    """Measurements (v,) less their bias, with the covariance of what is new of their errors.

    Args:
        measured: of vehicles.
        course: (v,) radians, of each.
        since_s: (v,) seconds since its last measurement.
        sensor: whose errors lie along and across.
    """
    c, s = np.cos(course), np.sin(course)
    axes = np.stack([c, -s, s, c], axis=-1).reshape(-1, 2, 2)  # its columns lie along and across
    new = np.column_stack([axis.new_variance(since_s) for axis in (sensor.along, sensor.across)])
    bias = axes @ np.array([sensor.along.bias_m, sensor.across.bias_m])
    covariance = (axes * new[:, None]) @ axes.swapaxes(1, 2)
    covariance[:, 1, 0] = covariance[:, 0, 1]  # but for rounding they are the same
    return replace(measured, position=measured.position - bias, covariance=covariance)


def with_unseen_errors(estimates: Estimates, sensor: Sensor | None) -> Estimates:
    """Estimates whose covariances contain what no filter sees of a sensor's errors: see `Sensor.unseen_covariance`."""
    if sensor is None:
        return estimates
    unseen = sensor.unseen_covariance(estimates.direction, estimates.speed)
    return estimates.having(covariance=estimates.covariance + unseen)
