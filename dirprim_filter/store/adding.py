"""Adding logs to a store: each is summarised by itself, in this process or by workers, and then counted."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from typing import NamedTuple

import numpy as np

from dirprim_filter.recording.container.partial_copy import NotInPartsError
from dirprim_filter.recording.container.source import copy_in_parts, drop_copy
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.reader import TrackResult, read_track_logs
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.lattice import square_of
from dirprim_filter.store.log_files import LogFile
from dirprim_filter.store.manifest import Entry
from dirprim_filter.store.receipts import Receipt
from dirprim_filter.store.steps import HERE
from dirprim_filter.store.store import Store
from dirprim_filter.store.summary import Summary
from dirprim_filter.store.tiles import tiles_of
from dirprim_filter.store.workers import InProcess, Workers
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks


class Added(NamedTuple):
    """What came of all.

    Attributes:
        known: logs that were in the store before, unchanged.
        receipts: of the others, in order of their names.
    """

    known: int
    receipts: list[Receipt]


def add_logs(
    store: Store,
    logs: Sequence[LogFile],
    *,
    workers: Workers | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Added:
    """Add logs that the store does not know; run again after an interruption, it goes on where it was.

    Args:
        store: it.
        logs: see `log_files.find_logs`.
        workers: who summarise them; left out, this process.
        progress: called with how many are done, and of how many.
    """
    store.tidy()
    known, there = store.entries_of(log.url for log in logs), store.recording_sizes().keys() | store.archived().keys()
    new = [log for log in logs if not store.holds(known.get(log.url), log, there)]
    receipts: list[Receipt] = []
    rest = list(new)

    def count(receipt: Receipt) -> None:
        if receipt.entry is not None:
            try:
                store.record(receipt.entry, receipt.frame)
            except ValueError as error:
                receipt = receipt._replace(entry=None, error=str(error))
        store.drop_receipt(receipt.log.url)
        receipts.append(receipt)
        if progress is not None:
            progress(len(receipts), len(new))

    summarise = partial(summarise_log, store=store)
    while rest and store.frame is None:  # the first log in order of names says which frame is the store's
        count(summarise(rest.pop(0)))
    for receipt in (workers or InProcess()).each(summarise, rest):
        count(receipt)
    store.tidy()  # of workers that were killed
    return Added(len(logs) - len(new), sorted(receipts, key=lambda receipt: receipt.log.url))


def summarise_log(log: LogFile, *, store: Store) -> Receipt:
    """Write the summary of a log, unless that of the same rows is there; a log that was finished is not opened.

    What is wrong with the log, the receipt says: errors do not stop others.
    """
    try:
        return _left(log, store) or _summarised(log, store)
    except (RecordingError, OSError, ValueError) as error:
        return Receipt(log, None, "", _one_line(log, error))
    finally:
        drop_copy(log.url)


def _left(log: LogFile, store: Store) -> Receipt | None:
    """What a worker left that was killed before the log was counted; None where it is not of this log as it is now."""
    receipt = store.left(log.url)
    if receipt is None or receipt.entry is None:
        return None
    rows = receipt.entry.rows
    return receipt if store.holds(receipt.entry, log, {rows}) and store.has_recording(rows) else None


def _summarised(log: LogFile, store: Store) -> Receipt:
    config, read = store.config, _read(log, store.config)
    rows = hash_of_rows(read.tracks)
    summary = Summary.of(read.tracks, lattice=config.lattice, frame=read.frame)
    if not store.has_recording(rows):
        store.write_recording(rows, summary)
    entry = Entry(
        url=log.url, size=log.size, mark=log.mark, rows=rows, n_rows=len(read.tracks),
        n_vehicles=read.tracks.n_tracks, start_ns=int(read.tracks.time_ns[0]), end_ns=int(read.tracks.time_ns[-1]),
        n_squares=np.unique(square_of(summary.steps.key[:, HERE])).size,
        tiles=tiles_of(summary.steps.key[:, HERE]).tolist(), config=config.digest,
        status="damaged" if read.losses.damage or read.losses.lost else "whole",
    )  # fmt: skip
    receipt = Receipt(log, entry, read.frame, "")
    store.leave(receipt)
    return receipt


def _read(log: LogFile, config: StoreConfig) -> TrackResult:
    """Of a remote log no more is fetched than is read; where something of that is damaged, all of it."""
    read = _read_in_parts(log, config) or read_track_logs(log.url, config.reading)
    if not len(read.tracks):
        raise RecordingError(f"{log.url}: expected moving objects, got none; left out: {read.losses}")
    return read


def _read_in_parts(log: LogFile, config: StoreConfig) -> TrackResult | None:
    """None of a log that is not read in parts, or not well."""
    if not copy_in_parts(log.url):
        return None
    with suppress(NotInPartsError):
        read = read_track_logs(log.url, config.reading)
        if not read.losses.damage:
            return read
    drop_copy(log.url)
    return None


def hash_of_rows(tracks: Tracks) -> str:
    """SHA-256 of what a log says, however it is written: ids, groups, times, positions, directions and speeds."""
    vehicle, first = tracks.vehicle, tracks.first_rows
    order = np.lexsort((vehicle, tracks.time_ns))
    names = list(zip(tracks.group[first].tolist(), as_texts(tracks.track_id[first]).tolist(), strict=True))
    digest = hashlib.sha256(repr(names).encode())
    for column in (vehicle, tracks.time_ns, tracks.position, tracks.direction, tracks.speed):
        digest.update(np.ascontiguousarray(column[order], column.dtype.newbyteorder("<")).tobytes())
    return digest.hexdigest()


def _one_line(log: LogFile, error: Exception) -> str:
    said = " ".join(str(error).split()) or type(error).__name__
    return said if log.url in said else f"{log.url}: {said}"


def failures(added: Added) -> Iterator[str]:
    """Why logs could not be counted, a line each."""
    return (receipt.error for receipt in added.receipts if receipt.error)
