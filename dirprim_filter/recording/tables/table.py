"""What every table format becomes: tracks, and an account of the rows that were left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from dirprim_filter.arrays import AnyArray, IntArray
from dirprim_filter.recording.decoding.field_columns import NO_TIME
from dirprim_filter.recording.errors import TableError
from dirprim_filter.recording.transforms.geodesy import FARTHEST_M
from dirprim_filter.recording.vehicle_rows import VehicleRows
from dirprim_filter.sizes import known_sizes
from dirprim_filter.track_ids import Numbers, as_track_ids, repeated_rows
from dirprim_filter.tracks import Tracks

ALONE = "alone in time, so that no velocity can be derived"
NO_NAMES = np.empty(0, np.str_)
"""Of parts whose vehicles get their names when all are there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """The tracks of a table.

    Attributes:
        tracks: the rows that are good.
        dropped: how many rows were left out, by reason.
        notes: what was put right without a loss, and how often.
        labels: what each vehicle is, by its id; of those that the table gives a label.
        unused: the columns of which nothing was read.
        files: all that were read, where the table is a folder.
    """

    tracks: Tracks
    dropped: Mapping[str, int] = field(default_factory=dict)
    notes: Mapping[str, int] = field(default_factory=dict)
    labels: Mapping[int | str, str] = field(default_factory=dict)
    unused: Sequence[str] = ()
    files: Sequence[Path] = ()

    @property
    def n_lost(self) -> int:
        """Rows that were left out for a fault; a row alone in time has none, it only has no motion."""
        return sum(n for reason, n in self.dropped.items() if reason != ALONE)


def joined_rows(path: Path, parts: Sequence[VehicleRows], numbers: Numbers) -> VehicleRows:
    """The rows of all parts of a file, of vehicles that are numbered.

    Raises:
        TableError: there is no part.
    """
    if not parts:
        raise TableError(path, "", "rows", "none", "check how the table was made")
    return VehicleRows.concatenate(parts, np.array(list(numbers), np.str_))


def table_of(
    rows: VehicleRows,
    *,
    label: AnyArray | None = None,
    dropped: Mapping[str, int] | None = None,
    notes: Mapping[str, int] | None = None,
    files: Sequence[Path] = (),
) -> Table:
    """The table of rows: bad ones dropped and counted, times in order, ids unique.

    Dropped are rows whose time or position is missing or beyond `FARTHEST_M`, with an infinite number, with a negative
    speed, and of two rows of a vehicle at one time the second. A vehicle id that stands in two groups means two
    vehicles: all ids become `group/id`. Where the course is missing in a row of a vehicle it is derived from all its
    positions, and so is the speed; a row that stands alone in time, and has no heading, is then dropped as well.

    Args:
        rows: as they were read, bad ones among them.
        label: (n,) str, what the vehicle is, empty where unknown; None where the table has none.
        dropped: what the reader dropped before, by reason.
        notes: what it put right before.
        files: all that were read.
    """
    counts, notes = ({why: n for why, n in (before or {}).items() if n} for before in (dropped, notes))
    finite = (rows.time_ns != NO_TIME) & (np.abs(rows.position) <= FARTHEST_M).all(axis=1)
    finite &= ~np.isinf(rows.direction) & ~np.isinf(rows.speed) & ~np.isinf(rows.heading)
    good = finite & ~(rows.speed < 0)
    _count(counts, "negative speed", int((finite & ~good).sum()))
    _count(counts, "a number that is missing, not finite or too large", int((~finite).sum()))
    names, vehicle = _vehicles(rows, notes)
    rows = replace(rows, names=np.array(names, np.str_), vehicle=vehicle, size=known_sizes(rows.size))
    kept = np.flatnonzero(good)
    repeated = repeated_rows(rows.vehicle[kept], rows.time_ns[kept])
    _count(counts, "a second row of a vehicle at one time", int(repeated.sum()))
    kept = kept[~repeated]
    rows = rows[kept]
    late = _n_out_of_order(rows.vehicle, rows.time_ns)
    _count(notes, "rows earlier than the row before of the same vehicle; sorted", late)
    partly = int((rows.has_motion() & ~rows.is_known_throughout()).sum())
    _count(notes, "rows of vehicles whose course or speed is known of a part; derived from positions", partly)
    tracks, n_alone = rows.to_tracks()
    _count(counts, ALONE, n_alone)
    labels = {} if label is None else _labels(as_track_ids(rows.names)[rows.vehicle], label[kept], notes)
    return Table(tracks=tracks, dropped=counts, notes=notes, labels=labels, files=files)


def _labels(track_id: AnyArray, label: AnyArray, notes: dict[str, int]) -> dict[int | str, str]:
    """Of each vehicle that has labels the most frequent one, of equally frequent the first by name."""
    pairs = Counter(pair for pair in zip(track_id.tolist(), label.tolist(), strict=True) if pair[1])
    labels: dict[int | str, str] = {}
    for vehicle, name in sorted(pairs, key=lambda pair: (-pairs[pair], pair[1])):
        labels.setdefault(vehicle, name)
    other = sum(n for (vehicle, name), n in pairs.items() if labels[vehicle] != name)
    _count(notes, "rows with another label than most of their vehicle's; it has that of most", other)
    return labels


def _vehicles(rows: VehicleRows, notes: dict[str, int]) -> tuple[Sequence[str], IntArray]:
    """Names, and the vehicle of each row among them: an id in two groups means two vehicles."""
    names = rows.names.tolist()
    groups, group = np.unique(rows.group, return_inverse=True)
    pairs, vehicle = np.unique(group * len(names) + rows.vehicle, return_inverse=True)
    pair_group, pair_name = np.divmod(pairs, len(names))
    shared = int((np.bincount(pair_name) > 1).sum())
    if not shared:
        return names, rows.vehicle
    _count(notes, "vehicle ids that stand in several groups; all ids became group/id", shared)
    of_pairs = zip(groups[pair_group].tolist(), pair_name.tolist(), strict=True)
    return [f"{of}/{names[name]}" for of, name in of_pairs], vehicle


def _count(counts: dict[str, int], reason: str, n: int) -> None:
    """Add to the rows of a reason; a reason of none is left out."""
    if n:
        counts[reason] = counts.get(reason, 0) + n


def _n_out_of_order(vehicle: IntArray, time_ns: IntArray) -> int:
    """How many rows are earlier than the row before of the same vehicle."""
    order = np.argsort(vehicle, kind="stable")
    return int(((np.diff(vehicle[order]) == 0) & (np.diff(time_ns[order]) < 0)).sum())
