"""Logs that were compressed as whole files, such as rosbag2's `.mcap.zstd`: decompressed to a temporary copy."""

from __future__ import annotations

import gzip
import io
import logging
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import zstandard

from dirprim_filter.recording.container.budget import most_bytes
from dirprim_filter.recording.container.errors import RecordingError
from dirprim_filter.recording.container.temporary_copy import Copy

if TYPE_CHECKING:
    from dirprim_filter.recording.container.file_bytes import FileBytes

logger = logging.getLogger(__name__)

GZIP = b"\x1f\x8b"
"""What files of gzip begin with; others are of zstd."""
BLOCK_BYTES = 1 << 20
"""So many are decompressed at a time."""


def decompressed(file: Path, bytes_of: FileBytes, opening: bytes) -> Copy:
    """The contents of a file that begins as those of zstd or gzip do; of one that is cut or damaged what comes before.

    Raises:
        RecordingError: it unpacks to far more than logs do.
        NoRoomError: there is none for the copy.
    """
    return Copy(str(file), _blocks(file, bytes_of, opening))


def _blocks(file: Path, bytes_of: FileBytes, opening: bytes) -> Iterator[bytes]:
    source, most = io.BufferedReader(_Stream(bytes_of)), most_bytes(len(bytes_of))
    reader: Any = gzip.GzipFile(fileobj=source)
    if not opening.startswith(GZIP):
        reader = zstandard.ZstdDecompressor().stream_reader(source, read_across_frames=True)
    size = 0
    try:
        while block := reader.read1(BLOCK_BYTES):
            size += len(block)
            if size > most:
                way = "decompress it yourself if that is right"
                raise RecordingError(f"{file}: expected a log of at most {most} bytes inside, got more; {way}")
            yield block
    except (zstandard.ZstdError, EOFError, gzip.BadGzipFile, zlib.error) as error:
        logger.warning("%s: its compression is damaged, the first %d bytes of the log are read: %s", file, size, error)


class _Stream(io.RawIOBase):
    """Bytes of a file from their beginning on."""

    def __init__(self, bytes_of: FileBytes) -> None:
        self._bytes_of, self._at = bytes_of, 0

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        data = self._bytes_of.read(self._at, self._at + len(buffer))
        buffer[: len(data)] = data
        self._at += len(data)
        return len(data)
