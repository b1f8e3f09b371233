"""The messages of one chunk as columns: their times and where their data stand, without a Python object for each."""

from __future__ import annotations

import mmap
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from itertools import repeat
from operator import getitem
from typing import Any, BinaryIO, Self

import numpy as np

from dirprim_filter.recording.records import Bytes, Channel, Message
from dirprim_filter.recording.source import let_go
from tessellation.arrays import AnyArray


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
        """The messages, made one by one: many tuples at a time would keep the garbage collector busy."""
        *told, channel, start, stop = (column.tolist() for column in self._columns().values())
        return _made(told, map(channels.__getitem__, channel), repeat(self.contents), start, stop)

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


def interleaved(parts: list[MessageColumns], channels: list[Channel]) -> Iterator[Message]:
    """The messages of several parts in order of log time; those of one time in the order of the parts."""
    order = np.argsort(np.concatenate([part.log_time_ns for part in parts]), kind="stable")
    names = [f.name for f in fields(MessageColumns)[:-1]]
    columns = [np.concatenate([getattr(part, name) for part in parts])[order].tolist() for name in names]
    *told, channel, start, stop = columns
    part_of = np.repeat(np.arange(len(parts)), [len(part) for part in parts])[order].tolist()
    contents = [part.contents for part in parts]
    return _made(told, map(channels.__getitem__, channel), map(contents.__getitem__, part_of), start, stop)


def _made(
    told: list[list[int]], channels: Iterable[Channel], contents: Iterable[Any], start: list[int], stop: list[int]
) -> Iterator[Message]:
    """Messages of times and sequence number, channel, and where the data stand; no step of Python for each."""
    data = map(getitem, contents, map(slice, start, stop))
    return map(tuple.__new__, repeat(Message), zip(*told, channels, data, strict=True))


def _padded(n_bytes: int, to: int = 8) -> int:
    return n_bytes + -n_bytes % to
