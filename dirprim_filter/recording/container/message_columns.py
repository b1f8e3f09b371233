"""The messages of one chunk as columns: their times and where their data stand, without a Python object for each."""

from __future__ import annotations

import mmap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from io import BytesIO
from itertools import repeat
from operator import getitem
from typing import Any, BinaryIO, Self

import numpy as np

from dirprim_filter.recording.container._kernels import gather
from dirprim_filter.recording.container.records import Bytes, Channel, Message
from dirprim_filter.recording.container.source import let_go
from tessellation.arrays import AnyArray

SHORT_BYTES = 1 << 11
"""Messages longer than this on average are not copied to be read: that would cost more than it saves."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageColumns:
    """Some messages of a log, sorted by log time, stably.

    Attributes:
        log_time_ns: (n,) uint64.
        publish_time_ns: (n,) uint64.
        sequence: (n,) uint32.
        channel: (n,) int32, index into the scan's list of channels.
        start: (n,) int64, first byte of the data in `contents`.
        stop: (n,) int64, the byte after them.
        contents: what the data are slices of.
    """

    log_time_ns: AnyArray
    publish_time_ns: AnyArray
    sequence: AnyArray
    channel: AnyArray
    start: AnyArray
    stop: AnyArray
    contents: Bytes

    def __len__(self) -> int:
        return len(self.log_time_ns)

    def __getitem__(self, rows: slice | AnyArray) -> Self:
        return type(self)(**{name: column[rows] for name, column in self._columns().items()}, contents=self.contents)

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

    def messages(self, channels: list[Channel]) -> Iterator[Message]:
        """The messages in the order of these columns."""
        return _made([self], slice(None), channels)

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
        at, again = 0, {}
        for name, column in columns.items():
            again[name] = np.frombuffer(mapped, column.dtype, len(column), at)
            at += _padded(column.nbytes)
        return type(self)(**again, contents=mapped if own else self.contents)

    def let_go(self) -> None:
        """What is on disk leaves this process's memory until it is read again."""
        if isinstance(self.contents, mmap.mmap):
            let_go(self.contents, 0, len(self.contents))

    def _columns(self) -> dict[str, AnyArray]:
        return {f.name: getattr(self, f.name) for f in fields(self)[:-1]}


def interleaved(parts: Sequence[MessageColumns], channels: list[Channel]) -> Iterator[Message]:
    """The messages of several parts in order of log time; those of one time in the order of the parts."""
    return _made(parts, np.argsort(np.concatenate([part.log_time_ns for part in parts]), kind="stable"), channels)


def _made(parts: Sequence[MessageColumns], order: AnyArray | slice, channels: list[Channel]) -> Iterator[Message]:
    """The messages of all parts in an order, made one by one, without a step of Python for each.

    Many tuples at a time would keep the garbage collector busy.
    """
    told = [
        np.concatenate([getattr(part, name) for part in parts])[order].tolist()
        for name in ("log_time_ns", "publish_time_ns", "sequence", "channel")
    ]
    of = map(channels.__getitem__, told.pop())
    return map(tuple.__new__, repeat(Message), zip(*told, of, _data(parts, order), strict=True))


def _data(parts: Sequence[MessageColumns], order: AnyArray | slice) -> Iterator[bytes]:
    """The messages' data in an order.

    Short ones are first put side by side: read one after the other they need no slice, which saves half of the time.
    """
    length = np.concatenate([part.stop - part.start for part in parts])
    if length.sum() > SHORT_BYTES * length.size:
        part_of = np.repeat(np.arange(len(parts)), [len(part) for part in parts])[order].tolist()
        start, stop = (
            np.concatenate([getattr(part, at) for part in parts])[order].tolist() for at in ("start", "stop")
        )
        contents: list[Any] = [part.contents for part in parts]
        return map(getitem, map(contents.__getitem__, part_of), map(slice, start, stop))
    lengths = length[order]
    at = np.empty_like(length)
    at[order] = np.cumsum(lengths) - lengths
    beside = bytearray(int(lengths.sum()))
    out, first = np.frombuffer(beside, np.uint8), 0
    for part in parts:
        gather(np.frombuffer(part.contents, np.uint8), part.start, part.stop, at[first : first + len(part)], out)
        first += len(part)
    return map(BytesIO(beside).read, lengths.tolist())


def _padded(n_bytes: int, to: int = 8) -> int:
    return n_bytes + -n_bytes % to
