"""A store of many logs' rows: a Delta table, whose commits take place as a whole or not at all.

Every file of the table holds some rows of one recording, in one block of the ground or in its halo; what else is known
of a log stands in the columns that the table is partitioned by, in its transaction log. So to list ten thousand logs
opens none of their files, and to forget one writes none anew. Files have the SHA-256 of what they hold in their names,
and whatever is read is compared with it.
"""

from __future__ import annotations

import hashlib
import re
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import cached_property
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
from dirprim_filter.store.delta import address_of, asked, shown
from dirprim_filter.store.files import (
    COLUMNS,
    FIT,
    PARTITIONS,
    PATH,
    Contents,
    File,
    contents_of,
    partition_of,
    statistics_of,
)
from dirprim_filter.store.rows import StoredRows

FITS = "_fits"
"""Folder of what was fitted; Delta leaves alone what begins so."""
MOST_COMMITS = 200
"""Tries, while others commit."""
LOG = re.compile(r"_delta_log/(\d{20}\..*|_last_checkpoint|_commit_.*\.tmp)")
"""Of Delta's library."""
ORPHANS_NS = 24 * 3600 * 10**9
"""So old a file that was never committed is what a killed process left."""


class DamagedFileError(RecordingError):
    """A file of a store is not what was written."""


class GoneError(RecordingError):
    """A file is no more: another process has taken its log out."""


Change = Callable[[Contents], tuple[Iterable[File], Iterable[File]]]
"""What to add and what to remove."""


@dataclass(frozen=True)
class Store:
    """A table, by its path or URL; small, so that workers are sent it.

    Attributes:
        path: of a folder, or a URL of an object store.
        config: how its logs are read.
        frame: of the positions.
    """

    path: str
    config: StoreConfig
    frame: str

    @classmethod
    def is_at(cls, path: str | Path) -> bool:
        """Whether there is one.

        Raises:
            RecordingError: it cannot be asked.
        """
        ask = address_of(path)
        return not Path(ask).is_file() and bool(asked(path, lambda delta: delta.DeltaTable.is_deltatable(ask)))

    @classmethod
    def open(cls, path: str | Path) -> Self:
        """One that is there.

        Raises:
            RecordingError: there is none, or one that cannot be read.
        """
        if not cls.is_at(path):
            raise RecordingError(f"{shown(path)}: expected a store, found none; `dirprim store add` makes one")
        table = asked(path, lambda delta: delta.DeltaTable(address_of(path)))
        try:
            config, frame = StoreConfig.from_json(table.metadata().description or "")
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
        cls.require_room(path)
        try:
            asked(path, lambda delta: delta.DeltaTable.create(
                address_of(path), delta.Schema.from_arrow(COLUMNS), mode="error", partition_by=list(PARTITIONS),
                description=config.to_json(frame),
            ))  # fmt: skip
        except RecordingError:
            if not cls.is_at(path):
                raise
        made = cls.open(path)
        made.check_config(config)
        made.check_frame(made.path, frame)
        return made

    @classmethod
    def require_room(cls, path: str | Path) -> None:
        """Whether a new one may be made there: where nothing is but what one leaves that is killed as it makes one.

        Raises:
            RecordingError: something is there.
        """
        made = cls(address_of(path), StoreConfig(), "")
        if "://" not in made.path and not Path(made.path).is_dir():
            return
        for top in made._listed("", deep=False):
            is_own = top.path in ("rows", FITS, "_delta_log") and not top.is_file
            within = [at.path for at in made._listed(top.path) if at.is_file] if is_own else [top.path]
            if other := next((name for name in within if not _is_own(name) and not LOG.fullmatch(name)), None):
                raise RecordingError(
                    f"{made}: expected a store or an empty folder, got one with {other} in it; choose another name, "
                    "such as that of a new folder in it"
                )

    def __str__(self) -> str:
        return shown(self.path)

    @property
    def reading(self) -> ReadOptions:
        """How its logs are read, on the plane of its positions, if it has an origin."""
        return replace(self.config.reading, origin=self.origin, meets="" if self.config.origin else str(self))

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
                raise ValueError(f"{self}: expected {field.name} {ours}, as its logs are read, got {theirs}")

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
        self._delete(file.path for file in removed)
        for block in {file.block for file in (*added, *removed)}:  # what was learned there is not asked for any more
            with suppress(RecordingError):
                self._delete(each.path for each in self._listed(f"{FITS}/{block}"))

    def tidy(self) -> None:
        """Delete the rows that processes left which were killed before they committed them."""
        with suppress(RecordingError):
            there = self._listed("rows")
            known = set(pa.table(self._table().get_add_actions())["path"].to_pylist())
            since_ns = time.time_ns() - ORPHANS_NS
            old = (each.path for each in there if each.mtime_ns is not None and each.mtime_ns < since_ns)
            self._delete(path for path in old if path not in known)

    def _delete(self, paths: Iterable[str]) -> None:
        """Those of them that a store wrote, if they are there."""
        for path in filter(_is_own, paths):
            with suppress(OSError):  # what stays is what no one knows of
                self._folder.delete_file(path)

    def _listed(self, folder: str, *, deep: bool = True) -> list[Any]:
        """What pyarrow knows of the files in a folder, and of folders."""
        return list(asked(self.path, lambda _: self._folder.get_file_info_selector(folder, True, deep)))

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
        near = blocks_near(rows.position) if len(rows) else [(Block(0, 0), np.ones(0, np.bool_), np.ones(0, np.bool_))]
        for block, inside, around in near:
            for halo, chosen in ((False, inside), (True, around)):
                if halo if not len(rows) else not chosen.any():
                    continue
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
            rows = _rows_of(file, data or b"")
        except ValueError as error:
            raise DamagedFileError(
                f"{self}: {file.log} is damaged in the store, in {file.path}: {error}; forget it, and add it again"
            ) from error
        return rows

    def put(self, path: str, data: bytes) -> None:
        """Write a file as a whole.

        Raises:
            RecordingError: it cannot be written.
        """

        def write(_: Any) -> None:
            stream = self._folder.open_output_stream(path)
            stream.write(data)
            stream.close()

        asked(self.path, write)

    def get(self, path: str) -> bytes | None:
        """What a file holds; None where there is none.

        Raises:
            RecordingError: it cannot be read.
        """

        def read(_: Any) -> bytes | None:
            try:
                stream = self._folder.open_input_file(path)
            except FileNotFoundError:
                return None
            return bytes(stream.read(stream.size()))

        found: bytes | None = asked(self.path, read)
        return found

    def _table(self) -> Any:
        return asked(self.path, lambda delta: delta.DeltaTable(self.path))

    @cached_property
    def _folder(self) -> Any:
        from deltalake._internal import DeltaFileSystemHandler  # noqa: PLC0415 (pyarrow's wrapper of it cannot write)

        if "://" not in self.path:
            Path(self.path).mkdir(parents=True, exist_ok=True)
        return DeltaFileSystemHandler(self.path)

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def _committed(self, table: Any, added: list[File], removed: list[File]) -> bool:
        """Whether nothing else was, that contradicts it."""
        from deltalake.exceptions import CommitFailedError  # noqa: PLC0415 (an extra)
        from deltalake.transaction import AddAction, RemoveAction  # noqa: PLC0415

        now = time.time_ns() // 1_000_000
        actions: list[Any] = [
            AddAction(file.path, file.size, partition_of(file), now, True, statistics_of(file)) for file in added
        ]
        actions += [RemoveAction(path=file.path, data_change=True, deletion_timestamp=now) for file in removed]

        def commit(delta: Any) -> bool:
            try:
                table.create_write_transaction(actions, "append", delta.Schema.from_arrow(COLUMNS), list(PARTITIONS))
            except CommitFailedError:
                return False
            return True

        return bool(asked(self.path, commit))


def _is_own(path: str) -> bool:
    """Whether a store gives this name to what it writes."""
    return bool(PATH.fullmatch(path) or FIT.fullmatch(path))


def _rows_of(file: File, data: bytes) -> StoredRows:
    """The rows in the bytes of a file.

    Raises:
        ValueError: they are not those that were written.
    """
    if hashlib.sha256(data).hexdigest() != file.digest:
        raise ValueError("other bytes than were written")
    rows = StoredRows.from_parquet(data)
    if len(rows) != file.n_rows:
        raise ValueError(f"{len(rows)} rows in place of {file.n_rows}")
    return rows
