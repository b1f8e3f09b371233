"""Tables, one reader for each format; and a table in place of a log: as what `dirprim convert` would make of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from dirprim_filter.arrays import BoolArray
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.origin import Origin
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.name_patterns import FORMATS, form_of, matching, named_values
from dirprim_filter.recording.objects.options import ReadOptions
from dirprim_filter.recording.summary import LogSummary, TopicSummary
from dirprim_filter.recording.tables.datasets import read_sdd, read_sumo_fcd, read_trajnet
from dirprim_filter.recording.tables.named_columns import COLUMNS, read_named
from dirprim_filter.recording.tables.table import Table
from dirprim_filter.recording.topic_names import DETECTIONS, OBJECTS
from dirprim_filter.recording.transforms.geodesy import check_kind
from dirprim_filter.tracks import Tracks

__all__ = ["READERS", "Table", "TableDetections", "read_as", "read_named", "read_table", "summary_of"]

READERS: Mapping[str, Callable[..., Table]] = {
    **dict.fromkeys(FORMATS, read_named),
    "sumo-fcd": read_sumo_fcd, "sdd": read_sdd, "trajnet": read_trajnet,
}  # fmt: skip
STATED = {"sdd": {"metres_per_pixel": True, "frames_per_second": False}, "trajnet": {"frames_per_second": True}}
"""Numbers that tables of a format do not contain, and whether one must be stated."""


def read_as(path: Path, stated: str | None = None, origin: Origin | None = None) -> Table:
    """A table of any format.

    Args:
        path: the file.
        stated: the format, and what the table does not contain, such as `trajnet,frames_per_second=25`; or what a table
            of named columns calls them, such as `csv,x_m=Easting,track_id=Id`, and which not to read, such as
            `heading=`. Left out: as the name of the file ends.
        origin: of the plane.

    Raises:
        RecordingError: as its reader.
        ValueError: there is no such format, or not all is stated that it needs.
        OSError: the file cannot be read.
    """
    form, _, rest = (stated or form_of(path)).partition(",")
    if form not in READERS:
        raise ValueError(f"format: expected one of {', '.join(READERS)}, got {form!r}")
    read, takes, is_named = READERS[form], STATED.get(form, {}), READERS[form] is read_named
    if rest and not (takes or is_named):
        raise ValueError(f"format {form}: expected nothing more, got {rest!r}")
    given = named_values(rest, COLUMNS if is_named else takes, of=f"format {form}", emptied=is_named) if rest else {}
    if is_named:
        return read(path, columns=given, origin=origin)
    if missing := [name for name, is_needed in takes.items() if is_needed and name not in given]:
        way = f"--set format={form},{missing[0]}=... states it"
        raise ValueError(f"{path}: expected {missing[0]}, which a table of {form} does not contain; {way}")
    return read(path, **{name: float(number) for name, number in given.items()}).on_plane(origin)


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
    times = np.concatenate([rows.time_ns for rows in (table.detections or parts).values()]).tolist()  # once each
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
        held = {name: getattr(table.tracks, name) for name in ("direction", "speed", "size")}
        sources = dict(table.detections) or {OBJECTS: replace(Detections.of(table.tracks), **held)}
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
