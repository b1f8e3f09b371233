"""Which frames would have shown a vehicle? A frame without it is a miss only if its turn had come.

Where one frame holds all vehicles, every frame without one is a miss of it. Where each vehicle reports itself, in
messages with times of their own, the frames of others say nothing of it.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from dirprim_filter.arrays import BoolArray, IntArray

FRAMES_REMEMBERED = 9
DUE_FROM = 0.75
"""Share of the usual time between two detections of a vehicle after which the next is due: sensors are not exact."""


class RevisitTime:
    """The usual time between two detections of one vehicle: the median over the last frames of each frame's median."""

    def __init__(self) -> None:
        self._medians: deque[float] = deque(maxlen=FRAMES_REMEMBERED)

    def see(self, gap_ns: IntArray) -> None:
        """Of a frame's vehicles, the times since the detections before these. (v,) nanoseconds."""
        if gap_ns.size:
            self._medians.append(float(np.median(gap_ns)))

    def is_due(self, since_ns: IntArray) -> BoolArray:
        """(v,) -> (v,) whether a detection was due so long after the last hit or miss; not while that is unknown."""
        if not self._medians:
            return np.zeros(since_ns.size, np.bool_)
        return np.asarray(since_ns >= DUE_FROM * float(np.median(self._medians)))
