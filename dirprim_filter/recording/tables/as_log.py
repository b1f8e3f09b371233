"""A table in place of a log: as what `dirprim convert` would make of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from dirprim_filter.arrays import BoolArray
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.name_patterns import matching
from dirprim_filter.recording.objects.options import ReadOptions
from dirprim_filter.recording.summary import LogSummary, TopicSummary
from dirprim_filter.recording.tables import Table, read_as
from dirprim_filter.recording.topic_names import DETECTIONS, OBJECTS
from dirprim_filter.recording.transforms.geodesy import check_kind
from dirprim_filter.tracks import Tracks


def read_table(path: Path, options: ReadOptions) -> Table:
    """Of a table what is asked for; what is left out is in its losses.

    Topics are those of the log that `dirprim convert` would make of it; options about messages mean nothing here.

    Raises:
        RecordingError: as the reader of the format; or rows are left out, and all must be read.
        ValueError: there is no such format, or not all is stated that it needs.
        OSError: the file cannot be read.
    """
    table = read_as(path, options.format, options.origin)
    if options.meets:
        check_kind(path, is_geodetic=table.is_geodetic, origin=options.origin, meets=options.meets)
    if options.strict and table.losses.dropped:
        raise RecordingError(f"{path}: expected a table of which all is read, left out {table.losses}; mend the rows")
    rows: list[Tracks | Detections] = [table.tracks, *table.detections.values()]
    options = options.of_log(min((int(part.time_ns.min()) for part in rows if len(part)), default=None))
    is_topic = (lambda _: True) if options.topics is None else matching(options.topics, of="topics")

    def wanted(rows: Tracks | Detections) -> BoolArray:
        label = np.array([table.labels.get(name, "") for name in rows.track_id.tolist()] if options.labels else "")
        return options.wants(rows.time_ns, rows.group, np.broadcast_to(label, len(rows)))

    named = {f"{DETECTIONS}/{name}".rstrip("/"): seen for name, seen in table.detections.items()}
    detections = {topic: seen[wanted(seen)] for topic, seen in named.items() if is_topic(topic)}
    tracks = table.tracks[wanted(table.tracks)] if is_topic(OBJECTS) else table.tracks[:0]
    return replace(table, tracks=tracks, detections=detections)


def summary_of(table: Table) -> LogSummary:
    """What `read_table` has read as the contents of a log, of which rows are the messages."""
    parts = {OBJECTS: table.tracks} if len(table.tracks) or not table.detections else {}
    sources: dict[str, Tracks | Detections] = {**parts, **table.detections}
    label = Counter(table.labels.get(name, "") for name in table.tracks.track_id.tolist())
    group = {topic: dict(Counter(rows.group.tolist())) for topic, rows in sources.items()}
    times = np.concatenate([rows.time_ns for rows in sources.values()]).tolist()
    return LogSummary(
        topics=tuple(
            TopicSummary(name=topic, schema="", encoding="", messages=len(rows), tracks=len({*rows.track_id} - {NO_ID}))
            for topic, rows in sources.items()
        ),
        messages=len(times), start_ns=min(times, default=None), end_ns=max(times, default=None), damage=(),
        is_checked=True, labels={OBJECTS: dict(label)} if table.labels else {},
        groups={topic: counts for topic, counts in group.items() if len(counts) > 1}, attachments=(), metadata=(),
    )  # fmt: skip


class TableDetections:
    """Iterates the detections of a table as a `DetectionStream` does those of a log.

    Attributes:
        topics: those of the log that `dirprim convert` would make of it.
        losses: what was left out.
    """

    def __init__(self, path: Path, options: ReadOptions, *, motion: bool) -> None:
        table = read_table(path, options)
        if table.too_early:
            raise table.too_early
        table.log(path)
        sources = dict(table.detections) or {OBJECTS: _detected(table.tracks)}
        self.topics, self.losses = frozenset(sources), table.losses
        seen = Detections.concatenate(sources.values())
        seen = seen if motion else replace(seen, direction=np.empty(0), speed=np.empty(0))
        self._seen = seen if options.group is None else replace(seen, group=np.zeros_like(seen.group))

    @property
    def end_ns(self) -> int | None:
        """The last time."""
        return int(self._seen.time_ns.max()) if len(self._seen) else None

    def __iter__(self) -> Iterator[Detections]:
        """The instants."""
        return self._seen.frames()


def _detected(tracks: Tracks) -> Detections:
    return replace(Detections.of(tracks), direction=tracks.direction, speed=tracks.speed, size=tracks.size)
