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

from dirprim_filter.recording.container.message_columns import MessageColumns, interleaved

HELD_BYTES = 1 << 25
"""Chunks that overlap in time are held in memory up to this size."""
WINDOW_ROWS = 1 << 13
"""About so many messages of overlapping chunks are merged at a time."""
WINDOWS_KEPT = 64


@dataclass(slots=True)
class _Part:
    """A chunk's messages that are not yet delivered."""

    position: int  # of the chunk in the file
    columns: MessageColumns
    start: int = 0
    is_on_disk: bool = False

    def until(self, time_ns: int, *, inclusive: bool) -> int:
        """The row after the last one of a time before `time_ns`."""
        times = self.columns.log_time_ns[self.start :]
        return self.start + int(np.searchsorted(times, np.uint64(time_ns), "right" if inclusive else "left"))

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

    def hold(self, position: int, columns: MessageColumns) -> None:
        """Keep the messages of the chunk that is the `position`-th of the file."""
        if not len(columns):
            return
        self._parts.append(_Part(position, columns))
        self._parts.sort(key=lambda part: part.position)
        self._in_memory += columns.nbytes
        if self._in_memory > HELD_BYTES and len(self._parts) > 1:
            self._put_on_disk()

    def release(self, before: tuple[int, int] | None) -> Iterator[MessageColumns]:
        """What comes before all that is not yet held: before a chunk of that start time and position; None: all."""
        while self._parts:
            stops = [self._final(part, before) for part in self._parts]
            if all(stop == part.start for stop, part in zip(stops, self._parts, strict=True)):
                return
            yield from self._window(stops)
            if any(part.start == len(part.columns) for part in self._parts):
                self._parts = [part for part in self._parts if part.start < len(part.columns)]
                self._in_memory = sum(part.columns.nbytes for part in self._parts if not part.is_on_disk)
            self._let_go()

    def _final(self, part: _Part, before: tuple[int, int] | None) -> int:
        """The row up to which nothing can come in between any more."""
        if before is None:
            return len(part.columns)
        start_ns, position = before
        return part.until(start_ns, inclusive=part.position < position)

    def _window(self, stops: list[int]) -> Iterator[MessageColumns]:
        """The next messages of all parts, about `WINDOW_ROWS`, or one whole part if it stands alone."""
        open_parts = [(part, stop) for part, stop in zip(self._parts, stops, strict=True) if stop > part.start]
        if len(open_parts) == 1:
            part, stop = open_parts[0]
            yield part.take(min(stop, part.start + WINDOW_ROWS))
            return
        step = max(WINDOW_ROWS // len(open_parts), 16)
        last_ns = min(int(part.columns.log_time_ns[min(part.start + step, stop) - 1]) for part, stop in open_parts)
        ends = [min(part.until(last_ns, inclusive=True), stop) for part, stop in open_parts]
        if sum(end - part.start for end, (part, _) in zip(ends, open_parts, strict=True)) <= 4 * WINDOW_ROWS:
            yield from interleaved([part.take(end) for end, (part, _) in zip(ends, open_parts, strict=True)])
            return
        before = [part.take(part.until(last_ns, inclusive=False)) for part, _ in open_parts]
        if any(map(len, before)):
            yield from interleaved(before)
        for end, (part, _) in zip(ends, open_parts, strict=True):  # many of one time: in the order of the file
            while part.start < end:
                yield part.take(min(end, part.start + WINDOW_ROWS))

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
