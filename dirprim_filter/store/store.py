"""A store of many logs' rows: a Delta table, whose commits take place as a whole or not at all.

Every file of the table holds some rows of one recording, in one block of the ground or in its halo; what else is known
of a log stands in the columns that the table is partitioned by, in its transaction log. So to list ten thousand logs
opens none of their files, and to forget one writes none anew. Files have the SHA-256 of what they hold in their names,
and whatever is read is compared with it.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, Self
from uuid import uuid4

import numpy as np
import pyarrow as pa

from dirprim_filter.origin import Origin
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.reader import ReadOptions
from dirprim_filter.store.blocks import Block, blocks_near
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.files import COLUMNS, PARTITIONS, Contents, File, added_action, contents_of
from dirprim_filter.store.folder import FITS, Folder, address_of, asking, shown
from dirprim_filter.store.rows import StoredRows

MOST_COMMITS = 200
"""Tries, while others commit."""
ORPHANS_NS = 24 * 3600 * 10**9
"""So old a file that was never committed is what a killed process left."""


class DamagedFileError(RecordingError):
    """A file of a store is not what was written."""


class GoneError(RecordingError):
    """A file is no more: another process has taken its log out."""


Change = Callable[[Contents], tuple[Iterable[File], Iterable[File]]]
"""What to add and what to remove."""


@dataclass(frozen=True)
class Store(Folder):
    """A table, by its path or URL.

    Attributes:
        path: of a folder, or a URL of an object store.
        config: how its logs are read.
        frame: of the positions.
    """

    config: StoreConfig
    frame: str

    @classmethod
    def is_at(cls, path: str | Path) -> bool:
        """Whether there is one.

        Raises:
            RecordingError: it cannot be asked.
        """
        ask = address_of(path)
        if Path(ask).is_file():
            return False
        with asking(path) as delta:
            return bool(delta.DeltaTable.is_deltatable(ask))

    @classmethod
    def open(cls, path: str | Path) -> Self:
        """One that is there.

        Raises:
            RecordingError: there is none, or one that cannot be read.
        """
        if not cls.is_at(path):
            raise RecordingError(f"{shown(path)}: expected a store, found none; `dirprim store add` makes one")
        with asking(path) as delta:
            about = delta.DeltaTable(address_of(path)).metadata()
        try:
            config, frame = StoreConfig.from_json(about.description or "")
        except (ValueError, TypeError) as error:
            raise RecordingError(f"{shown(path)}: expected a store, got {error}; add its logs to a new one") from error
        return cls(address_of(path), config, frame)

    @classmethod
    def create(cls, path: str | Path, config: StoreConfig, frame: str) -> Self:
        """A new one; of two who make it at once, one does, and the other takes that.

        Raises:
            RecordingError: it cannot be made, or something else is there.
            ValueError: another made one at the same time, that reads otherwise.
        """
        Folder(address_of(path)).require_room()
        try:
            with asking(path) as delta:
                delta.DeltaTable.create(
                    address_of(path), delta.Schema.from_arrow(COLUMNS), mode="error", partition_by=list(PARTITIONS),
                    description=config.to_json(frame),
                )  # fmt: skip
        except RecordingError:
            if not cls.is_at(path):
                raise
        made = cls.open(path)
        made.check_config(config)
        made.check_frame(made.path, frame)
        return made

    @property
    def reading(self) -> ReadOptions:
        """How its logs are read, on the plane of its positions, if it has an origin."""
        options = self.config.reading
        meets = str(self) if self.frame and not self.config.origin else ""
        return replace(options, origin=self.origin or options.origin, meets=meets)

    @property
    def origin(self) -> Origin | None:
        """Of the plane that positions are on."""
        return Origin.of_frame(self.frame)

    def check_config(self, config: StoreConfig) -> None:
        """Whether logs read so can be added.

        Raises:
            ValueError: they cannot.
        """
        for field in fields(StoreConfig):
            ours, theirs = getattr(self.config, field.name), getattr(config, field.name)
            same = field.name == "origin" and theirs and Origin.parse(theirs).is_of(self.origin)
            if ours != theirs and not same:
                expected, got = (f"no {field.name}" if of is None else f"{field.name}={of}" for of in (ours, theirs))
                way = "leave it out, or use another store" if ours is None else "read it so, or use another store"
                raise ValueError(f"{self}: expected {expected}, as its logs were read, got {got}; {way}")

    def check_frame(self, log: str, frame: str) -> None:
        """Whether a log's positions are in the frame of the others.

        Raises:
            ValueError: they are not.
        """
        other = Origin.of_frame(frame)
        if frame != self.frame and not (other and other.is_of(self.origin)):
            raise ValueError(
                f"{log}: expected positions in frame {self.frame!r} as in the rest of the store, got {frame!r}; use "
                "another store, or another --set frame=... or origin=... for this one from its first log on"
            )

    def contents(self) -> Contents:
        """What it holds now.

        Raises:
            RecordingError: it cannot be read.
        """
        return contents_of(self._table(), str(self))

    def commit(self, change: Change) -> None:
        """Add and remove files at once, by what the table holds then; then those that were removed are deleted.

        Args:
            change: called anew where another process committed something in between.

        Raises:
            RecordingError: the table cannot be written, or others never let it be.
        """
        for attempt in range(MOST_COMMITS):
            table = self._table()
            added, removed = (list(files) for files in change(contents_of(table, str(self))))
            if not added and not removed:
                return
            if self._committed(table, added, removed):
                break
            time.sleep(0.01 * (1 + uuid4().int % (4 + attempt)))
        else:
            raise RecordingError(f"{self}: others commit all the time; run again")
        self.delete(file.path for file in removed)
        for block in {file.block for file in (*added, *removed)}:  # what was learned there is not asked for any more
            with suppress(RecordingError):
                self.delete(each.path for each in self.listed(f"{FITS}/{block}"))

    def tidy(self) -> None:
        """Delete the rows that processes left which were killed before they committed them."""
        with suppress(RecordingError):
            there = self.listed("rows")
            known = set(pa.table(self._table().get_add_actions())["path"].to_pylist())
            since_ns = time.time_ns() - ORPHANS_NS
            old = {each.path for each in there if (each.mtime_ns or since_ns) < since_ns}
            self.delete(old - known)

    def write(
        self, rows: StoredRows, *, log: str, mark: str, status: str, recording: str | None = None,
        span: tuple[int, int] = (0, 0),
    ) -> list[File]:  # fmt: skip
        """Write the files of a log, which count once they are committed; of no rows one, so that the log stays known.

        Args:
            rows: of the log.
            log: its URL or absolute path.
            mark: its size, and its ETag or time of change.
            status: whether all of it could be read.
            recording: `StoredRows.digest` of all its rows, where not all are left.
            span: milliseconds, from when to when it is, where none is left.

        Raises:
            RecordingError: they cannot be written.
        """
        recording, added, files = recording or rows.digest, f"{time.time_ns():020d}-{uuid4().hex}", []
        near = blocks_near(rows.position) if len(rows) else [(Block(0, 0), False, np.ones(0, np.bool_))]
        for block, halo, chosen in near:
            some = rows.some(chosen)
            data = some.to_parquet()
            path = f"rows/{uuid4().hex}-{hashlib.sha256(data).hexdigest()}.parquet"
            self.put(path, data)
            times = some.t_ms if len(some) else np.array(span)
            files.append(File(
                path, len(data), log, mark, recording, added, status, block, halo, len(some),
                int(some.track.max(initial=-1)), int(times.min()), int(times.max()),
            ))  # fmt: skip
        return files

    def read(self, file: File) -> StoredRows:
        """The rows of a file.

        Raises:
            DamagedFileError: they are not those that were written.
            GoneError: the file is no more.
            RecordingError: it cannot be read.
        """
        data = self.get(file.path)
        if data is None and file not in self.contents().files.get(file.log, []):
            raise GoneError(f"{self}: {file.path} of {file.log} is no more")
        try:
            return _rows_of(file, data or b"")
        except ValueError as error:
            raise DamagedFileError(
                f"{self}: {file.log} is damaged in the store, in {file.path}: {error}; forget it, and add it again"
            ) from error

    def _table(self) -> Any:
        with asking(self.path) as delta:
            return delta.DeltaTable(self.path)

    def _committed(self, table: Any, added: list[File], removed: list[File]) -> bool:
        """Whether nothing else was, that contradicts it."""
        now = time.time_ns() // 1_000_000
        with asking(self.path) as delta, suppress(delta.exceptions.CommitFailedError):
            remove = partial(delta.transaction.RemoveAction, data_change=True, deletion_timestamp=now)
            actions = [*(added_action(file, now) for file in added), *(remove(path=file.path) for file in removed)]
            table.create_write_transaction(actions, "append", delta.Schema.from_arrow(COLUMNS), list(PARTITIONS))
            return True
        return False


def _rows_of(file: File, data: bytes) -> StoredRows:
    """The rows in the bytes of a file; a ValueError says that they are not those that were written."""
    if hashlib.sha256(data).hexdigest() != file.digest:
        raise ValueError("other bytes than were written")
    rows = StoredRows.from_parquet(data)
    if len(rows) != file.n_rows:
        raise ValueError(f"{len(rows)} rows in place of {file.n_rows}")
    return rows
