"""Initiation, coasting, reinitialisation and end of tracks: a chart of when each is tracked, and a diary.

A lane is one entity, and the viewer slows down with hundreds of them: so there are few, and a vehicle takes the lowest
that is free. Whoever finds none stands in the diary alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import rerun as rr

from dirprim_filter.drawing.colors import track_color
from dirprim_filter.drawing.names import short_name
from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.viewer.stream import time_column

N_LANES = 16
ANEW_COLOR = (240, 228, 66)
UNSEEN_COLOR = (80, 86, 100)


class Change(NamedTuple):
    """A vehicle's state from a time on; an empty state where it has ended."""

    time_ns: int
    state: str


class Entry(NamedTuple):
    """A line of the diary."""

    time_ns: int
    level: str
    text: str


class Lifetimes:
    """Takes frames; what has changed since it was last asked is in `changes`, `entries` and `states`.

    Attributes:
        changes: by lane, ascending in time.
        entries: of the diary, ascending in time.
        states: by lane, each state that was ever in it, and its colour.
    """

    def __init__(self) -> None:
        self.changes: dict[int, list[Change]] = {}
        self.entries: list[Entry] = []
        self.states: dict[int, dict[str, tuple[int, int, int]]] = {}
        self._lane: dict[str, int] = {}
        self._state: dict[str, str] = {}

    def see(self, frame: TrackedFrame) -> None:
        """Compare a frame with the one before."""
        believed, time_ns = frame.estimates, frame.time_ns
        coasting = dict(zip(frame.names, believed.is_coasting.tolist(), strict=True))
        taken = set(self._lane.values())  # a lane that is left now is free from the next frame on
        for name in [name for name in self._state if name not in coasting]:
            self._log(time_ns, name, "", "INFO", f"{name} ended")
            self._state.pop(name)
            self._lane.pop(name, None)
        free = (lane for lane in range(N_LANES) if lane not in taken)
        anew = set(frame.begun_anew)
        for name, is_coasting in coasting.items():
            if self._state.get(name) == name and not is_coasting and name not in anew:
                continue  # in sight as before, as most are
            if name not in self._state:
                lane = next(free, None)
                if lane is not None:
                    self._lane[name] = lane
                self._log(time_ns, name, name, "INFO", f"{name} initialised")
                self._state[name] = name
            for level, state, text in self._news(name, is_coasting=is_coasting, is_anew=name in anew):
                self._log(time_ns, name, state, level, text)
                self._state[name] = state

    def _news(self, name: str, *, is_coasting: bool, is_anew: bool) -> Iterator[tuple[str, str, str]]:
        state = self._state[name]
        if is_anew:
            yield "WARN", f"{name} reinitialised", f"{name} reinitialised: its belief did not explain its measurements"
        elif is_coasting:
            if state != f"{name} coasting":
                yield "INFO", f"{name} coasting", f"{name} coasts: no measurement"
        elif state == f"{name} coasting":
            yield "INFO", name, f"{name} measured again"
        elif state == f"{name} reinitialised":
            yield "INFO", name, f"{name} explained again"

    def _log(self, time_ns: int, name: str, state: str, level: str, text: str) -> None:
        self.entries.append(Entry(time_ns, level, text))
        lane = self._lane.get(name)
        if lane is None:
            return
        state = state.replace(name, short_name(name), 1)
        self.changes.setdefault(lane, []).append(Change(time_ns, state))
        if state:
            colors = self.states.setdefault(lane, {})
            if state.endswith(" reinitialised"):
                colors[state] = ANEW_COLOR
            elif state.endswith(" coasting"):
                colors[state] = UNSEEN_COLOR
            else:
                red, green, blue, _ = track_color(np.array([name]))[0].tolist()
                colors[state] = (red, green, blue)


def lane_columns(lines: Lifetimes) -> Iterator[tuple[str, rr.TimeColumn, rr.ComponentColumnList]]:
    """What has changed in the lanes and in the diary since the last time."""
    for lane, changes in lines.changes.items():
        times = time_column([change.time_ns for change in changes])
        states = [change.state for change in changes if change.state]
        n_states = [int(bool(change.state)) for change in changes]
        yield lane_path(lane), times, rr.StateChange.columns(state=states).partition(n_states)
    if lines.entries:
        entries = lines.entries
        columns = rr.TextLog.columns(text=[e.text for e in entries], level=[e.level for e in entries])
        yield "/events", time_column([e.time_ns for e in entries]), columns


def lane_path(lane: int) -> str:
    """The entity of a lane."""
    return f"/vehicles/{lane + 1:02d}"


def lane_styles(lines: Lifetimes) -> Iterator[tuple[str, rr.StateConfiguration]]:
    """The colours of the states of lanes that have changed."""
    for lane in lines.changes:
        states = lines.states[lane]
        yield (
            lane_path(lane),
            rr.StateConfiguration(values=list(states), labels=list(states), colors=list(states.values())),
        )
