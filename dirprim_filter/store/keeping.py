"""Keeping fewer vehicles of months that are over: of each turn at most so many, weighed by how many they stand for."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np

from dirprim_filter.store.files import Contents, Entry, File
from dirprim_filter.store.rows import StoredRows
from dirprim_filter.store.sampling import Recording, turns_of
from dirprim_filter.store.store import Store

VEHICLES = 100
"""Of a turn in a month."""


class Kept(NamedTuple):
    """What was done to a month."""

    month: str
    n_before: int  # vehicles
    n_after: int


def keep(
    store: Store, *, n_vehicles: int = VEHICLES, month: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Kept]:  # fmt: skip
    """Write each log anew with the vehicles that are kept of it; each can be forgotten as before.

    Args:
        store: of logs.
        n_vehicles: of a turn in a month. A turn of fewer is kept whole.
        month: such as 2026-08; left out, all but that of the last log.
        progress: called with how many logs are done, and of how many.

    Raises:
        RecordingError: a recording cannot be read, or the store cannot be written.
    """
    months: defaultdict[str, list[Entry]] = defaultdict(list)
    entries = store.contents().entries.values()
    for entry in entries:
        months[month_of(entry.start_ms)].append(entry)
    last = month_of(max((entry.end_ms for entry in entries), default=0))
    chosen = [name for name in sorted(months) if (name != last if month is None else name == month)]
    done, n_logs, of = [], 0, sum(len(months[name]) for name in chosen)
    for name in chosen:
        n_of: Counter[int] = Counter()
        for recording in {entry.recording: entry for entry in months[name]}.values():
            n_of.update(turns_of(whole(store, recording)).tolist())
        before = after = 0
        for entry in months[name]:
            rows = whole(store, entry)
            left = Recording.of(entry.recording, rows).thinned(n_of, n_vehicles).weighed(n_of, n_vehicles)
            before, after = before + rows.first.size, after + left.first.size
            if not np.array_equal(left.weight, rows.weight):  # of those, too, of whom all happen to be drawn
                _replace(store, entry, left)
            n_logs += 1
            if progress is not None:
                progress(n_logs, of)
        done.append(Kept(name, before, after))
    store.tidy()
    return done


def whole(store: Store, entry: Entry) -> StoredRows:
    """All rows of a log."""
    return StoredRows.together([store.read(file) for file in entry.files if not file.halo])


def month_of(t_ms: int) -> str:
    """Such as 2026-08, of UTC."""
    return datetime.fromtimestamp(t_ms * 1e-3, UTC).strftime("%Y-%m")


def _replace(store: Store, entry: Entry, left: StoredRows) -> None:
    """A log's files by those of the rows that are left, unless another process changed it in between."""
    files = store.write(
        left, log=entry.log, mark=entry.mark, status=entry.status, recording=entry.recording,
        span=(entry.start_ms, entry.end_ms),
    )  # fmt: skip

    def change(contents: Contents) -> tuple[list[File], list[File]]:
        now = contents.entries.get(entry.log)
        return (files, contents.files[entry.log]) if now is not None and now.files == entry.files else ([], [])

    store.commit(change)
