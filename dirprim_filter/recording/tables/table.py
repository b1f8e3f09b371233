"""What every table format becomes: tracks, detections, and an account of the rows that were left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self

import numpy as np

from dirprim_filter.arrays import AnyArray
from dirprim_filter.columns import NO_COVARIANCE, is_broken_covariance, is_held, known_covariances, known_sizes
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.origin import Origin
from dirprim_filter.recording.decoding.field_columns import NO_TIME
from dirprim_filter.recording.errors import TableError, warn
from dirprim_filter.recording.losses import Losses
from dirprim_filter.recording.plausibility import plausible
from dirprim_filter.recording.rows import Rows
from dirprim_filter.recording.transforms.geodesy import FARTHEST_M
from dirprim_filter.track_ids import as_track_ids, numbered, rows_of_each, stand_for_none
from dirprim_filter.tracks import Tracks

SEEN = ("time_ns", "position", "direction", "speed", "size", "cue", "group", "confidence", "covariance")
"""Columns of rows that detections hold too."""
MINUS_ONE = "rows of id -1, taken for a vehicle; empty the cells where -1 stands for none"


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """The tracks and the detections of a table.

    Attributes:
        tracks: the rows that are good, of vehicles with an id.
        detections: where rows have no id, a turn signal, confidence or covariance, or are alone in time, all good ones,
            by sensor; the name is empty where the table has none.
        losses: how many rows were left out, by reason; and what was put right without a loss.
        labels: what each vehicle is, by its id; of those that the table gives a label.
        used: the columns that were read, by our names for them.
        unused: those of which nothing was read.
        too_early: of the first row of a time before 1970, to be raised where a log is to be made of the rows.
        is_geodetic: places were latitudes and longitudes, or on the plane of an origin that the table states.
    """

    tracks: Tracks
    detections: Mapping[str, Detections] = field(default_factory=dict)
    losses: Losses = field(default_factory=Losses)
    labels: Mapping[int | str, str] = field(default_factory=dict)
    used: Sequence[str] = ()
    unused: Sequence[str] = ()
    too_early: TableError | None = None
    is_geodetic: bool = False

    def log(self, path: Path) -> None:
        """Warnings for what was left out, is odd, or is not used."""
        self.losses.log(path)
        if self.unused:
            warn(path, f"columns not used: {', '.join(self.unused)}")

    @property
    def origin(self) -> Origin | None:
        """Of the plane, where there is one."""
        return self.tracks.origin

    def on_plane(self, origin: Origin | None, *, is_geodetic: bool = False) -> Self:
        """The same of the plane of this origin."""
        detections = {name: seen.on_plane(origin) for name, seen in self.detections.items()}
        return replace(self, tracks=self.tracks.on_plane(origin), detections=detections, is_geodetic=is_geodetic)


def table_of(path: Path, rows: Rows, *, sensor: AnyArray | None = None, losses: Losses | None = None) -> Table:
    """The table of rows: bad ones dropped and counted, times in order, ids unique.

    Dropped are rows whose time or position is missing or beyond `FARTHEST_M`, with an infinite number, with a negative
    speed, and of two rows of a vehicle at one time the second. A vehicle id that stands in two groups means two
    vehicles: all ids become `group/id`. Where the course is missing in a row of a vehicle it is derived from all its
    positions, and so is the speed; a row that stands alone in time, and has no heading, is then dropped as well.
    Where rows have no id, or what tracks do not hold, or are alone but not their vehicle's only row, all are seen too.

    Args:
        path: the file.
        rows: as they were read, with `names`, bad ones among them.
        sensor: (n,) str, what detected it; None where the table has none.
        losses: what the reader left out, or put right, before.
    """
    losses = losses or Losses()
    finite = (rows.time_ns != NO_TIME) & (np.abs(rows.position) <= FARTHEST_M).all(axis=1)
    finite &= ~np.isinf(rows.direction) & ~np.isinf(rows.speed) & ~np.isinf(rows.heading)
    good = finite & ~(rows.speed < 0)
    losses.drop("with a negative speed", finite & ~good)
    losses.drop("with a number that is missing, not finite or too large", ~finite)
    rows = replace(rows, size=known_sizes(rows.size), message=np.arange(len(rows)))
    is_none = stand_for_none(rows.names, rows.track_id, rows.time_ns)
    losses.note(MINUS_ONE, int(((rows.names == "-1") & ~is_none)[rows.track_id].sum()))
    losses.note(NO_COVARIANCE, int(is_broken_covariance(rows.covariance).sum()))
    rows = replace(rows, names=np.where(is_none, NO_ID, rows.names))
    is_named = good & ~is_none[rows.track_id]
    own = rows[is_named].by_group()  # without the empty id, all others may be numbers
    if n_shared := own.names.size - np.unique(own.names).size:
        losses.note("vehicles whose id stands in several groups; all ids became group/id", n_shared)
        group = own.group[np.unique(own.track_id, return_index=True)[1]]
        own = replace(own, names=np.strings.add(np.strings.add(group.astype(np.str_), "/"), own.names))
    own = plausible(own, losses, path)
    order = np.argsort(own.track_id, kind="stable")
    n_back = int(((np.diff(own.track_id[order]) == 0) & (np.diff(own.time_ns[order]) < 0)).sum())
    losses.note("rows earlier than the row before of the same vehicle; sorted", n_back)
    partly = int((own.has_motion() & ~own.is_known_throughout()).sum())
    losses.note("rows of vehicles whose course or speed is known of a part; derived from positions", partly)
    labels, alone = _labels(own, losses), Losses()
    tracks = own.to_tracks(alone)
    losses += alone if len(tracks) else Losses()
    is_once = (np.bincount(own.track_id) == 1)[own.track_id] & ~own.has_motion() & np.isnan(own.heading)
    not_held = rows.cue, rows.confidence, known_covariances(rows.covariance)  # by tracks
    is_seen = any(map(is_held, not_held)) or len(own) - len(tracks) > is_once.sum()
    if len(tracks) and (good == is_named).all() and not is_seen:
        return Table(tracks=tracks, losses=losses, labels=labels)
    rest, names = rows[good & ~is_named], np.append(own.names, rows.names)
    seen = Rows.concatenate([own, replace(rest, track_id=rest.track_id + own.names.size)], names=names)
    seen = seen[np.argsort(seen.message)]
    detections = _detections(seen, np.full(len(seen), "") if sensor is None else sensor[seen.message])
    return Table(tracks=tracks, detections=detections, losses=losses, labels=labels)


def _detections(rows: Rows, sensor: AnyArray) -> dict[str, Detections]:
    """All rows, by the sensor of each."""
    rows = replace(rows, covariance=known_covariances(rows.covariance))
    ids, (sensors, of) = np.strings.strip(rows.names)[rows.track_id], numbered(sensor)
    return {
        name: Detections(track_id=ids[own], **{column: getattr(rows[own], column) for column in SEEN})
        for name, own in zip(sensors, rows_of_each(of), strict=True)
    }


def _labels(rows: Rows, losses: Losses) -> dict[int | str, str]:
    """Of each vehicle that has labels the most frequent one, of equally frequent the first by name."""
    labels: dict[int | str, str] = {}
    if not (rows.label != "").any():
        return labels
    names = as_track_ids(rows.names)[rows.track_id].tolist()
    pairs = Counter(pair for pair in zip(names, rows.label.tolist(), strict=True) if pair[1])
    for vehicle, name in sorted(pairs, key=lambda pair: (-pairs[pair], pair[1])):
        labels.setdefault(vehicle, name)
    other = sum(n for (vehicle, name), n in pairs.items() if labels[vehicle] != name)
    losses.note("rows with another label than most of their vehicle's; it has that of most", other)
    return labels
