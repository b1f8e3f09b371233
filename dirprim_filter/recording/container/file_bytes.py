"""A file mapped into memory that may be cut short while it is read."""

from __future__ import annotations

import mmap
import os
from collections.abc import Callable
from typing import SupportsIndex, overload


class FileBytes(mmap.mmap):
    """A file mapped into memory, of which slices are read instead: of a file that is cut meanwhile they are short.

    To touch what is mapped and no longer there ends the process; whoever does asks `has` first.

    Attributes:
        number: of the open file.
        fetch: called with the places of a slice before it is read.
    """

    number = -1
    fetch: Callable[[int, int], None] | None = None

    @overload
    def __getitem__(self, key: SupportsIndex, /) -> int: ...
    @overload
    def __getitem__(self, key: slice, /) -> bytes: ...
    def __getitem__(self, key: SupportsIndex | slice, /) -> int | bytes:
        if not isinstance(key, slice):
            return super().__getitem__(key)
        start, stop, _ = key.indices(len(self))
        if self.fetch:
            self.fetch(start, stop)
        data = os.pread(self.number, max(stop - start, 0), start)
        while start + len(data) < stop and (more := os.pread(self.number, stop - start - len(data), start + len(data))):
            data += more  # 2 GiB come at a time
        return data

    def has(self, end: int) -> bool:
        """Whether the file still has so many bytes."""
        return os.fstat(self.number).st_size >= end

    def close(self) -> None:
        """Let go of the file."""
        super().close()
        if self.number >= 0:
            os.close(self.number)
            self.number = -1

    def __del__(self) -> None:
        self.close()


def let_go(file: mmap.mmap, start: int, end: int) -> None:
    """Pages of the file leave this process's memory until they are read again; else a long log would fill it."""
    first = start - start % mmap.PAGESIZE
    if hasattr(file, "madvise") and end > first:
        file.madvise(mmap.MADV_DONTNEED, first, end - first)
