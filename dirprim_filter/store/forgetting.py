"""Taking logs out of a store, and those of another store into it: one commit each."""

from __future__ import annotations

import time
from collections.abc import Sequence
from uuid import uuid4

from dirprim_filter.store.files import Contents, Entry, File
from dirprim_filter.store.store import Store

AT_ONCE = 64
"""Logs whose files are copied before they are committed."""


def forget(store: Store, logs: Sequence[str]) -> list[Entry]:
    """Take logs out: the rest is what it would be had they never been added.

    Raises:
        ValueError: one is not in the store.
        RecordingError: the store cannot be read or written.
    """
    gone: dict[str, Entry] = {}

    def change(contents: Contents) -> tuple[list[File], list[File]]:
        for log in logs:
            if log not in contents.entries:
                raise ValueError(f"{log}: is not in the store; `dirprim store info {store}` lists what is")
            gone[log] = contents.entries[log]
        return [], [file for log in gone for file in contents.files[log]]

    store.commit(change)
    store.tidy()
    return list(gone.values())


def merge(store: Store, other: Store) -> int:
    """Add all logs of another store; -> how many are new.

    Raises:
        ValueError: its logs were read otherwise, are in another frame, or one is another version of one here.
        RecordingError: a store cannot be read or written, or the other one is damaged.
    """
    store.check_config(other.config)
    store.check_frame(str(other), other.frame)
    theirs = other.contents().entries
    ours = store.contents().entries
    for log, entry in theirs.items():
        if log in ours and ours[log].recording != entry.recording:
            raise ValueError(f"{log}: the stores hold two versions of it; forget one of them first")
    new = [entry for log, entry in theirs.items() if log not in ours]
    for i in range(0, len(new), AT_ONCE):
        copies = [file for entry in new[i : i + AT_ONCE] for file in _copied(store, other, entry)]

        def change(contents: Contents, copies: list[File] = copies) -> tuple[list[File], list[File]]:
            return [file for file in copies if file.log not in contents.entries], []

        store.commit(change)
    return len(new)


def _copied(store: Store, other: Store, entry: Entry) -> list[File]:
    """A log's files, as they are."""
    added, copies = f"{time.time_ns():020d}-{uuid4().hex}", []
    for file in entry.files:
        other.read(file)  # raises where it is damaged: that is not to be spread
        path = f"rows/{uuid4().hex}-{file.digest}.parquet"
        store.put(path, other.get(file.path) or b"")
        copies.append(file._replace(path=path, added=added))
    return copies
