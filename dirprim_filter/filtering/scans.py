"""How long after one detection of a vehicle the next usually comes.

A frame without a vehicle is a miss only if its turn had come. Where one frame holds all vehicles, every frame without
one is a miss of it. Where each vehicle reports itself, in messages with times of their own, the frames of others say
nothing of it. And a sensor that looks at a vehicle each ten seconds needs beliefs that last longer than that.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence

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


class Gaps:
    """The last times between two of some events.

    Attributes:
        seen_ns: of the last event; None before the first.
        usual_ns: median, the lower one of an even number, and median of how far off it they are; 0 while unknown.
    """

    def __init__(self) -> None:
        self.seen_ns: int | None = None
        self._gaps: deque[int] = deque(maxlen=REMEMBERED)
        self.usual_ns = 0, 0

    def add(self, gap_ns: int) -> None:
        """One more, unless it is a pause."""
        if gap_ns <= MOST_NS:
            is_same = len(self._gaps) == REMEMBERED and self._gaps[0] == gap_ns
            self._gaps.append(gap_ns)
            if not is_same:  # most sensors are regular
                usual = _median(list(self._gaps))
                self.usual_ns = usual, _median([abs(gap - usual) for gap in self._gaps])

    def see(self, time_ns: int) -> None:
        """One more event."""
        if self.seen_ns is not None:
            self.add(time_ns - self.seen_ns)
        self.seen_ns = time_ns


class Intervals:
    """How often a sensor looks: at each vehicle that it labels, by its own detections alone; at all others; at all.

    Attributes:
        of_frames: between two frames.
        of_others: of vehicles without a label, from one detection to the next.
    """

    def __init__(self) -> None:
        self.of_frames, self.of_others = Gaps(), Gaps()
        self._of: dict[str, Gaps] = {}

    def see(self, names: Sequence[str], time_ns: int) -> None:
        """Take the labelled vehicles of a frame."""
        self.of_frames.see(time_ns)
        for name in names:
            self._of.setdefault(name, Gaps()).see(time_ns)
        if len(self._of) > 2 * len(names) + MOST_NAMES:
            self._of = {name: of for name, of in self._of.items() if time_ns - (of.seen_ns or 0) <= MOST_NS}

    def of(self, names: Iterable[str]) -> FloatArray:
        """(n, 2) usual time and jitter of each, nanoseconds."""
        return np.array([self._of[name].usual_ns for name in names], np.float64).reshape(-1, 2)


def is_due(since_ns: IntArray, interval: FloatArray) -> BoolArray:
    """(v,), (v, 2) -> (v,) whether one was due so long after the last hit or miss; not while that is unknown."""
    due_ns = DUE_FROM * interval[:, 0] + JITTERS * interval[:, 1]
    return np.asarray((since_ns >= due_ns) & (interval[:, 0] > 0))


def _median(times: Sequence[int]) -> int:
    return sorted(times)[(len(times) - 1) // 2]
