"""Chunks that overlap in time, merged into one order of log time in bounded memory.

What lies before the start of the next chunk is final and goes out, the rest is held: as sorted runs, of which two that
are about as large become one, so that of n chunks few runs stand beside each other. Large ones lie on disk.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import BinaryIO

import numpy as np

from dirprim_filter.recording.container.message_columns import MessageColumns, gathered

HELD_BYTES = 1 << 24
"""Larger runs lie in temporary files, but for their columns: some 44 bytes for each message."""
WINDOW_BYTES = 1 << 20
"""About so much of several runs is merged at a time."""

Key = tuple[int, int]
"""A log time, and the position of a chunk in the log: of one time, messages come in the order of the file."""


@dataclass(slots=True, eq=False)
class _Run:
    """Messages that are not yet delivered, in order; on disk they stand side by side."""

    columns: MessageColumns
    file: BinaryIO | None = None
    start: int = 0

    def __del__(self) -> None:
        if self.file is not None:
            self.file.close()

    @property
    def n_bytes(self) -> int:
        columns = self.columns
        return int((columns.stop[self.start :] - columns.start[self.start :]).sum())

    def until(self, before: Key | None) -> int:
        """The row after the last one before that time, and of that time before the chunk of that position."""
        columns = self.columns
        if before is None:
            return len(columns)
        time_ns, position = before
        times = columns.log_time_ns
        first, last = (int(np.searchsorted(times, np.uint64(time_ns), side)) for side in ("left", "right"))
        return max(first + int(np.searchsorted(columns.position[first:last], position)), self.start)

    def key(self, row: int) -> Key:
        return int(self.columns.log_time_ns[row]), int(self.columns.position[row])

    def take(self, stop: int) -> MessageColumns:
        rows = self.columns[self.start : stop]
        self.start = stop
        if self.file is None or not len(rows):
            return rows
        first = int(rows.start[0])
        contents = os.pread(self.file.fileno(), int(rows.stop[-1]) - first, first)
        return replace(rows, start=rows.start - first, stop=rows.stop - first, contents=contents)


class TimeMerge:
    """Takes chunks in order of their start time, gives messages in order of log time."""

    def __init__(self) -> None:
        self._runs: list[_Run] = []

    def hold(self, columns: MessageColumns) -> None:
        """Keep the messages of a chunk."""
        runs = self._runs
        runs.append(_Run(columns))
        while len(runs) > 1 and runs[-2].n_bytes <= 2 * runs[-1].n_bytes:
            runs[-2:] = [_joined(runs[-2:])]

    def release(self, before: Key | None) -> Iterator[MessageColumns]:
        """What comes before all that is not yet held: before a chunk of that start time and position; None: all."""
        yield from _windows(self._runs, before)
        self._runs = [run for run in self._runs if run.start < len(run.columns)]


def _windows(runs: Sequence[_Run], before: Key | None) -> Iterator[MessageColumns]:
    """The messages of all runs in order, some at a time."""
    while parts := [(run, stop) for run in runs if (stop := run.until(before)) > run.start]:
        if len(parts) == 1 and parts[0][0].file is None:
            yield parts[0][0].take(parts[0][1])
            return
        n_rows, n_bytes = (sum(of) for of in zip(*((s - r.start, r.n_bytes) for r, s in parts), strict=True))
        step = max(WINDOW_BYTES * n_rows // (n_bytes + 1) // len(parts), 1)
        time_ns, position = min(run.key(min(run.start + step, stop) - 1) for run, stop in parts)
        yield gathered([run.take(min(run.until((time_ns, position + 1)), stop)) for run, stop in parts], in_order=True)


def _joined(runs: Sequence[_Run]) -> _Run:
    """One run of several."""
    if sum(run.n_bytes for run in runs) <= HELD_BYTES:
        return _Run(gathered([run.take(len(run.columns)) for run in runs], in_order=True))
    file, parts = tempfile.TemporaryFile(prefix="dirprim-", buffering=0), []  # noqa: SIM115 - it goes with the run
    for window in _windows(runs, None):
        part, at = gathered([window]), file.tell()
        parts.append(replace(part, start=part.start + at, stop=part.stop + at, contents=b""))
        left = memoryview(part.contents)
        while left:
            left = left[file.write(left) :]
    return _Run(MessageColumns.concatenated(parts, b""), file)
