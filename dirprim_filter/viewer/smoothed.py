"""Smoothed estimates beside those of the filter: bold paths and thin ellipses, a layer of their own."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dirprim_filter.estimates import Estimates, TrackedFrame
from dirprim_filter.viewer import marks
from dirprim_filter.viewer.batch import Columns
from dirprim_filter.viewer.timeline import time_column

BOLD = 2.5
"""By how much a smoothed way is wider than the filter's."""


class SmoothedWays:
    """Gathers smoothed frames, in order of time, and turns them into columns."""

    def __init__(self) -> None:
        self._frames: list[TrackedFrame] = []
        self._before: dict[str, tuple[float, float]] = {}

    def __len__(self) -> int:
        return len(self._frames)

    def add(self, frame: TrackedFrame) -> None:
        """Take a frame."""
        self._frames.append(frame)

    def columns(self) -> Iterator[Columns]:
        """What the frames gathered since the last time show."""
        if not self._frames:
            return
        times = time_column([frame.time_ns for frame in self._frames])
        believed = Estimates.concatenate([frame.estimates for frame in self._frames])
        steps, n_steps, stepped = [], [], []
        first = 0
        for frame in self._frames:
            places = frame.estimates.position.tolist()
            known = [row for row, name in enumerate(frame.names) if name in self._before]
            steps += [(self._before[frame.names[row]], places[row]) for row in known]
            stepped += [first + row for row in known]
            n_steps.append(len(known))
            first += len(places)
            self._before = dict(zip(frame.names, map(tuple, places), strict=True))
        drawn = marks.trails(
            believed.track_id[stepped], np.array(steps).reshape(-1, 2, 2), np.ones(len(steps)), width=BOLD
        )
        yield "/smoothed/trails", times, drawn.partition(n_steps)
        n_believed = [len(frame.estimates) for frame in self._frames]
        yield "/smoothed/covariance", times, marks.covariance(believed).partition(n_believed)
        self._frames = []
