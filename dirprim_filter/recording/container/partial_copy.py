"""A remote log copied in parts: blocks come when they are first read, into a sparse file.

The Summary section says where chunks stand, so of a log no more is fetched than is read. Damage in chunks that are not
read is not seen, nor are attachments and metadata; a log without a whole Summary section is to be copied whole.
"""

from __future__ import annotations

from io import FileIO
from pathlib import Path
from typing import Any, NamedTuple

from dirprim_filter.recording.container.errors import RecordingError

SHORT_BYTES = 1 << 20
"""Logs of fewer bytes are copied whole: to ask several times takes longer."""
BLOCK_BYTES = 1 << 16


class NotInPartsError(RecordingError):
    """A log cannot be copied in parts."""


class Remote(NamedTuple):
    """A remote file."""

    files: Any  # fsspec's file system
    path: str
    size: int

    def between(self, start: int, stop: int) -> bytes:
        """Some of its bytes.

        Raises:
            NotInPartsError: other bytes come than those asked for: some servers send all.
            RecordingError: none come.
        """
        try:
            got = bytes(self.files.cat_file(self.path, start=start, end=stop))
        except Exception as error:  # of the kind of the file system's own package
            why = str(error) or type(error).__name__
            raise RecordingError(f"{self.path}: expected its bytes {start} to {stop}: {why}; try again") from error
        if len(got) != stop - start:
            raise NotInPartsError(f"{self.path}: expected {stop - start} bytes, got {len(got)}")
        return got


class PartialCopy:
    """The copy of a remote log.

    Args:
        remote: the log.
        file: empty, and filled.
    """

    def __init__(self, remote: Remote, file: FileIO) -> None:
        self._remote = remote
        self._missing = set(range(-(-remote.size // BLOCK_BYTES)))
        file.truncate(remote.size)

    def fetch(self, path: Path, start: int, stop: int) -> None:
        """Have the bytes between two places; blocks that stand together are asked for at once.

        Raises:
            NotInPartsError: the server sends no parts.
            RecordingError: it does not answer.
        """
        first, last = start // BLOCK_BYTES, -(-stop // BLOCK_BYTES)
        while (first := next((k for k in range(first, last) if k in self._missing), last)) < last:
            end = next((k for k in range(first, last) if k not in self._missing), last)
            data = self._remote.between(first * BLOCK_BYTES, min(end * BLOCK_BYTES, self._remote.size))
            with path.open("r+b", buffering=0) as file:
                file.seek(first * BLOCK_BYTES)
                left = memoryview(data)
                while left:
                    left = left[file.write(left) :]
            self._missing.difference_update(range(first, end))
            first = end
