"""Initiation, coasting, reinitialisation and end of tracks: a chart of when each is tracked, and a diary.

A lane is one entity, and the viewer slows down with hundreds of them: so there are few, and a vehicle takes the lowest
that is free. Whoever finds none stands in the diary alone.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import rerun as rr

from dirprim_filter.drawing.colors import track_color
from dirprim_filter.drawing.names import short_name
from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.viewer.stream import time_column

N_LANES = 16
COASTING, ANEW = " coasting", " reinitialised"
COLORS = {COASTING: (80, 86, 100), ANEW: (240, 228, 66)}


class Lifetimes:
    """Takes frames; what has changed since it was last asked is in `changes` and `entries`.

    Attributes:
        changes: by lane, time and state of its vehicle from then on, ascending; an empty state where it has ended.
        entries: time, level and text of the diary's lines, ascending in time.
        states: by lane, each state that was ever in it, and its colour.
    """

    def __init__(self) -> None:
        self.changes: dict[int, list[tuple[int, str]]] = {}
        self.entries: list[tuple[int, str, str]] = []
        self.states: dict[int, dict[str, tuple[int, ...]]] = {}
        self._lane: dict[str, int] = {}
        self._state: dict[str, str] = {}

    def see(self, frame: TrackedFrame) -> None:
        """Compare a frame with the one before."""
        coasting = frame.estimates.is_coasting.tolist()
        now = {name: COASTING * coasts for name, coasts in zip(frame.names, coasting, strict=True)}
        now |= {name: ANEW for name in frame.begun_anew if name in now}
        taken = set(self._lane.values())  # a lane that is left now is free from the next frame on
        for name in [name for name in self._state if name not in now]:
            self._log(frame.time_ns, name, "ended", None)
            del self._state[name]
            self._lane.pop(name, None)
        free = (lane for lane in range(N_LANES) if lane not in taken)
        for name, state in now.items():
            if name not in self._state:
                lane = next(free, None)
                if lane is not None:
                    self._lane[name] = lane
                self._state[name] = ""
                self._log(frame.time_ns, name, "initialised", "")
            before = self._state[name]
            if state != before or state == ANEW:
                seen_again = "measured again" if before == COASTING else "explained again"
                news = {
                    COASTING: "coasts: no measurement",
                    ANEW: "reinitialised: its belief did not explain its measurements",
                }
                self._log(frame.time_ns, name, news.get(state, seen_again), state)
                self._state[name] = state

    def _log(self, time_ns: int, name: str, news: str, state: str | None) -> None:
        self.entries.append((time_ns, "WARN" if state == ANEW else "INFO", f"{name} {news}"))
        lane = self._lane.get(name)
        if lane is None:
            return
        shown = "" if state is None else short_name(name) + state
        self.changes.setdefault(lane, []).append((time_ns, shown))
        if state is not None:
            own = tuple(track_color(np.array([name]))[0, :3].tolist())
            self.states.setdefault(lane, {})[shown] = COLORS.get(state, own)

    def columns(self) -> Iterator[tuple[str, rr.TimeColumn, rr.ComponentColumnList]]:
        """What has changed in the lanes and in the diary since the last time, which is then forgotten."""
        for lane, changes in self.changes.items():
            states = [state for _, state in changes if state]
            of_each = [int(bool(state)) for _, state in changes]
            times = time_column([time_ns for time_ns, _ in changes])
            yield lane_path(lane), times, rr.StateChange.columns(state=states).partition(of_each)
        if self.entries:
            when, levels, texts = zip(*self.entries, strict=True)
            yield "/events", time_column(when), rr.TextLog.columns(text=texts, level=levels)
        self.changes, self.entries = {}, []

    def styles(self) -> Iterator[tuple[str, rr.StateConfiguration]]:
        """The colours of the states of lanes that have changed; to be asked before `columns`."""
        for lane in self.changes:
            states = self.states[lane]
            yield (
                lane_path(lane),
                rr.StateConfiguration(values=list(states), labels=list(states), colors=list(states.values())),
            )


def lane_path(lane: int) -> str:
    """The entity of a lane."""
    return f"/vehicles/{lane + 1:02d}"
