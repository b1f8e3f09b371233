"""In which axes velocities are: those that their schema says, or by the way between positions the other ones.

Source: nav_msgs/Odometry.msg (the twist is in `child_frame_id`), which many drivers fill in the axes of `frame_id`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from dirprim_filter.arrays import IntArray
from dirprim_filter.course import later_rows
from dirprim_filter.detections import NO_ID
from dirprim_filter.distributions.angles import wrap
from dirprim_filter.recording.errors import warn
from dirprim_filter.recording.rows import Rows
from dirprim_filter.recording.schemas.object_columns import STANDING_SPEED
from dirprim_filter.track_ids import Numbers, in_order, vehicle_numbers

SPAN_S, LONGEST_S = 0.5, 2.0
"""Courses are compared with the way to the first row so much later, unless a pause is too long."""
LEAST_WAY_M = 1.0
LEAST_TURN = np.pi / 6
"""Rows whose courses differ less between the two axes decide nothing: who drives east is alike in both."""
LEAST_ROWS, LEAST_SHARE = 10, 0.9
FITS = np.pi / 9
"""So far are courses from the way at most, in the median, where the axes are right."""


class TwistAxes:
    """Judges each topic by the first rows that decide it, and turns the courses of those in other axes.

    Attributes:
        topics: the number of each.
    """

    def __init__(self, path: Path) -> None:
        self.topics = Numbers()
        self._path = path
        self._is_other: dict[int, bool] = {}  # by topic, once known

    def apply(self, rows: Rows, topic: IntArray) -> Rows:
        """The n rows, in one frame and of (n,) topics, with courses as their velocities are meant."""
        moves = (rows.speed >= STANDING_SPEED) & np.isfinite(rows.other_axes) & np.isfinite(rows.direction)
        if not moves.any():
            return rows
        direction, turned, names = rows.direction.copy(), [], list(self.topics)
        for i in np.unique(topic[moves]).tolist():
            here = np.flatnonzero((topic == i) & moves)
            if i not in self._is_other and (found := _is_other(rows[here])) is not None:
                self._is_other[i] = found
                turned += [names[i]] if found else []
            if self._is_other.get(i):
                direction[here] = wrap(direction[here] + rows.other_axes[here])
        if turned:
            warn(
                self._path,
                f"the twist of {', '.join(turned)} is not in the axes that its schema says, of the body or of the "
                "frame: read in the other ones, courses are those of the way from position to position, so it is read "
                "in those",
            )
        return replace(rows, direction=direction)


def _is_other(rows: Rows) -> bool | None:
    """Whether the rows of a topic go where courses lead in the other axes; None where they do not decide it."""
    rows = rows[(np.abs(rows.other_axes) > LEAST_TURN) & (rows.track_id != NO_ID)]
    if len(rows) < LEAST_ROWS:
        return None
    vehicle = vehicle_numbers(rows.track_id, rows.group)
    rows = rows[order := in_order(vehicle, rows.time_ns)]
    later, goes = later_rows(vehicle[order], rows.time_ns, SPAN_S, LONGEST_S)
    way = rows.position[later] - rows.position
    goes &= np.hypot(way[:, 0], way[:, 1]) >= LEAST_WAY_M
    if np.count_nonzero(goes) < LEAST_ROWS:
        return None
    course = np.arctan2(way[:, 1], way[:, 0])
    apart = []  # radians between the way and the mean of the courses at its two ends
    for at in (rows.direction, rows.direction + rows.other_axes):
        apart.append(np.abs(wrap(course - at - 0.5 * wrap(at[later] - at)))[goes])
    stated, other = apart
    for is_other, right, wrong in ((False, stated, other), (True, other, stated)):
        if np.mean(right < wrong) >= LEAST_SHARE and np.median(right) < FITS:
            return is_other
    return None
