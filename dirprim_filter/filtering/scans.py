"""How long after one detection of a vehicle the next usually comes.

A frame without a vehicle is a miss only if its turn had come. Where one frame holds all vehicles, every frame without
one is a miss of it. Where each vehicle reports itself, in messages with times of their own, the frames of others say
nothing of it. And a sensor that looks at a vehicle each ten seconds needs beliefs that last longer than that.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray

REMEMBERED = 9
DUE_FROM, JITTERS = 0.75, 2.0
"""Share of the usual time after which the next detection is due, as sensors are not exact; and how many deviations of
these times later."""
MOST_NS = 300_000_000_000
"""What passes for longer is a pause of the log or a vehicle that comes back, and no interval of a sensor."""
MOST_NAMES = 1000
"""Beyond so many names those are forgotten that were not seen for so long."""


class Interval(NamedTuple):
    """Of a vehicle's detections."""

    seen_ns: int  # its last one
    gaps_ns: tuple[int, ...] = ()  # the last times between two

    def after(self, time_ns: int) -> Interval:
        """With one more detection."""
        gap = time_ns - self.seen_ns
        return Interval(time_ns, (*self.gaps_ns, gap)[-REMEMBERED:] if gap <= MOST_NS else self.gaps_ns)

    @property
    def usual_ns(self) -> tuple[float, float]:
        """Median of the times between two, and median of how far off it they are; 0 while unknown."""
        if not self.gaps_ns:
            return 0.0, 0.0
        usual = _median(self.gaps_ns)
        return usual, _median([abs(gap - usual) for gap in self.gaps_ns])


class IntervalsByName:
    """The intervals of vehicles that their sensor labels: of each by its own detections alone."""

    def __init__(self) -> None:
        self._of: dict[str, Interval] = {}

    def see(self, names: Sequence[str], time_ns: int) -> None:
        """Take the vehicles of a frame."""
        for name in names:
            former = self._of.get(name)
            self._of[name] = Interval(time_ns) if former is None else former.after(time_ns)
        if len(self._of) > 2 * len(names) + MOST_NAMES:
            self._of = {name: of for name, of in self._of.items() if time_ns - of.seen_ns <= MOST_NS}

    def of(self, names: Sequence[str]) -> FloatArray:
        """(n, 2) usual time and jitter of each, nanoseconds."""
        return np.array([self._of[name].usual_ns for name in names]).reshape(-1, 2)


class RevisitTime:
    """The same of all others together: the median over the last frames of each frame's median."""

    def __init__(self) -> None:
        self._medians: deque[float] = deque(maxlen=REMEMBERED)

    def see(self, gap_ns: FloatArray | IntArray) -> None:
        """Of a frame's vehicles, the times since the detections before these. (v,) nanoseconds."""
        gap_ns = gap_ns[gap_ns <= MOST_NS]
        if gap_ns.size:
            self._medians.append(float(np.median(gap_ns)))

    @property
    def usual_ns(self) -> float:
        """Nanoseconds; 0 while unknown."""
        return float(np.median(self._medians)) if self._medians else 0.0


def is_due(since_ns: IntArray, interval: FloatArray) -> BoolArray:
    """(v,), (v, 2) -> (v,) whether one was due so long after the last hit or miss; not while that is unknown."""
    due_ns = DUE_FROM * interval[:, 0] + JITTERS * interval[:, 1]
    return np.asarray((since_ns >= due_ns) & (interval[:, 0] > 0))


def _median(times: Sequence[float]) -> float:
    """The lower one of an even number."""
    return float(sorted(times)[(len(times) - 1) // 2])
