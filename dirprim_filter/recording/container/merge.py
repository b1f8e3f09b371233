"""Chunks that overlap in time, merged into one order of log time in bounded memory.

An external merge: chunks come in order of their start, each sorted; what lies before the next start is final and
goes out, the rest is held. When more is held than `HELD_BYTES`, it goes to a temporary file that is mapped.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np

from dirprim_filter.recording.container.message_columns import MessageColumns, gathered, interleaved, ordered

HELD_BYTES = 1 << 25
"""Chunks that overlap in time are held in memory up to this size."""
WINDOW_ROWS = 1 << 13
"""About so many messages of overlapping chunks are merged at a time."""
WINDOWS_KEPT = 64
FAN_IN = 16
"""So many small parts become one: else each window would ask all of them."""
JOINED_BYTES = HELD_BYTES // FAN_IN
"""Parts of more bytes are joined no further: there are few of them."""


@dataclass(slots=True, eq=False)
class _Part:
    """Messages of a chunk, or of several, that are not yet delivered: in order of time, and of one time of the file."""

    columns: MessageColumns
    level: int = 0  # how often it was joined with others
    start: int = 0
    is_on_disk: bool = False

    def until(self, time_ns: int, position: int) -> int:
        """The row after the last one before that time, and of that time before the chunk of that position."""
        columns = self.columns
        first, last = (
            self.start + int(np.searchsorted(columns.log_time_ns[self.start :], np.uint64(time_ns), side))
            for side in ("left", "right")
        )
        return first + int(np.searchsorted(columns.position[first:last], position))

    def key(self, row: int) -> tuple[int, int]:
        return int(self.columns.log_time_ns[row]), int(self.columns.position[row])

    def take(self, stop: int) -> MessageColumns:
        rows = self.columns[self.start : stop]
        self.start = stop
        return rows


class TimeMerge:
    """Takes chunks in order of their start time, gives messages in order of log time; a context manager."""

    def __init__(self) -> None:
        self._parts: list[_Part] = []
        self._in_memory = 0
        self._windows = 0
        self._spill: BinaryIO | None = None
        self._open = ExitStack()

    def __enter__(self) -> TimeMerge:
        return self

    def __exit__(self, *_: object) -> None:
        self._parts.clear()
        self._open.close()

    def hold(self, columns: MessageColumns) -> None:
        """Keep the messages of a chunk."""
        part = _Part(columns)
        while len(alike := [one for one in self._parts if one.level == part.level and _is_small(one)]) >= FAN_IN:
            self._parts = [one for one in self._parts if one not in alike]
            rows = [one.columns[one.start :] for one in (*alike, part)]
            part = _Part(gathered(rows, ordered(rows)), part.level + 1)
        if len(part.columns):
            self._parts.append(part)
        self._in_memory = sum(one.columns.nbytes for one in self._parts if not one.is_on_disk)
        if self._in_memory > HELD_BYTES and len(self._parts) > 1:
            self._put_on_disk()

    def release(self, before: tuple[int, int] | None) -> Iterator[MessageColumns]:
        """What comes before all that is not yet held: before a chunk of that start time and position; None: all."""
        while self._parts:
            stops = [len(part.columns) if before is None else part.until(*before) for part in self._parts]
            open_parts = [(part, stop) for part, stop in zip(self._parts, stops, strict=True) if stop > part.start]
            if not open_parts:
                return
            yield from self._window(open_parts)
            self._parts = [part for part in self._parts if part.start < len(part.columns)]
            self._let_go()

    def _window(self, parts: list[tuple[_Part, int]]) -> Iterator[MessageColumns]:
        """The next messages, about `WINDOW_ROWS`, up to the first of the rows that the parts then come to."""
        if len(parts) == 1:
            part, stop = parts[0]
            yield part.take(min(stop, part.start + WINDOW_ROWS))
            return
        step = max(WINDOW_ROWS // len(parts), 16)
        time_ns, position = min(part.key(min(part.start + step, stop) - 1) for part, stop in parts)
        yield from interleaved([part.take(min(part.until(time_ns, position + 1), stop)) for part, stop in parts])

    def _put_on_disk(self) -> None:
        if self._spill is None:
            self._spill = self._open.enter_context(tempfile.TemporaryFile(prefix="dirprim-"))  # noqa: SIM115
        for part in self._parts:
            if not part.is_on_disk:
                part.columns = part.columns[part.start :].spilled(self._spill)
                part.start, part.is_on_disk = 0, True
        self._in_memory = 0

    def _let_go(self) -> None:
        """Without this the pages of the temporary file that were read would count as ours."""
        self._windows += 1
        if self._spill is not None and self._windows % WINDOWS_KEPT == 0:
            for part in self._parts:
                part.columns.let_go()


def _is_small(part: _Part) -> bool:
    return not part.is_on_disk and part.columns.nbytes <= JOINED_BYTES
