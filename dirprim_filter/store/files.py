"""The files of a store, and the logs that they are of: as the transaction log of its table says, whoever wrote it."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from typing import Any, NamedTuple

import pyarrow as pa

from dirprim_filter.store.blocks import Block
from dirprim_filter.store.rows import SCHEMA

PARTITIONS = ("log", "mark", "recording", "added", "status", "block", "halo")
COLUMNS = pa.schema([*SCHEMA, *((name, pa.bool_() if name == "halo" else pa.string()) for name in PARTITIONS)])
"""Of the table."""
PATH = re.compile(r"rows/[0-9a-f]{32}-([0-9a-f]{64})\.parquet")
FIT = re.compile(r"_fits/-?\d{1,6}_-?\d{1,6}/[0-9a-f]{64}\.(?:arrow|mcap)")
"""As a store writes them: names of others are left alone."""
DIGEST = re.compile("[0-9a-f]{64}")


class File(NamedTuple):
    """Some rows of a log, and what is known of it."""

    path: str
    size: int  # bytes
    log: str  # URL or absolute path
    mark: str  # its size, and its ETag or time of change
    recording: str  # `StoredRows.digest`
    added: str  # a number of its own each time that the log was added
    status: str  # "whole" or "damaged"
    block: Block
    halo: bool  # of rows around the block, which another file has inside
    n_rows: int
    last_track: int
    start_ms: int
    end_ms: int

    @property
    def digest(self) -> str:
        """SHA-256 of what it holds."""
        found = PATH.fullmatch(self.path)
        return found[1] if found else ""


class Entry(NamedTuple):
    """A log that was added."""

    log: str
    mark: str
    recording: str
    status: str
    files: tuple[File, ...]

    @property
    def n_rows(self) -> int:
        """How many rows it has in the store."""
        return sum(file.n_rows for file in self.files if not file.halo)

    @property
    def n_vehicles(self) -> int:
        """In them."""
        return max(file.last_track for file in self.files) + 1

    @property
    def start_ms(self) -> int:
        """Time of the first row."""
        return min(file.start_ms for file in self.files)

    @property
    def end_ms(self) -> int:
        """Time of the last."""
        return max(file.end_ms for file in self.files)

    @property
    def size(self) -> int:
        """Bytes."""
        return sum(file.size for file in self.files)


class Contents(NamedTuple):
    """What a table held at one time."""

    entries: dict[str, Entry]  # by their logs, in order
    damaged: list[str]  # what of the transaction log is no file of a store
    files: dict[str, list[File]]  # of each log all, those too of two who added it at once

    def recordings(self) -> list[Entry]:
        """An entry of each recording, in order of these: a log that was copied counts once."""
        by_recording = {entry.recording: entry for entry in reversed(self.entries.values())}
        return [by_recording[recording] for recording in sorted(by_recording)]


def added_action(file: File, now_ms: int) -> Any:
    """As the transaction log takes it."""
    from deltalake.transaction import AddAction  # noqa: PLC0415 (an extra)

    partition = {name: str(getattr(file, name)) for name in PARTITIONS} | {"halo": str(file.halo).lower()}
    low, high = {"t_ms": file.start_ms}, {"t_ms": file.end_ms, "track": file.last_track}
    statistics = {"numRecords": file.n_rows, "minValues": low, "maxValues": high, "nullCount": {}}
    return AddAction(file.path, file.size, partition, now_ms, True, json.dumps(statistics))


def contents_of(table: Any, name: str) -> Contents:
    """Of files: by their logs, of each as it was added last."""
    found: defaultdict[str, list[File]] = defaultdict(list)
    damaged = []
    for action in pa.table(table.get_add_actions(flatten=True)).to_pylist():
        try:
            file = _file(action)
        except (ValueError, TypeError, KeyError) as error:
            damaged.append(f"{name}: {action.get('path')}: no file of a store: {error}")
        else:
            found[file.log].append(file)
    entries = {}
    for log in sorted(found):
        last = max(file.added for file in found[log])
        files = tuple(sorted((f for f in found[log] if f.added == last), key=lambda file: (file.block, file.halo)))
        entries[log] = Entry(log, files[0].mark, files[0].recording, files[0].status, files)
    return Contents(entries, damaged, found)


def _file(action: dict[str, Any]) -> File:
    """Of an action of the transaction log, whoever wrote it."""
    path, of = action["path"], {name: action[f"partition.{name}"] for name in PARTITIONS}
    if not PATH.fullmatch(path) or not all(isinstance(of[name], str) for name in PARTITIONS if name != "halo"):
        raise ValueError("expected a name with the hash of what the file holds, and its log")
    if not DIGEST.fullmatch(of["recording"]):
        raise ValueError(f"expected the hash of a recording, got {of['recording']!r}")
    numbers = [action[name] for name in ("size_bytes", "num_records", "max.track", "min.t_ms", "max.t_ms")]
    if not all(type(number) is int for number in numbers):
        raise ValueError(f"expected whole numbers of rows, vehicles and times, got {numbers}")
    return File(
        path, numbers[0], of["log"], of["mark"], of["recording"], of["added"], of["status"],
        Block.parse(of["block"]), bool(of["halo"]), *numbers[1:],
    )  # fmt: skip
