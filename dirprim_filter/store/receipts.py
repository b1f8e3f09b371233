"""What came of a log, left in the store until the manifest has it: a log that was finished is not read again.

A worker may die, or everything may, after a log was summarised and before it was counted. Nothing counts by its
receipt alone: it says what the manifest's entry will be, and spares reading the log.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import NamedTuple, Self

from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.store.log_files import LogFile
from dirprim_filter.store.manifest import Entry

RECEIPTS = "receipts"
"""The folder of them."""


class Receipt(NamedTuple):
    """What came of a log.

    Attributes:
        log: it.
        entry: for the manifest; None where the log cannot be counted.
        frame: of its positions.
        error: why it cannot, in one line; empty where it can.
    """

    log: LogFile
    entry: Entry | None
    frame: str
    error: str

    @staticmethod
    def file_of(url: str) -> str:
        """Of a log in a store."""
        return f"{RECEIPTS}/{Entry.name_of(url)}"

    def to_json(self) -> bytes:
        """What its file holds; there is none of a log that cannot be counted."""
        if self.entry is None:
            raise ValueError("receipt: expected one of a log that can be counted")
        return json.dumps({"entry": asdict(self.entry), "frame": self.frame}, sort_keys=True).encode()

    @classmethod
    def from_json(cls, data: bytes, file: str) -> Self:
        """Of what its file holds.

        Raises:
            RecordingError: the file holds no receipt.
        """
        try:
            said = json.loads(data)
            entry, frame = Entry(**said["entry"]), str(said["frame"])
        except (ValueError, TypeError, KeyError) as error:
            raise RecordingError(
                f"{file}: expected what came of a log, got {error}; delete it, and add its log again"
            ) from error
        return cls(LogFile(url=entry.url, size=entry.size, mark=entry.mark), entry, frame, "")
