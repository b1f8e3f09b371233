"""The bytes of a log's file, read by place; of a live pipe as far as they have come."""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable
from pathlib import Path

WINDOW_BYTES = 1 << 16
"""Short reads are served from a window of this size."""
BLOCK_BYTES = 1 << 20
"""Long ones that are only looked through come in blocks."""


class FileBytes:
    """A file that may be cut short while it is read: what is read of it is then short too.

    Args:
        path: the file.
        supply: called with the places of bytes before they are read: fetches them, or waits until they have come or
            will not.
        is_live: it grows until its end has come.
    """

    def __init__(self, path: Path, *, supply: Callable[[int, int], None] | None = None, is_live: bool = False) -> None:
        self._number = os.open(path, os.O_RDONLY)
        self._supply = supply
        self.is_live = is_live
        self._size = os.fstat(self._number).st_size
        self._at, self._window = 0, b""

    def __len__(self) -> int:
        if self.is_live:
            self.has(1 << 63)
            return os.fstat(self._number).st_size
        return self._size

    def has(self, end: int) -> bool:
        """Whether there are so many bytes; of a live pipe once that is known."""
        if self.is_live and self._supply:
            self._supply(0, end)
        return end <= os.fstat(self._number).st_size and (self.is_live or end <= self._size)

    def read(self, start: int, stop: int) -> bytes:
        """The bytes between two places, as far as there are any."""
        if self._supply:
            self._supply(start, stop)
        return self._there(start, stop)

    def peek(self, at: int, n: int) -> bytes:
        """The next `n` bytes from a place on, if there are so many."""
        i = self._hold(at, n)
        return self._window[i : i + n]

    def window(self, at: int, n: int) -> bytes:
        """The next `n` bytes from a place on, if there are so many, and more that are at hand."""
        i = self._hold(at, n)
        return self._window[i:]

    def _hold(self, at: int, n: int) -> int:
        i = at - self._at
        if i < 0 or i + n > len(self._window):
            if self._supply:
                self._supply(at, at + n)
            n_held = max(n, WINDOW_BYTES) if self.is_live or not self._supply else n  # what was not fetched is zeros
            self._at, self._window, i = at, self._there(at, at + n_held), 0
        return i

    def _there(self, start: int, stop: int) -> bytes:
        stop = stop if self.is_live else min(stop, self._size)
        data = os.pread(self._number, max(stop - start, 0), start) if start < 1 << 63 else b""
        while (at := start + len(data)) < stop and (more := os.pread(self._number, stop - at, at)):
            data += more  # 2 GiB come at a time
        return data

    def crc(self, start: int, stop: int) -> int:
        """CRC-32 of the bytes between two places."""
        found = 0
        for at in range(start, stop, BLOCK_BYTES):
            found = zlib.crc32(self.read(at, min(at + BLOCK_BYTES, stop)), found)
        return found

    def close(self) -> None:
        """Let go of the file."""
        if self._number >= 0:
            os.close(self._number)
            self._number = -1

    def __del__(self) -> None:
        if hasattr(self, "_number"):
            self.close()
