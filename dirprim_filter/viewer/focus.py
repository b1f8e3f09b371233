"""Whom to look at: the vehicle asked for, else the one that the filter understands least; and what is shown of it.

In dense traffic only a few are drawn in full, by the same measure: a thousand ellipses would hide each other.
"""

from __future__ import annotations

from collections import deque
from heapq import nsmallest
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray
from dirprim_filter.columns import is_held
from dirprim_filter.distributions.angles import TWO_PI
from dirprim_filter.estimates import Estimates, TrackedFrame
from dirprim_filter.track_ids import as_texts

KEPT_S = 8.0
"""Seconds for which a vehicle stays in focus: quick changes would make its plots useless."""
MEMORY_S = 2.0
"""Over which a vehicle's log evidence is averaged."""
COURSE_S = 1.0
"""Over which its course is taken."""
TURN_SPREAD = 0.3
"""Radians by which a vehicle may turn from its course; the course is no surer a cue."""
CROWD = 40
"""More vehicles than this are a crowd,"""
STILL_CROWD = 32
"""and remain one down to this: a vehicle more or less must not change the picture."""
DRAWN_IN_FULL = 12
"""Of a crowd."""
BIN_DEG = 5


class Look(NamedTuple):
    """The vehicle in one frame.

    Attributes:
        track_id: of the vehicle.
        position: (2,) metres.
        speed: m/s, estimated, and its standard deviation.
        direction: radians, estimated.
        cue: mean direction, radians, and concentration of its turn signal, else of its course from where it was a while
            ago; 0 where it has not moved.
        belief: (n_bins,) share of its particles by direction; empty where there are none.
    """

    track_id: str
    position: FloatArray
    speed: tuple[float, float]
    direction: float
    cue: tuple[float, float]
    belief: FloatArray


class Focus:
    """Follows from frame to frame the few vehicles with the lowest log evidence, the worst of them first.

    Args:
        chosen: id of the vehicle to look at; None: the first of the few.
    """

    def __init__(self, chosen: str | None) -> None:
        self._chosen = chosen
        self._few: list[str] = []
        self._since_ns = 0
        self._evidence: dict[str, float] = {}
        self._past: deque[tuple[int, dict[str, list[float]]]] = deque()
        self._is_crowd = False

    def see(self, frame: TrackedFrame, *, box: FloatArray) -> tuple[Look | None, BoolArray]:
        """The vehicle to look at, None where it is not there; and who is drawn with all that is known, (n,).

        That is everybody, unless they are a crowd: then the few, and the vehicle to look at. Vehicles in the box,
        (2, 2) metres, come first, and each is one of the few for `KEPT_S` at most.
        """
        names, estimates = frame.names, frame.estimates
        self._choose(frame, box)
        name = self._chosen or next(iter(self._few), "")
        self._is_crowd = len(names) > (STILL_CROWD if self._is_crowd else CROWD)
        shown = {*self._few, name}
        in_full = np.array([not self._is_crowd or one in shown for one in names], np.bool_)
        if name not in names:
            return None, in_full
        row = names.index(name)
        mine = frame.particles.of(row)
        bins = np.floor(mine.direction % TWO_PI / TWO_PI * (360 // BIN_DEG)).astype(np.int64)
        look = Look(
            name, estimates.position[row], (float(estimates.speed[row]), float(estimates.speed_std[row])),
            float(estimates.direction[row]), _signal(frame, row) or self._course(name),
            np.bincount(bins, mine.weight, 360 // BIN_DEG).astype(np.float64) if len(mine) else np.empty(0),
        )  # fmt: skip
        return look, in_full

    def _choose(self, frame: TrackedFrame, box: FloatArray) -> None:
        """Of those measured now, and seen before, the ones of the lowest log evidence take the free places."""
        names, estimates, before = frame.names, frame.estimates, self._evidence
        self._remember(frame.time_ns, names, estimates)
        if frame.time_ns >= self._since_ns + KEPT_S * 1e9 or not self._few:
            self._few, self._since_ns = [], frame.time_ns
        self._few = [name for name in self._few if name in self._evidence]
        is_out = ((estimates.position < box[0]) | (estimates.position > box[1])).any(axis=1)
        rank = {
            name: (out, self._evidence[name])
            for name, out, unseen_s in zip(names, is_out.tolist(), estimates.unseen_s.tolist(), strict=True)
            if unseen_s == 0 and name in before and name not in self._few
        }
        self._few += nsmallest(DRAWN_IN_FULL - len(self._few), rank, key=rank.__getitem__)

    def _remember(self, time_ns: int, names: list[str], estimates: Estimates) -> None:
        last_ns = self._past[-1][0] if self._past else time_ns
        kept = float(np.exp((last_ns - time_ns) * 1e-9 / MEMORY_S))
        self._evidence = {
            name: kept * self._evidence.get(name, now) + (1.0 - kept) * now
            for name, now in zip(names, estimates.log_evidence.tolist(), strict=True)
        }
        spread = np.sqrt(0.5 * np.trace(estimates.covariance, axis1=1, axis2=2))
        places = np.column_stack([estimates.position, spread]).tolist()
        self._past.append((time_ns, dict(zip(names, places, strict=True))))
        while self._past[0][0] < time_ns - 1.5e9 * COURSE_S:
            self._past.popleft()

    def _course(self, name: str) -> tuple[float, float]:
        steps = [(time_ns, *places[name]) for time_ns, places in self._past if name in places]
        (then_ns, x, y, then_spread), (now_ns, east, north, now_spread) = steps[0], steps[-1]
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
