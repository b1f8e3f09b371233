"""The bytes of a log's file, read by place: of a file, of a live pipe as far as they have come, of a URL by blocks."""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable, Iterator
from typing import BinaryIO

from dirprim_filter.recording.container.errors import RecordingError

WINDOW_BYTES = 1 << 16
"""Short reads are served from a window of this size."""
BLOCK_BYTES = 1 << 20
"""Long ones that are only looked through come in blocks."""


class FileBytes:
    """An open file that may be cut short while it is read: what is read of it is then short too.

    Args:
        number: of the open file, which this one closes.

    Attributes:
        is_live: it grows until its end has come.
        is_remote: what is not read is not fetched.
    """

    is_live = is_remote = False

    def __init__(self, number: int) -> None:
        self._number = number
        self._size = os.fstat(number).st_size
        self._at, self._window = 0, b""

    def __len__(self) -> int:
        return self._size

    def has(self, end: int) -> bool:
        """Whether there are so many bytes; of a live pipe once that is known."""
        return end <= min(os.fstat(self._number).st_size, self._size)

    def read(self, start: int, stop: int) -> bytes:
        """The bytes between two places, as far as there are any."""
        return self._there(start, min(stop, self._size))

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
            self._at, self._window, i = at, self._ahead(at, n), 0
        return self._window[i:]

    def _ahead(self, at: int, n: int) -> bytes:
        return self.read(at, at + max(n, WINDOW_BYTES))

    def blocks(self, start: int = 0, stop: int | None = None) -> Iterator[bytes]:
        """The bytes between two places, some at a time."""
        end = len(self) if stop is None else stop
        return (self.read(at, min(at + BLOCK_BYTES, end)) for at in range(start, end, BLOCK_BYTES))

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

    def __del__(self) -> None:
        self.close()


class PipeBytes(FileBytes):
    """What has come of a live pipe.

    Args:
        number: of the open file that it is copied to.
        wait: until so many bytes have come, or no more will.
    """

    is_live = True

    def __init__(self, number: int, wait: Callable[[int], None]) -> None:
        super().__init__(number)
        self._wait = wait

    def __len__(self) -> int:
        self._wait(1 << 63)
        return os.fstat(self._number).st_size

    def has(self, end: int) -> bool:
        """As of a file, once it is known."""
        self._wait(end)
        return end <= os.fstat(self._number).st_size

    def read(self, start: int, stop: int) -> bytes:
        """As of a file, once they have come."""
        self._wait(stop)
        return self._there(start, stop)

    def _ahead(self, at: int, n: int) -> bytes:
        self._wait(at + n)
        return self._there(at, at + max(n, WINDOW_BYTES))


class RemoteBytes(FileBytes):
    """A file elsewhere, in blocks.

    Args:
        url: what the user calls it.
        file: as fsspec opened it.
    """

    is_remote = True

    def __init__(self, url: str, file: BinaryIO) -> None:
        self._url, self._file = url, file
        self._number, self._size = -1, file.seek(0, os.SEEK_END)
        self._at, self._window = 0, b""

    def has(self, end: int) -> bool:
        """Whether there are so many bytes."""
        return end <= self._size

    def _there(self, start: int, stop: int) -> bytes:
        try:
            self._file.seek(start)
            return bytes(self._file.read(max(stop - start, 0)))
        except Exception as error:  # of the kind of the file system's own package
            why = str(error) or type(error).__name__
            raise RecordingError(f"{self._url}: expected its bytes {start} to {stop}: {why}; try again") from error

    def _ahead(self, at: int, n: int) -> bytes:
        return self.read(at, at + n)  # blocks are at hand
