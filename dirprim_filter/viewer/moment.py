"""The instant of a log that a picture shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray
from dirprim_filter.distributions.angles import difference
from dirprim_filter.estimates import Estimates, TrackedFrame

MOVING_FROM = 3.0
"""m/s; a picture of tracking shows vehicles that go somewhere."""
SURE_FROM = 0.9
"""Resultant of the direction: young beliefs, and false detections, do not know where they go."""
EVIDENCE_FROM = -3.0
"""Natural log per square metre; a report that surprised the filter more is an outlier, or the belief is about to go."""
BEND_FROM = np.radians(10.0)
"""A vehicle that turned by so much within `BEND_S` is on a bend, where a map beats a straight line."""
BEND_S = 1.0
COMPANY = 4
"""So many vehicles within `COMPANY_WITHIN` metres of the centre are traffic; more make the picture no better."""
COMPANY_WITHIN = 40.0


class Moment:
    """An `EstimateSink` that keeps the frame, and names the vehicle in it, that show tracking on the map best.

    Candidates are moving vehicles whose belief is narrow and explains the detection. A frame with more
    company is better, up to `COMPANY`; then a vehicle on a bend is better than one on a straight way; then nearer to
    the centre is better.

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
        self._best = (0, False, -np.inf)
        self._before: list[tuple[int, dict[str, float]]] = []

    def write(self, frame: TrackedFrame) -> None:
        """Keep the frame if it has a better vehicle than all before."""
        believed = frame.estimates
        distance = np.hypot(*(believed.position - self._center).T)
        company = min(int((distance <= COMPANY_WITHIN).sum()), COMPANY)
        on_bend = self._on_bend(frame.time_ns, believed)
        for row in np.flatnonzero(_is_telling(believed)):
            worth = (company, bool(on_bend[row]), -float(distance[row]))
            if worth > self._best:
                self._best, self.focus = worth, str(believed.track_id[row])
                self.frame = replace(frame, particles=frame.particles.thinned(1))

    def _on_bend(self, time_ns: int, believed: Estimates) -> AnyArray:
        """(n,) whether each vehicle has turned since the frame of `BEND_S` ago."""
        now = dict(zip(map(str, believed.track_id), believed.direction.tolist(), strict=True))
        self._before = [*(past for past in self._before if past[0] >= time_ns - BEND_S * 1e9), (time_ns, now)]
        _, then = self._before[0]
        before = np.array([then.get(name, direction) for name, direction in now.items()])
        return np.asarray(np.abs(difference(believed.direction, before)) >= BEND_FROM)


def _is_telling(believed: Estimates) -> AnyArray:
    """(n,) whether each vehicle moves, and its belief is sure and explains what was reported."""
    is_moving = believed.speed >= MOVING_FROM
    return np.asarray(
        is_moving & (believed.direction_resultant >= SURE_FROM) & (believed.log_evidence >= EVIDENCE_FROM)
    )
