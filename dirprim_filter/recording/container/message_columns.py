"""The messages of one chunk as columns: their times and where their data stand, without a Python object for each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from io import BytesIO
from itertools import repeat
from typing import Any, Self

import numpy as np

from dirprim_filter.arrays import AnyArray
from dirprim_filter.recording.container._kernels import gather
from dirprim_filter.recording.container.records import Channel, Message

SHORT_BYTES = 1 << 11
"""Messages longer than this on average are not copied to be read: that would cost more than it saves."""


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
        columns = zip(*(column.tolist() for column in whole), of, self._data(), strict=True)
        return map(tuple.__new__, repeat(Message), columns)

    def _data(self) -> Iterator[bytes]:
        """The messages' data.

        Short ones are first put side by side: read one after the other they need no slice, which saves half of the
        time.
        """
        length = self.stop - self.start
        if length.sum() > SHORT_BYTES * length.size:
            slices = map(slice, self.start.tolist(), self.stop.tolist())
            return map(self.contents.__getitem__, slices)
        beside = self if (self.start[1:] == self.stop[:-1]).all() else gathered([self])
        data = BytesIO(beside.contents)
        data.seek(int(beside.start[0]) if len(beside) else 0)
        return map(data.read, length.tolist())

    @classmethod
    def concatenated(cls, parts: Sequence[Self], contents: bytes) -> Self:
        """The rows of parts of one iteration whose data stand in the same contents."""
        columns: dict[str, Any] = {
            n: np.concatenate([part._columns()[n] for part in parts]) for n in parts[0]._columns()
        }
        return replace(parts[0], **columns, contents=contents)

    def _columns(self) -> dict[str, AnyArray]:
        return {f.name: getattr(self, f.name) for f in fields(self)[:-2]}


def gathered(parts: Sequence[MessageColumns], *, in_order: bool = False) -> MessageColumns:
    """The messages of all parts one after the other, their data side by side.

    Args:
        parts: of one iteration.
        in_order: of log time, and of one time in the order of the log, instead.
    """
    rows = MessageColumns.concatenated(parts, b"")
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
