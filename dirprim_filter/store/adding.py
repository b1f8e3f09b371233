"""Adding logs to a store: each is summarised and counted by itself, in this process or by workers.

Who does it asks the store once whether another has done it, and writes the recording, then the entry of the manifest:
so a log that was finished is not read again, whoever dies, and nothing half counts.
"""

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
from dirprim_filter.recording.losses import ALONE
from dirprim_filter.recording.reader import TrackResult, read_track_logs
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.lattice import square_of
from dirprim_filter.store.log_files import LogFile
from dirprim_filter.store.manifest import Entry
from dirprim_filter.store.steps import HERE
from dirprim_filter.store.store import Store
from dirprim_filter.store.summary import Summary
from dirprim_filter.store.tiles import tiles_of
from dirprim_filter.store.workers import InProcess, Workers
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks


class Receipt(NamedTuple):
    """What came of a log.

    Attributes:
        log: it.
        entry: in the manifest; None where the log cannot be counted.
        error: why it cannot, in one line; empty where it can.
    """

    log: LogFile
    entry: Entry | None
    error: str


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

    Raises:
        ValueError: the store is in the memory of this process, and workers are others.
        RecordingError: the store cannot be read or written; what is done counts.
    """
    workers = workers or InProcess()
    store.check_seen_by(workers)
    store.tidy()
    known, there = store.entries_of(log.url for log in logs), store.recording_sizes().keys() | store.archived().keys()
    new = [log for log in logs if not store.holds(known.get(log.url), log, there)]
    receipts: list[Receipt] = []
    try:
        for receipt in _receipts(store, new, workers):
            receipts.append(receipt)
            if progress is not None:
                progress(len(receipts), len(new))
    finally:
        counted = {receipt.log.url: receipt.entry.rows for receipt in receipts if receipt.entry is not None}
        store.drop(*(known[url].rows for url, rows in counted.items() if url in known and known[url].rows != rows))
    if new:
        store.tidy()  # of workers that were killed
    store.gather(anew=bool(new))
    return Added(len(logs) - len(new), sorted(receipts, key=lambda receipt: receipt.log.url))


def _receipts(store: Store, logs: list[LogFile], workers: Workers) -> Iterator[Receipt]:
    """Of all logs, as they are done; those of this process come until the frame of the store is known."""
    rest, frame = list(logs), store.frame if logs else None
    while rest and frame is None:  # the first log in order of names says which it is
        yield summarise_log(rest.pop(0), store=store, frame=None)
        frame = store.frame
    yield from workers.each(partial(summarise_log, store=store, frame=frame), rest)


def summarise_log(log: LogFile, *, store: Store, frame: str | None) -> Receipt:
    """Write the summary of a log and count it; a log that was finished is not opened.

    What is wrong with the log, the receipt says: errors do not stop others.

    Args:
        log: it.
        store: where.
        frame: of the store, which needs not be asked for then; None where it is unknown.
    """
    try:
        before = store.entry_of(log.url)
        if before is None or not (store.holds(before, log, {before.rows}) and store.has_recording(before.rows)):
            return Receipt(log, _counted(log, store, frame, before), "")
        return Receipt(log, before, "")
    except (RecordingError, OSError, ValueError) as error:
        return Receipt(log, None, _one_line(log, error))
    finally:
        drop_copy(log.url)


def _counted(log: LogFile, store: Store, frame: str | None, before: Entry | None) -> Entry:
    """The entry of a log, in the place of the one before."""
    config, read = store.config, _read(log, store.config)
    if read.frame != frame:
        store.check_frame(log.url, read.frame)
    rows = hash_of_rows(read.tracks)
    if before is not None and before.rows != rows:
        store.check_single(before)
    summary = Summary.of(read.tracks, lattice=config.lattice, frame=read.frame)
    store.write_recording(rows, summary)
    entry = Entry(
        url=log.url, size=log.size, mark=log.mark, rows=rows, n_rows=len(read.tracks),
        n_vehicles=read.tracks.n_tracks, start_ns=int(read.tracks.time_ns[0]), end_ns=int(read.tracks.time_ns[-1]),
        n_squares=np.unique(square_of(summary.steps.key[:, HERE])).size,
        tiles=tiles_of(summary.steps.key[:, HERE]).tolist(), config=config.digest,
        status="damaged" if read.losses.damage or set(read.losses.dropped) - {ALONE} else "whole",
    )  # fmt: skip
    store.record(entry)
    return entry


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
