"""What every table format becomes: tracks, detections, and an account of the rows that were left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dirprim_filter.arrays import AnyArray, IntArray
from dirprim_filter.columns import known_sizes
from dirprim_filter.detections import Detections
from dirprim_filter.recording.decoding.field_columns import NO_TIME
from dirprim_filter.recording.losses import Losses
from dirprim_filter.recording.transforms.geodesy import FARTHEST_M, Origin
from dirprim_filter.recording.vehicle_rows import VehicleRows
from dirprim_filter.track_ids import as_track_ids, repeated_rows
from dirprim_filter.tracks import Tracks


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """The tracks and the detections of a table.

    Attributes:
        tracks: the rows that are good, of vehicles with an id.
        detections: where some rows have no id, or a turn signal, or each vehicle but one row, all that are good, by
            sensor; the name is empty where the table has none.
        losses: how many rows were left out, by reason; and what was put right without a loss.
        labels: what each vehicle is, by its id; of those that the table gives a label.
        unused: the columns of which nothing was read.
        origin: of the plane, where places were latitudes and longitudes.
    """

    tracks: Tracks
    detections: Mapping[str, Detections] = field(default_factory=dict)
    losses: Losses = field(default_factory=Losses)
    labels: Mapping[int | str, str] = field(default_factory=dict)
    unused: Sequence[str] = ()
    origin: Origin | None = None

    def rows(self) -> VehicleRows:
        """The tracks as rows, to be joined with others."""
        tracks = self.tracks
        return VehicleRows.of(
            tracks.track_id, time_ns=tracks.time_ns, position=tracks.position, direction=tracks.direction,
            speed=tracks.speed, group=tracks.group, size=tracks.size, heading=tracks.heading,
        )  # fmt: skip


def table_of(
    rows: VehicleRows,
    *,
    label: AnyArray | None = None,
    sensor: AnyArray | None = None,
    losses: Losses | None = None,
    unused: Sequence[str] = (),
) -> Table:
    """The table of rows: bad ones dropped and counted, times in order, ids unique.

    Dropped are rows whose time or position is missing or beyond `FARTHEST_M`, with an infinite number, with a negative
    speed, and of two rows of a vehicle at one time the second. A vehicle id that stands in two groups means two
    vehicles: all ids become `group/id`. Where the course is missing in a row of a vehicle it is derived from all its
    positions, and so is the speed; a row that stands alone in time, and has no heading, is then dropped as well.
    Where some rows have no id, or a turn signal, or each would be alone, all are detections.

    Args:
        rows: as they were read, bad ones among them.
        label: (n,) str, what the vehicle is, empty where unknown; None where the table has none.
        sensor: (n,) str, what detected it; None where the table has none.
        losses: what the reader left out, or put right, before.
        unused: the columns of which nothing was read.
    """
    losses = losses or Losses()
    finite = (rows.time_ns != NO_TIME) & (np.abs(rows.position) <= FARTHEST_M).all(axis=1)
    finite &= ~np.isinf(rows.direction) & ~np.isinf(rows.speed) & ~np.isinf(rows.heading)
    good = finite & ~(rows.speed < 0)
    losses.drop("negative speed", finite & ~good)
    losses.drop("a number that is missing, not finite or too large", ~finite)
    as_read = rows = replace(rows, size=known_sizes(rows.size))
    is_named = (np.strings.strip(rows.names) != "")[rows.vehicle]
    seen, kept = np.flatnonzero(good), np.flatnonzero(good & is_named)
    own, vehicle = np.unique(rows.vehicle[kept], return_inverse=True)  # without the empty id, all others may be numbers
    rows = replace(rows[kept], names=rows.names[own], vehicle=vehicle)
    names, vehicle = _vehicles(rows, losses)
    rows = replace(rows, names=np.array(names, np.str_), vehicle=vehicle)
    repeated = repeated_rows(rows.vehicle, rows.time_ns)
    losses.drop("a second row of a vehicle at one time", repeated)
    rows, kept = rows[~repeated], kept[~repeated]
    late = _n_out_of_order(rows.vehicle, rows.time_ns)
    losses.note("rows earlier than the row before of the same vehicle; sorted", late)
    partly = int((rows.has_motion() & ~rows.is_known_throughout()).sum())
    losses.note("rows of vehicles whose course or speed is known of a part; derived from positions", partly)
    labels = {} if label is None else _labels(as_track_ids(rows.names)[rows.vehicle], label[kept], losses)
    alone = Losses()
    tracks = rows.to_tracks(alone)
    if len(tracks):
        losses += alone
    if len(tracks) and seen.size == np.count_nonzero(good & is_named) and np.isnan(as_read.cue).all():
        seen = seen[:0]
    detections = _detections(as_read, seen, sensor)
    return Table(tracks=tracks, detections=detections, losses=losses, labels=labels, unused=unused)


def _detections(rows: VehicleRows, seen: IntArray, sensor: AnyArray | None) -> dict[str, Detections]:
    """The rows (k,) that are detections, by sensor."""
    of = np.full(seen.size, "") if sensor is None else sensor[seen]
    detections = {}
    for name in dict.fromkeys(of.tolist()):
        own = rows[seen[of == name]]
        detections[name] = Detections(
            track_id=np.strings.strip(own.names)[own.vehicle], time_ns=own.time_ns, position=own.position,
            direction=own.direction, speed=own.speed, size=own.size, cue=own.cue, group=own.group,
        )  # fmt: skip
    return detections


def _labels(track_id: AnyArray, label: AnyArray, losses: Losses) -> dict[int | str, str]:
    """Of each vehicle that has labels the most frequent one, of equally frequent the first by name."""
    pairs = Counter(pair for pair in zip(track_id.tolist(), label.tolist(), strict=True) if pair[1])
    labels: dict[int | str, str] = {}
    for vehicle, name in sorted(pairs, key=lambda pair: (-pairs[pair], pair[1])):
        labels.setdefault(vehicle, name)
    other = sum(n for (vehicle, name), n in pairs.items() if labels[vehicle] != name)
    losses.note("rows with another label than most of their vehicle's; it has that of most", other)
    return labels


def _vehicles(rows: VehicleRows, losses: Losses) -> tuple[Sequence[str], IntArray]:
    """Names, and the vehicle of each row among them: an id in two groups means two vehicles."""
    names = rows.names.tolist()
    groups, group = np.unique(rows.group, return_inverse=True)
    pairs, vehicle = np.unique(group * len(names) + rows.vehicle, return_inverse=True)
    pair_group, pair_name = np.divmod(pairs, len(names))
    shared = int((np.bincount(pair_name) > 1).sum())
    if not shared:
        return names, rows.vehicle
    losses.note("vehicle ids that stand in several groups; all ids became group/id", shared)
    of_pairs = zip(groups[pair_group].tolist(), pair_name.tolist(), strict=True)
    return [f"{of}/{names[name]}" for of, name in of_pairs], vehicle


def _n_out_of_order(vehicle: IntArray, time_ns: IntArray) -> int:
    """How many rows are earlier than the row before of the same vehicle."""
    order = np.argsort(vehicle, kind="stable")
    return int(((np.diff(vehicle[order]) == 0) & (np.diff(time_ns[order]) < 0)).sum())
