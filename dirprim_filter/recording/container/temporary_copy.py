"""Temporary files without a name, of which nothing is left when the process is killed.

They hold what has come of a pipe, or the contents of a log that was compressed as a whole file, such as `.mcap.zstd`.
"""

from __future__ import annotations

import gzip
import os
import sys
import tempfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import zstandard

from dirprim_filter.partial_file import NO_ROOM
from dirprim_filter.recording.container.budget import most_bytes
from dirprim_filter.recording.container.errors import GZIP, NoRoomError, RecordingError, warn
from dirprim_filter.recording.container.file_bytes import BLOCK_BYTES, FileBytes

READ_AT_ONCE = 1 << 22


class Copy:
    """A temporary file of blocks; `name` is what the user calls it."""

    _need: Callable[[int, int], None] | None = None
    is_remote = False

    def __init__(self, name: str, blocks: Iterable[bytes] = ()) -> None:
        self.file = tempfile.TemporaryFile(prefix="dirprim-", buffering=0)  # noqa: SIM115
        self.tell, self.flush = self.file.tell, self.file.flush
        self._name = name
        for block in blocks:
            self.write(block)

    def write(self, block: bytes | memoryview) -> int:
        """All of it.

        Raises:
            NoRoomError: there is none.
        """
        left = memoryview(block)
        try:
            while left:
                left = left[self.file.write(left) :]
        except OSError as error:
            if error.errno not in NO_ROOM:
                raise
            raise NoRoomError(
                f"{self._name}: expected to copy it to {tempfile.gettempdir()}: {error.strerror}; make room there, or "
                "set TMPDIR to a folder that has some"
            ) from error
        return len(block)

    def bytes_of(self, *, live: bool) -> FileBytes:
        """What it holds; of a pipe that is `live` as far as it has come. It stays for as long as one is open."""
        return FileBytes(os.dup(self.file.fileno()), self._need, is_remote=self.is_remote)

    def __del__(self) -> None:
        self.file.close()


class Pipe(Copy):
    """What has come of it."""

    def __init__(self, name: str, stream: Any) -> None:
        super().__init__(name)
        self._stream, self._size = stream, 0.0

    def _need(self, _: int, stop: int) -> None:
        """So many bytes have come, or no more will."""
        while self._size < stop:
            block = self._stream.read1(READ_AT_ONCE)
            self._size += len(block) if block else float("inf")
            self.write(block)
            if not block and (sys.stdin is None or self._stream is not sys.stdin.buffer):
                self._stream.close()

    def bytes_of(self, *, live: bool) -> FileBytes:
        """See `Copy`."""
        if live:
            return FileBytes(os.dup(self.file.fileno()), self._need, is_live=True)
        self._need(0, 1 << 63)
        return super().bytes_of(live=False)


def decompressed(file: Path, bytes_of: FileBytes, opening: bytes) -> Iterator[bytes]:
    """The contents of a file that begins as those of zstd or gzip do; of one that is cut or damaged what comes before.

    Raises:
        RecordingError: it unpacks to far more than logs do.
    """
    size, most = 0, most_bytes(len(bytes_of))
    try:
        with bytes_of.stream() as source:
            reader: Any = gzip.GzipFile(fileobj=source)
            if not opening.startswith(GZIP):
                reader = zstandard.ZstdDecompressor().stream_reader(source, read_across_frames=True)
            while block := reader.read1(BLOCK_BYTES):
                size += len(block)
                if size > most:
                    way = "decompress it yourself if that is right"
                    raise RecordingError(f"{file}: expected a log of at most {most} bytes inside, got more; {way}")
                yield block
    except (zstandard.ZstdError, EOFError, gzip.BadGzipFile, zlib.error) as error:
        warn(file, f"its compression is damaged, the first {size} bytes of the log are read: {error}")
