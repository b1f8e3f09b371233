"""Adding logs to a store: each is read and written by itself, here or by workers, and committed with others."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from dirprim_filter.recording.container.errors import without_secrets
from dirprim_filter.recording.container.source import copied_once
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.reader import ReadOptions, TrackResult, read_track_logs
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.files import File
from dirprim_filter.store.folder import Folder, address_of
from dirprim_filter.store.logs import FoundLog
from dirprim_filter.store.rows import StoredRows
from dirprim_filter.store.store import Store
from dirprim_filter.store.workers import Workers

SPLIT = re.compile(r"_\d+(?=\.[\w.]+$)")
"""How names of the splits of one recording differ: `bag_0.mcap`, `bag_1.mcap`."""
EVERY_S = 1.0
"""A commit: what was read since is read again if this process is killed."""

Task = tuple[FoundLog, Sequence[str]]
"""A log, and by their URLs those whose transforms serve it."""


class Receipt(NamedTuple):
    """What came of a log."""

    log: FoundLog
    files: list[File]  # written, and not committed yet
    frame: str
    error: str  # why it cannot be added, in one line; empty where it can

    @property
    def n_rows(self) -> int:
        """StoredRows that the store has of it."""
        return sum(file.n_rows for file in self.files if not file.halo)

    @property
    def is_damaged(self) -> bool:
        """Whether not all of the log could be read."""
        return any(file.status == "damaged" for file in self.files)


class Added(NamedTuple):
    """What came of all.

    Attributes:
        store: where they are; None where it was to be made, and no log could be read.
        known: logs that were in the store before, unchanged.
        receipts: of the others, in order of their names.
    """

    store: Store | None
    known: int
    receipts: list[Receipt]

    @property
    def failures(self) -> list[str]:
        """Why logs could not be added, a line each."""
        return [receipt.error for receipt in self.receipts if receipt.error]


def add_logs(
    path: str | Path,
    logs: Sequence[FoundLog],
    *,
    config: StoreConfig | None = None,
    workers: Workers | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Added:
    """Add logs that a store does not know; run again after an interruption, it goes on where it was.

    Args:
        path: of the store, which is made if it is not there; its first log says in which frame its positions are.
        logs: see `logs.find_logs`.
        config: how they are read; left out, as the store's are.
        workers: who read them; left out, this process.
        progress: called with how many are done, and of how many.

    Raises:
        ValueError: the store's logs are read otherwise.
        RecordingError: the store cannot be read or written; what is done counts.
    """
    store = Store.open(path) if Store.is_at(path) else None
    if store is None:
        Folder(address_of(path)).require_room()
    elif config is not None:
        store.check_config(config)
    config = store.config if store is not None else config or StoreConfig()
    _ = config.reading  # that logs can be read so is asked before anything is made
    known = store.contents().entries if store is not None else {}
    new = [log for log in logs if log.name not in known or known[log.name].mark != log.version]
    splits = _splits(logs)
    tasks = [(log, splits[log.url]) for log in new]
    receipts: list[Receipt] = []
    fresh: list[Receipt] = []
    last_s = time.monotonic()
    for receipt in _receipts(path, store, config, tasks, workers or Workers()):
        if receipt.files:
            store = store or Store.create(path, config, receipt.frame)
        fresh.append(_in_frame(receipt, store) if receipt.files and store else receipt)
        receipts.append(fresh[-1])
        if store is not None and time.monotonic() - last_s > EVERY_S:
            commit(store, fresh)
            fresh, last_s = [], time.monotonic()
        if progress is not None:
            progress(len(receipts), len(new))
    if store is not None:
        commit(store, fresh)
    return Added(store, len(logs) - len(new), sorted(receipts, key=lambda receipt: receipt.log.name))


def commit(store: Store, receipts: list[Receipt]) -> None:
    """Let logs count, each in the place of what was there of it.

    Raises:
        RecordingError: the store cannot be written.
    """
    added = [file for receipt in receipts for file in receipt.files]
    logs = dict.fromkeys(file.log for file in added)
    if added:
        store.commit(lambda contents: (added, [file for log in logs for file in contents.files.get(log, [])]))


def _in_frame(receipt: Receipt, store: Store) -> Receipt:
    """The receipt; an error where the rest of the store is in another frame."""
    try:
        store.check_frame(receipt.log.name, receipt.frame)
    except ValueError as error:
        return receipt._replace(files=[], error=str(error))
    return receipt


def _receipts(
    path: str | Path, store: Store | None, config: StoreConfig, tasks: Sequence[Task], workers: Workers
) -> Iterator[Receipt]:
    """Of all logs, as they are done; those of this process come until one could be read, and says the frame."""
    there, rest = store or Store(address_of(path), config, ""), list(tasks)
    while rest and store is None:
        receipt = _written(rest.pop(0), store=there)
        yield receipt
        if receipt.files:
            there = replace(there, frame=receipt.frame)
            break
    keys = [f"add-{log.name}-{log.version}-{time.time_ns()}" for log, _ in rest]
    yield from workers.each(partial(_written, store=there), rest, keys)


def _splits(logs: Sequence[FoundLog]) -> dict[str, list[str]]:
    """By a log's URL those of its recording that may hold its transforms: the first split, and those around it."""
    bags: dict[str, list[str]] = {}
    for url in sorted((log.url for log in logs), key=lambda url: (len(url), url)):
        bags.setdefault(SPLIT.sub("", url), []).append(url)
    return {url: [bag[0], *bag[max(i - 1, 0) : i + 2]] for bag in bags.values() for i, url in enumerate(bag)}


def _written(task: Task, *, store: Store) -> Receipt:
    """The files of a log, beside which others may be read; what is wrong with it, the receipt says, and stops no other.

    Raises:
        RecordingError: the store cannot be written.
    """
    log, beside = task
    try:
        with copied_once():
            read = _read(log, store.reading, beside)
        rows = StoredRows.of(read.tracks)
    except (RecordingError, OSError, ValueError) as error:
        reason = without_secrets(" ".join(str(error).split())) or type(error).__name__
        return Receipt(log, [], "", reason if log.name in reason else f"{log.name}: {reason}")
    status = "damaged" if read.losses.damage or read.losses.dropped else "whole"
    files = store.write(rows, log=log.name, mark=log.version, status=status)
    return Receipt(log, files, read.frame, "")


def _read(log: FoundLog, reading: ReadOptions, beside: Sequence[str]) -> TrackResult:
    read = read_track_logs(log.url, reading, beside=beside)
    if not len(read.tracks):
        raise RecordingError(f"{log.url}: expected moving objects, got none; left out: {read.losses}")
    return read
