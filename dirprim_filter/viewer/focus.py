"""Whom to look at: the vehicle asked for, else the one that the filter understands least; and what is shown of it."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.columns import is_held
from dirprim_filter.distributions.angles import TWO_PI
from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.track_ids import as_texts

KEPT_S = 8.0
"""Seconds for which a vehicle stays in focus: quick changes would make its plots useless."""
COURSE_S = 1.0
"""Over which its course is taken."""
TURN_SPREAD = 0.3
"""Radians by which a vehicle may turn from its course; the course is no surer a cue."""
BIN_DEG = 5


class Look(NamedTuple):
    """The vehicle in one frame.

    Attributes:
        track_id: of the vehicle.
        position: (2,) metres.
        cue: mean direction, radians, and concentration of its turn signal, else of its course from where it was a while
            ago; 0 where it has not moved.
        belief: (n_bins,) share of its particles by direction; zeros where there are none.
    """

    track_id: str
    position: FloatArray
    cue: tuple[float, float]
    belief: FloatArray


class Focus:
    """Follows from frame to frame the vehicle of the lowest log evidence.

    Args:
        chosen: id of the vehicle to look at instead.
    """

    def __init__(self, chosen: str | None) -> None:
        self._chosen, self._name = chosen, ""
        self._since_ns = 0
        self._past: deque[tuple[int, float, float, float]] = deque()

    def see(self, frame: TrackedFrame, *, box: FloatArray) -> Look | None:
        """The vehicle in a frame, None where it is not there; those in the box, (2, 2) metres, come first."""
        name = self._chosen or self._worst(frame, box)
        if name != self._name:
            self._name = name
            self._past.clear()
        if name not in frame.names:
            return None
        row, estimates = frame.names.index(name), frame.estimates
        spread = float(np.sqrt(0.5 * np.trace(estimates.covariance[row])))
        self._past.append((frame.time_ns, *estimates.position[row].tolist(), spread))
        while self._past[0][0] < frame.time_ns - 1.5e9 * COURSE_S:
            self._past.popleft()
        mine = frame.particles.of(row)
        bins = np.floor(mine.direction % TWO_PI / TWO_PI * (360 // BIN_DEG)).astype(np.int64)
        return Look(
            name, estimates.position[row], _signal(frame, row) or self._course(),
            np.bincount(bins, mine.weight, 360 // BIN_DEG).astype(np.float64),
        )  # fmt: skip

    def _worst(self, frame: TrackedFrame, box: FloatArray) -> str:
        """The one before, for a while, if in view; then of those measured now the one that is least expected."""
        estimates = frame.estimates
        is_out = ((estimates.position < box[0]) | (estimates.position > box[1])).any(axis=1)
        is_known = self._name in frame.names and not is_out[frame.names.index(self._name)]
        measured = np.flatnonzero(estimates.unseen_s == 0)
        if not measured.size or (is_known and frame.time_ns < self._since_ns + KEPT_S * 1e9):
            return self._name
        self._since_ns = frame.time_ns
        return str(frame.names[measured[np.lexsort((estimates.log_evidence[measured], is_out[measured]))[0]]])

    def _course(self) -> tuple[float, float]:
        (then_ns, x, y, then_spread), (now_ns, east, north, now_spread) = self._past[0], self._past[-1]
        distance = float(np.hypot(east - x, north - y))
        if now_ns - then_ns < 0.5e9 * COURSE_S or distance <= then_spread + now_spread:
            return 0.0, 0.0
        variance = (then_spread**2 + now_spread**2) / distance**2 + TURN_SPREAD**2
        return float(np.arctan2(north - y, east - x)), 1.0 / variance


def _signal(frame: TrackedFrame, row: int) -> tuple[float, float] | None:
    """The mean direction and the concentration of the turn signal that a vehicle gives now."""
    seen = frame.detections
    own = np.flatnonzero(as_texts(seen.track_id) == frame.names[row]) if is_held(seen.cue) else np.empty(0, np.int64)
    if not own.size or not np.isfinite(seen.cue[own[0]]).all():
        return None
    turn, concentration = seen.cue[own[0]].tolist()
    return float(frame.estimates.direction[row]) + turn, concentration
