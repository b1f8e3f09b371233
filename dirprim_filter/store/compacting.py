"""Compacting a store: one file of each month that is over, of as many vehicles as tell enough.

Of a month's vehicles a share is kept, drawn evenly: all shares of ways, speeds and turns stay what they are, but for
chance. So what a store takes grows with its roads and months, and no longer with its vehicles.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np

from dirprim_filter.arrays import BoolArray, IntArray
from dirprim_filter.store.archive import Archive
from dirprim_filter.store.knots import Knots
from dirprim_filter.store.lattice import NONE, Lattice, unpacked
from dirprim_filter.store.pseudo_tracks import kinds_in_ways
from dirprim_filter.store.recorded_ways import rank_of
from dirprim_filter.store.steps import BEFORE, HERE, WHEN, tally_in_order, unpacked_when
from dirprim_filter.store.store import Store
from dirprim_filter.store.summary import Summary
from dirprim_filter.store.table import read_counts, read_summary
from dirprim_filter.store.tallies import Tally
from dirprim_filter.store.tiles import tiles_of

VEHICLES = 35
"""Of a month: a year of so many takes 1 MB for each kilometre of lanes."""
GATE_SQUARES = 8
"""Ways that begin, and end, within so many of the lattice's squares are alike."""


def compacted(
    store: Store,
    *,
    before_ns: int | None = None,
    n_vehicles: int = VEHICLES,
    progress: Callable[[int, int], None] | None = None,
) -> list[Archive]:
    """Make one file of the recordings of each month that is over, but for those that are in one already.

    Args:
        store: it.
        before_ns: nanoseconds since 1970-01-01; a month that ends later is left as it is. Left out, that of the last
            log.
        n_vehicles: how many are kept of a month where a vehicle is, on average over vehicles and places.
        progress: called with how many months are done, and of how many.

    Returns:
        What was made, the same whether months were compacted one by one or at once.

    Raises:
        ValueError: fewer than one vehicle.
        RecordingError: a recording is damaged; the months before it are compacted.
        OSError: one cannot be read, or nothing written.
    """
    if n_vehicles < 1:
        raise ValueError(f"n_vehicles: expected at least 1, got {n_vehicles}")
    store.tidy()
    archived, entries = store.archived(), store.entries()
    if before_ns is None:
        before_ns = max((entry.end_ns for entry in entries), default=0)
    months: defaultdict[str, set[str]] = defaultdict(set)
    for entry in entries:
        if entry.rows not in archived:
            months[month_of(entry.start_ns)].add(entry.rows)
    over = [month for month in sorted(months) if month < month_of(before_ns)]
    made = []
    for i, month in enumerate(over):
        made.append(_archived(store, month, sorted(months[month]), n_vehicles))
        if progress is not None:
            progress(i + 1, len(over))
    return made


def month_of(time_ns: int) -> str:
    """Such as 2026-08, UTC."""
    return datetime.fromtimestamp(time_ns // 10**9, UTC).strftime("%Y-%m")


def _archived(store: Store, month: str, recordings: list[str], n_vehicles: int) -> Archive:
    passed = Tally.total([read_counts(store.recording(rows), store.config.lattice).passed for rows in recordings])
    at_place = passed.value[:, 0].astype(np.float64)
    share = min(1.0, n_vehicles * float(at_place.sum() / (at_place @ at_place)))
    total = Summary.total(thinned(read_summary(store.recording(rows)), rows, share) for rows in recordings)
    knots = Knots.of(total.steps, total.lattice)
    total = replace(total, steps=knots.steps(total.lattice))
    archive = Archive(
        name=total.digest, month=month, share=share, recordings=recordings,
        tiles=tiles_of(total.steps.key[:, HERE]).tolist(),
    )  # fmt: skip
    store.archive(archive, knots, total)
    return archive


def thinned(summary: Summary, rows: str, share: float) -> Summary:
    """The steps of a share of a recording's vehicles, and all else that it counts; `rows` is their hash."""
    kind = kinds_in_ways(summary.steps, summary.lattice)
    key, value = summary.steps.key[kind], _of_each(summary.steps, kind)
    begins = key[:, BEFORE] == NONE
    kept = (rank_of(_places(key, begins, summary.lattice), rows) < share)[np.cumsum(begins) - 1]
    return replace(summary, steps=tally_in_order(key[kept, WHEN], key[kept, HERE], begins[kept], value[kept]))


def _places(key: IntArray, begins: BoolArray, lattice: Lattice) -> IntArray:
    """(w,) of ways by their hours, by where they begin, and by where they end: so as many are kept of each turn.

    (n, 4) of the steps of ways, (n,) the first of each.
    """
    first = np.flatnonzero(begins)
    last = np.append(first[1:], begins.size)[: first.size] - 1
    hour, fold, _ = unpacked_when(key[first, WHEN], lattice)
    (*begin, _, _), (*end, _, _) = (unpacked(key[at, HERE]) for at in (first, last))
    places = np.empty(first.size, np.int64)
    places[np.lexsort((fold, *(square // GATE_SQUARES for square in (*end, *begin)), hour))] = np.arange(first.size)
    return places


def _of_each(steps: Tally, kind: IntArray) -> IntArray:
    """(n, 9) what each step adds to the sums of its kind: whole numbers, as even as can be."""
    order = np.argsort(kind, kind="stable")
    number = np.empty((kind.size, 1), np.int64)
    number[order, 0] = np.arange(kind.size) - np.searchsorted(kind[order], kind[order])
    count, total = steps.value[kind, :1], steps.value[kind]
    return np.asarray((number + 1) * total // count - number * total // count)
