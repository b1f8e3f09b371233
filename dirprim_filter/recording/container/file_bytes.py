"""The bytes of an open file, by their places."""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable, Iterator
from io import BufferedReader

WINDOW_BYTES = 1 << 16
"""Short reads are served from a window of this size."""
BLOCK_BYTES = 1 << 20
"""Long ones that are only looked through come in blocks."""


class FileBytes:
    """An open file that may be cut short while it is read: what is read of it is then short too.

    Args:
        number: of the open file, which this one closes.
        need: called with the first byte that is about to be read and the one after the last, of a copy that is filled
            as it is read.
        is_live: it grows until its end has come.
        is_remote: what is not read is not fetched.
    """

    def __init__(
        self, number: int, need: Callable[[int, int], None] | None = None, *, is_live: bool = False,
        is_remote: bool = False,
    ) -> None:  # fmt: skip
        self._number, self._need = number, need or (lambda start, stop: None)
        self.is_live, self.is_remote = is_live, is_remote
        self._size = os.fstat(number).st_size
        self._at, self._window = 0, b""

    def __len__(self) -> int:
        return self._known_to(1 << 63)

    def has(self, end: int) -> bool:
        """Whether there are so many bytes; of a live pipe once that is known."""
        return end <= min(os.fstat(self._number).st_size, self._known_to(end))

    def _known_to(self, end: int) -> int:
        """Its size; of a live pipe so much of it as has come once `end` has."""
        if self.is_live:
            self._need(0, end)
            return os.fstat(self._number).st_size
        return self._size

    def read(self, start: int, stop: int) -> bytes:
        """The bytes between two places, as far as there are any."""
        stop = min(stop, self._known_to(stop))
        self._need(start, stop)
        return self._there(start, stop)

    def _there(self, start: int, stop: int) -> bytes:
        data = os.pread(self._number, max(stop - start, 0), start) if start < 1 << 63 else b""
        while (at := start + len(data)) < stop and (more := os.pread(self._number, stop - at, at)):
            data += more  # 2 GiB come at a time
        return data

    def peek(self, at: int, n: int) -> bytes:
        """The next `n` bytes from a place on, if there are so many."""
        return self.window(at, n)[:n]

    def window(self, at: int, n: int) -> bytes:
        """The next `n` bytes from a place on, if there are so many, and more that are at hand."""
        i = at - self._at
        if i < 0 or i + n > len(self._window):
            ahead = n if self.is_remote else max(n, WINDOW_BYTES)
            stop = min(at + ahead, self._known_to(at + n))
            self._need(at, min(at + n, stop))
            self._at, self._window, i = at, self._there(at, stop), 0
        return self._window[i:]

    def blocks(self, start: int = 0, stop: int | None = None) -> Iterator[bytes]:
        """The bytes between two places, some at a time."""
        end = len(self) if stop is None else stop
        return (self.read(at, min(at + BLOCK_BYTES, end)) for at in range(start, end, BLOCK_BYTES))

    def stream(self) -> BufferedReader:
        """All of it as a file, from its start on."""
        self._need(0, len(self))
        stream = os.fdopen(os.dup(self._number), "rb")
        stream.seek(0)
        return stream

    def crc(self, start: int, stop: int) -> int:
        """CRC-32 of the bytes between two places."""
        found = 0
        for block in self.blocks(start, stop):
            found = zlib.crc32(block, found)
        return found

    def close(self) -> None:
        """Let go of the file."""
        if self._number >= 0:
            os.close(self._number)
            self._number = -1
            self._need = lambda start, stop: None  # a copy goes with the last of its readers

    def __del__(self) -> None:
        self.close()
