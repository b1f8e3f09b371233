"""A temporary file without a name: nothing is left of it when the process is killed."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable

from dirprim_filter.partial_file import NO_ROOM
from dirprim_filter.recording.container.errors import NoRoomError
from dirprim_filter.recording.container.file_bytes import FileBytes


class Copy:
    """A temporary file of blocks; `name` is what the user calls it."""

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
        return FileBytes(os.dup(self.file.fileno()))

    def __del__(self) -> None:
        self.file.close()
