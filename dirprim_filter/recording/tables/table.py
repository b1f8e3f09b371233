"""What every table format becomes: tracks, and an account of the rows that were left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from dirprim_filter.recording.transforms.geodesy import FARTHEST_M
from dirprim_filter.sizes import known_sizes
from dirprim_filter.track_ids import as_track_ids, repeated_rows
from dirprim_filter.tracks import Tracks
from tessellation.arrays import AnyArray, BoolArray, FloatArray, IntArray

ALONE = "alone in time, so that no velocity can be derived"


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """The tracks of a table.

    Attributes:
        tracks: the rows that are good.
        dropped: how many rows were left out, by reason.
        notes: what was put right without a loss, and how often.
        labels: what each vehicle is, by its id; of those that the table gives a label.
        unused: the columns of which nothing was read.
    """

    tracks: Tracks
    dropped: Mapping[str, int] = field(default_factory=dict)
    notes: Mapping[str, int] = field(default_factory=dict)
    labels: Mapping[int | str, str] = field(default_factory=dict)
    unused: Sequence[str] = ()

    @property
    def n_lost(self) -> int:
        """Rows that were left out for a fault; a row alone in time has none, it only tells of no motion."""
        return sum(n for reason, n in self.dropped.items() if reason != ALONE)


@dataclass(frozen=True, slots=True, kw_only=True)
class TableRows:
    """The rows of a table as they stand there, bad ones among them.

    Attributes:
        vehicle: (n,) int64, the row's vehicle as an index into the table's vehicle ids.
        time_ns: (n,) int64; whatever number where `time_known` is False.
        time_known: (n,) where the row tells a time.
        position: (n, 2) metres, x east, y north; not finite where unknown.
        direction: (n,) course over ground, radians counter-clockwise from east; None where the table has none.
        speed: (n,) m/s; None where the table has none.
        group: (n,) int64; None where the table has none.
        size: (n, 3) length, width and height, metres; what is not positive is unknown; None where the table has none.
        heading: (n,) yaw of the body, radians counter-clockwise from east; None where the table has none.
        label: (n,) str, what the vehicle is, empty where unknown; None where the table has none.
    """

    vehicle: IntArray
    time_ns: IntArray
    time_known: BoolArray
    position: FloatArray
    direction: FloatArray | None = None
    speed: FloatArray | None = None
    group: IntArray | None = None
    size: FloatArray | None = None
    heading: FloatArray | None = None
    label: AnyArray | None = None

    @classmethod
    def concatenate(cls, parts: Sequence[TableRows]) -> TableRows:
        """All rows of all parts, at least one, that tell the same."""
        columns: dict[str, Any] = {}
        for f in fields(cls):
            column = [getattr(part, f.name) for part in parts]
            columns[f.name] = None if column[0] is None else np.concatenate(column)
        return cls(**columns)


def table_of(rows: TableRows, names: Sequence[str], *, dropped: Mapping[str, int] | None = None) -> Table:
    """The table of rows: bad ones dropped and counted, times in order, ids unique.

    Dropped are rows whose time or position is missing or beyond `FARTHEST_M`, with an infinite number, with a negative
    speed, and of two rows of a vehicle at one time the second. A vehicle id that stands in two groups means two
    vehicles: all ids become `group/id`. Where the course is missing in a row of a vehicle it is derived from all its
    positions, and so is the speed; a row that stands alone in time, and has no heading, is then dropped as well.

    Args:
        rows: the rows as read.
        names: the vehicle ids.
        dropped: what the reader dropped before, by reason.
    """
    counts = dict(dropped or {})
    notes: dict[str, int] = {}
    finite = rows.time_known & (np.abs(rows.position) <= FARTHEST_M).all(axis=1)
    nowhere = np.full(len(finite), np.nan)
    direction = nowhere if rows.direction is None else rows.direction
    speed = nowhere if rows.speed is None else rows.speed
    heading = nowhere if rows.heading is None else rows.heading
    finite &= ~np.isinf(direction) & ~np.isinf(speed) & ~np.isinf(heading)
    good = finite & ~(speed < 0)
    _count(counts, "negative speed", int((finite & ~good).sum()))
    _count(counts, "a number that is missing, not finite or too large", int((~finite).sum()))

    names, vehicle, group = _vehicles(rows, names, notes)
    kept = np.flatnonzero(good)
    repeated = repeated_rows(vehicle[kept], rows.time_ns[kept])
    _count(counts, "a second row of a vehicle at one time", int(repeated.sum()))
    kept = kept[~repeated]
    late = _n_out_of_order(vehicle[kept], rows.time_ns[kept])
    _count(notes, "rows earlier than the row before of the same vehicle; sorted", late)

    track_id = as_track_ids(np.array(names, dtype=np.str_))[vehicle[kept]]
    times, position, groups = rows.time_ns[kept], rows.position[kept], group[kept]
    size = np.empty((0, 3)) if rows.size is None else known_sizes(rows.size[kept])
    direction, speed, heading = direction[kept], speed[kept], heading[kept]
    told = np.isfinite(direction) & np.isfinite(speed)
    is_told = np.ones(len(names), np.bool_)
    is_told[vehicle[kept][~told]] = False
    whole = is_told[vehicle[kept]]
    if told.any():
        _count(
            notes,
            "rows of vehicles whose course or speed is known of a part; derived from positions",
            int((told & ~whole).sum()),
        )
    given = Tracks(
        track_id=track_id[whole], time_ns=times[whole], position=position[whole], group=groups[whole],
        direction=direction[whole], speed=speed[whole], size=size[whole] if len(size) else size, heading=heading[whole],
    )  # fmt: skip
    derived = Tracks.from_positions(
        track_id=track_id[~whole],
        time_ns=times[~whole],
        position=position[~whole],
        group=groups[~whole],
        size=size[~whole] if len(size) else size,
        heading=heading[~whole],
        speed=speed[~whole],
    )
    _count(counts, ALONE, int((~whole).sum()) - len(derived))
    tracks = Tracks.concatenate([part for part in (given, derived) if len(part)] or [given])
    labels = {} if rows.label is None else _labels(track_id, rows.label[kept], notes)
    return Table(tracks=tracks, dropped=counts, notes=notes, labels=labels)


def _labels(track_id: AnyArray, label: AnyArray, notes: dict[str, int]) -> dict[int | str, str]:
    """Of each vehicle that has labels the most frequent one, of equally frequent the first by name."""
    pairs = Counter(pair for pair in zip(track_id.tolist(), label.tolist(), strict=True) if pair[1])
    labels: dict[int | str, str] = {}
    for vehicle, name in sorted(pairs, key=lambda pair: (-pairs[pair], pair[1])):
        labels.setdefault(vehicle, name)
    other = sum(n for (vehicle, name), n in pairs.items() if labels[vehicle] != name)
    _count(notes, "rows with another label than most of their vehicle's; it has that of most", other)
    return labels


def _vehicles(rows: TableRows, names: Sequence[str], notes: dict[str, int]) -> tuple[Sequence[str], IntArray, IntArray]:
    """Names, the vehicle of each row among them, and its group: an id in two groups means two vehicles."""
    if rows.group is None:
        return names, rows.vehicle, np.zeros(len(rows.vehicle), np.int64)
    groups, group = np.unique(rows.group, return_inverse=True)
    pairs, vehicle = np.unique(group * len(names) + rows.vehicle, return_inverse=True)
    pair_group, pair_name = np.divmod(pairs, len(names))
    shared = int((np.bincount(pair_name) > 1).sum())
    if not shared:
        return names, rows.vehicle, rows.group
    _count(notes, "vehicle ids that stand in several groups; all ids became group/id", shared)
    told = zip(groups[pair_group].tolist(), pair_name.tolist(), strict=True)
    return [f"{of}/{names[name]}" for of, name in told], vehicle, rows.group


def _count(counts: dict[str, int], reason: str, n: int) -> None:
    """Add to the rows of a reason; a reason of none is not told."""
    if n:
        counts[reason] = counts.get(reason, 0) + n


def _n_out_of_order(vehicle: IntArray, time_ns: IntArray) -> int:
    """How many rows are earlier than the row before of the same vehicle."""
    order = np.argsort(vehicle, kind="stable")
    return int(((np.diff(vehicle[order]) == 0) & (np.diff(time_ns[order]) < 0)).sum())
