"""What came of a log, left in the store until the manifest has it: a log that was finished is not read again.

A worker may die, or everything may, after a log was summarised and before it was counted. Nothing counts by its
receipt alone: it says what the manifest's entry will be, and spares reading the log.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple, Self

from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.store.log_files import LogFile
from dirprim_filter.store.manifest import Entry, new_file


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

    def leave(self, folder: Path) -> None:
        """Write it, in the place of what was left of this log; of one that cannot be counted nothing is."""
        if self.entry is None:
            return
        folder.mkdir(exist_ok=True)  # stores older than receipts have none
        with new_file(folder / Entry.name_of(self.log.url)) as file:
            file.write(json.dumps({"entry": asdict(self.entry), "frame": self.frame}, sort_keys=True).encode())

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read one.

        Raises:
            RecordingError: the file holds no receipt.
        """
        try:
            said = json.loads(path.read_bytes())
            entry, frame = Entry(**said["entry"]), str(said["frame"])
        except (ValueError, TypeError, KeyError) as error:
            raise RecordingError(
                f"{path}: expected what came of a log, got {error}; delete it, and add its log again"
            ) from error
        return cls(LogFile(url=entry.url, size=entry.size, mark=entry.mark), entry, frame, "")
