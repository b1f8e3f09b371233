"""Messages as columns: their times and where their data stand; and chunks that overlap in time, merged into one order.

What lies before the start of the next chunk is final and goes out, the rest is held: as sorted runs, of which two that
are about as large become one, so that of n chunks few runs stand beside each other. Large ones lie on disk.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from itertools import repeat
from typing import Any, Self, cast

import numpy as np

from dirprim_filter.arrays import AnyArray
from dirprim_filter.recording.container._kernels import gather
from dirprim_filter.recording.container.records import Channel, Message
from dirprim_filter.recording.container.temporary_copy import Copy


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageColumns:
    """Some messages of a log, sorted by log time, stably.

    Attributes:
        log_time_ns: (n,) uint64.
        publish_time_ns: (n,) uint64.
        sequence: (n,) uint32.
        channel: (n,) int32, index into `channels`.
        start: (n,) int64, first byte of the data in `contents`.
        stop: (n,) int64, the byte after them.
        position: (n,) int32, of the chunk in the log that each is of.
        contents: what the data are slices of.
        channels: of the log; the list grows as more are met.
    """

    log_time_ns: AnyArray
    publish_time_ns: AnyArray
    sequence: AnyArray
    channel: AnyArray
    start: AnyArray
    stop: AnyArray
    position: AnyArray
    contents: bytes
    channels: list[Channel]

    def __len__(self) -> int:
        return len(self.log_time_ns)

    def __getitem__(self, rows: slice | AnyArray) -> Self:
        columns: dict[str, Any] = {name: column[rows] for name, column in self._columns().items()}
        return replace(self, **columns)

    def sorted(self) -> Self:
        """The same in order of log time; those of one time keep their order."""
        times = self.log_time_ns
        if (times[1:] >= times[:-1]).all():
            return self
        return self[np.argsort(times, kind="stable")]

    def compact(self) -> Self:
        """The same to be kept: contents of which these messages are a part, as beside images, go."""
        is_small = 2 * int((self.stop - self.start).sum()) < len(self.contents)
        return cast("Self", gathered([self])) if is_small else self

    @property
    def first_channel(self) -> Channel:
        """That of the first message."""
        return self.channels[int(self.channel[0])]

    @property
    def topic(self) -> AnyArray:
        """(n,) str, of each message."""
        return self.by_channel(lambda channel: channel.topic)

    def by_channel(self, of: Callable[[Channel], Any]) -> AnyArray:
        """(n,) what each message's channel has; only those that these messages are of are asked."""
        counts = np.bincount(self.channel)
        used = np.flatnonzero(counts)
        values = np.array([of(self.channels[i]) for i in used.tolist()])
        counts[used] = np.arange(used.size)
        return values[counts[self.channel]]

    def messages(self) -> Iterator[Message]:
        """The messages in the order of these columns, made one by one, without a step of Python for each.

        Many tuples at a time would keep the garbage collector busy.
        """
        whole = (self.log_time_ns, self.publish_time_ns, self.sequence)
        of = map(self.channels.__getitem__, self.channel.tolist())
        data = map(self.contents.__getitem__, map(slice, self.start.tolist(), self.stop.tolist()))
        columns = zip(*(column.tolist() for column in whole), of, data, strict=True)
        return map(tuple.__new__, repeat(Message), columns)

    @classmethod
    def concatenated(cls, parts: Sequence[Self]) -> Self:
        """The rows of parts of one iteration, without their contents."""
        columns: dict[str, Any] = {
            n: np.concatenate([part._columns()[n] for part in parts]) for n in parts[0]._columns()
        }
        return replace(parts[0], **columns, contents=b"")

    def _columns(self) -> dict[str, AnyArray]:
        return {f.name: getattr(self, f.name) for f in fields(self)[:-2]}


def gathered(parts: Sequence[MessageColumns], *, in_order: bool = False) -> MessageColumns:
    """The messages of all parts one after the other, their data side by side.

    Args:
        parts: of one iteration.
        in_order: of log time, and of one time in the order of the log, instead.
    """
    rows = MessageColumns.concatenated(parts)
    stop = np.cumsum(rows.stop - rows.start)
    at = stop - (rows.stop - rows.start)
    if in_order:
        order = np.argsort(rows.log_time_ns, kind="stable")
        time, position = rows.log_time_ns[order], rows.position[order]
        if ((np.diff(position) < 0) & (time[1:] == time[:-1])).any():
            order = np.lexsort((rows.position, rows.log_time_ns))
        rows = rows[order]
        stop = np.cumsum(rows.stop - rows.start)
        at[order] = stop - (rows.stop - rows.start)
    out, first = np.empty(int(stop[-1]) if len(rows) else 0, np.uint8), 0
    for part in parts:
        gather(np.frombuffer(part.contents, np.uint8), part.start, part.stop, at[first : first + len(part)], out)
        first += len(part)
    return replace(rows, start=stop - (rows.stop - rows.start), stop=stop, contents=out.tobytes())


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
    copy: Copy | None = None
    start: int = 0

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
        if self.copy is None or not len(rows):
            return rows
        first = int(rows.start[0])
        contents = os.pread(self.copy.file.fileno(), int(rows.stop[-1]) - first, first)
        return replace(rows, start=rows.start - first, stop=rows.stop - first, contents=contents)


class TimeMerge:
    """Takes chunks in order of their start time, gives messages in order of log time."""

    def __init__(self) -> None:
        self._runs: list[_Run] = []

    def hold(self, columns: MessageColumns) -> None:
        """Keep the messages of a chunk."""
        runs = self._runs
        runs.append(_Run(columns.compact()))
        while len(runs) > 1 and runs[-2].n_bytes <= 2 * runs[-1].n_bytes:
            runs[-2:] = [_joined(runs[-2:])]

    def release(self, before: Key | None) -> Iterator[MessageColumns]:
        """What comes before all that is not yet held: before a chunk of that start time and position; None: all."""
        yield from _windows(self._runs, before)
        self._runs = [run for run in self._runs if run.start < len(run.columns)]


def _windows(runs: Sequence[_Run], before: Key | None) -> Iterator[MessageColumns]:
    """The messages of all runs in order, some at a time."""
    while parts := [(run, stop) for run in runs if (stop := run.until(before)) > run.start]:
        if len(parts) == 1 and parts[0][0].copy is None:
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
    copy, parts = Copy("chunks that overlap in time"), []
    for window in _windows(runs, None):
        part, at = gathered([window]), copy.tell()
        parts.append(replace(part, start=part.start + at, stop=part.stop + at, contents=b""))
        copy.write(part.contents)
    return _Run(MessageColumns.concatenated(parts), copy)
