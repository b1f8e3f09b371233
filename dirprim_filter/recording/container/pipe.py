"""A pipe, or another file that gives its bytes once."""

from __future__ import annotations

import os
import sys
from io import BufferedReader
from typing import Any, cast

from dirprim_filter.recording.container.file_bytes import FileBytes
from dirprim_filter.recording.container.temporary_copy import Copy

READ_AT_ONCE = 1 << 22


class Pipe(Copy):
    """What has come of it."""

    def __init__(self, name: str, stream: Any) -> None:
        super().__init__(name)
        self._stream = cast("BufferedReader", stream)
        self._size: float = 0

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
