"""The instant of a log that a picture shows."""

from __future__ import annotations

import numpy as np

from dirprim_filter.estimates import Estimates, TrackedFrame
from tessellation.arrays import FloatArray

MOVING_FROM = 3.0
"""m/s; a picture of tracking shows vehicles that go somewhere."""
SURE_FROM = 0.9
"""Resultant of the direction: young beliefs, and false detections, do not know where they go."""


class Moment:
    """An `EstimateSink` that keeps the frame whose moving vehicle is nearest to a point, and names that vehicle.

    Args:
        center: (2,) metres, where the picture should look.

    Attributes:
        frame: the frame kept; None before any vehicle moved.
        focus: the track id of its vehicle; empty before.
    """

    def __init__(self, center: FloatArray) -> None:
        self.frame: TrackedFrame | None = None
        self.focus = ""
        self._center = center
        self._nearest = np.inf

    def write(self, frame: TrackedFrame) -> None:
        """Keep the frame if a vehicle of it is nearer than any before."""
        distance = self._distances(frame.estimates)
        if distance.size and distance.min() < self._nearest:
            self._nearest = float(distance.min())
            self.frame = frame
            self.focus = str(frame.estimates.track_id[int(distance.argmin())])

    def _distances(self, believed: Estimates) -> FloatArray:
        sure = (believed.speed >= MOVING_FROM) & (believed.direction_resultant >= SURE_FROM)
        distance = np.hypot(*(believed.position - self._center).T)
        return np.where(sure, distance, np.inf)
