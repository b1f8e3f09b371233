"""The messages of one chunk as columns: their times and where their data stand, without a Python object for each."""

from __future__ import annotations

import mmap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from io import BytesIO
from itertools import repeat
from typing import Any, BinaryIO, Self, cast

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
        channels: of the iteration that these are of; the list grows as it meets more.
    """

    log_time_ns: AnyArray
    publish_time_ns: AnyArray
    sequence: AnyArray
    channel: AnyArray
    start: AnyArray
    stop: AnyArray
    position: AnyArray
    contents: bytes | mmap.mmap
    channels: list[Channel]

    def __len__(self) -> int:
        return len(self.log_time_ns)

    def __getitem__(self, rows: slice | AnyArray) -> Self:
        columns: dict[str, Any] = {name: column[rows] for name, column in self._columns().items()}
        return replace(self, **columns)

    @property
    def nbytes(self) -> int:
        """Memory that it holds; contents that are a part of a file count nothing."""
        held = len(self.contents) if isinstance(self.contents, bytes) else 0
        return held + sum(column.nbytes for column in self._columns().values())

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
            return map(cast("Any", self.contents).__getitem__, slices)
        beside = self if (self.start[1:] == self.stop[:-1]).all() else gathered([self], slice(None))
        data = BytesIO(beside.contents)
        data.seek(int(beside.start[0]) if len(beside) else 0)
        return map(data.read, length.tolist())

    def spilled(self, file: BinaryIO) -> Self:
        """The same on disk: appended to `file` and mapped, so that the system may take the memory back."""
        columns = self._columns()
        own = self.contents if isinstance(self.contents, bytes) else b""
        head = sum(_padded(column.nbytes) for column in columns.values())
        base = _padded(file.seek(0, 2), mmap.ALLOCATIONGRANULARITY)
        file.seek(base)
        for name, column in columns.items():
            shifted = column + head if own and name in ("start", "stop") else np.ascontiguousarray(column)
            file.write(shifted.tobytes().ljust(_padded(column.nbytes), b"\0"))
        file.write(own)
        file.flush()
        mapped = mmap.mmap(file.fileno(), head + len(own), access=mmap.ACCESS_READ, offset=base)
        at, again = 0, dict[str, Any]()
        for name, column in columns.items():
            again[name] = np.frombuffer(mapped, column.dtype, len(column), at)
            at += _padded(column.nbytes)
        return replace(self, **again, contents=mapped if own else self.contents)

    def let_go(self) -> None:
        """What is on disk leaves this process's memory until it is read again."""
        if isinstance(self.contents, mmap.mmap) and hasattr(self.contents, "madvise"):
            self.contents.madvise(mmap.MADV_DONTNEED)

    def _columns(self) -> dict[str, AnyArray]:
        return {f.name: getattr(self, f.name) for f in fields(self)[:-2]}


def gathered(parts: Sequence[MessageColumns], order: AnyArray | slice) -> MessageColumns:
    """The messages of all parts in an order, their data side by side in it."""
    columns = {
        name: np.concatenate([getattr(part, name) for part in parts])[order]
        for name in ("log_time_ns", "publish_time_ns", "sequence", "channel", "position")
    }
    length = np.concatenate([part.stop - part.start for part in parts])
    lengths = length[order]
    stop = np.cumsum(lengths)
    at = np.empty_like(length)
    at[order] = stop - lengths
    beside = bytearray(int(lengths.sum()))
    out, first = np.frombuffer(beside, np.uint8), 0
    for part in parts:
        gather(np.frombuffer(part.contents, np.uint8), part.start, part.stop, at[first : first + len(part)], out)
        first += len(part)
    return MessageColumns(
        **columns, start=stop - lengths, stop=stop, contents=cast("bytes", beside), channels=parts[0].channels
    )


def ordered(parts: Sequence[MessageColumns]) -> AnyArray:
    """(n,) the rows of all parts in order of log time, and of one time in the order of the log."""
    time, position = (np.concatenate([getattr(part, name) for part in parts]) for name in ("log_time_ns", "position"))
    order = np.argsort(time, kind="stable")
    back = (time[order[1:]] == time[order[:-1]]) & (position[order[1:]] < position[order[:-1]])
    return np.lexsort((position, time)) if back.any() else order


def interleaved(parts: Sequence[MessageColumns]) -> Iterator[MessageColumns]:
    """The messages of several parts in order of log time; those of one time in the order of the log.

    Long ones stay where they are: each run out of one part comes by itself.
    """
    order = ordered(parts)
    n_bytes = sum(int((part.stop - part.start).sum()) for part in parts)
    if n_bytes <= SHORT_BYTES * order.size:
        yield gathered(parts, order)
        return
    part_of = np.repeat(np.arange(len(parts)), [len(part) for part in parts])[order]
    done = [0] * len(parts)
    for run in np.split(part_of, np.flatnonzero(np.diff(part_of)) + 1):
        part = int(run[0])
        yield parts[part][done[part] : done[part] + run.size]
        done[part] += run.size


def _padded(n_bytes: int, to: int = 8) -> int:
    return n_bytes + -n_bytes % to
