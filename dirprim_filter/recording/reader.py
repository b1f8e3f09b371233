"""Observed motion, detections and estimates out of MCAP logs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from google.protobuf.message import DecodeError as ProtobufDecodeError

from dirprim_filter.course import LONGEST_GAP_S
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.estimates import Assignments, Estimates
from dirprim_filter.origin import Origin
from dirprim_filter.recording import topic_names
from dirprim_filter.recording.container.budget import most_rows
from dirprim_filter.recording.container.errors import Damage
from dirprim_filter.recording.container.log import Log, LogSource, Scan, opened
from dirprim_filter.recording.decoding.field_columns import NANOSECONDS
from dirprim_filter.recording.errors import DamagedRecordingError, NoTracksError, RecordingError
from dirprim_filter.recording.inspection import inspect
from dirprim_filter.recording.losses import ALONE, Losses
from dirprim_filter.recording.name_patterns import is_table
from dirprim_filter.recording.objects.observations import DetectionStream, Observations
from dirprim_filter.recording.objects.options import EVERYTHING, ReadOptions, TimeSource
from dirprim_filter.recording.objects.topics import choose_topics
from dirprim_filter.recording.plausibility import DetectionsAloneError, plausible
from dirprim_filter.recording.rows import Rows, TrackResult, rows_of_log, rows_of_logs
from dirprim_filter.recording.schemas import ASSIGNMENTS_SCHEMA, ESTIMATES_SCHEMA
from dirprim_filter.recording.schemas.dirprim import decoded
from dirprim_filter.recording.schemas.family import FieldMapping
from dirprim_filter.recording.summary import LogSummary, TopicSummary
from dirprim_filter.recording.transforms.transform_tree import SharedTransforms
from dirprim_filter.track_ids import vehicle_numbers
from dirprim_filter.tracks import Tracks

if TYPE_CHECKING:
    from dirprim_filter.recording.tables import TableDetections

__all__ = [
    "Damage", "DetectionStream", "FieldMapping", "LogSummary", "Losses", "Origin", "ReadOptions", "TimeSource",
    "TopicSummary", "TrackResult", "inspect", "read_assigned", "read_estimates", "read_track_logs", "read_tracks",
    "stream_detections",
]  # fmt: skip

PathOrText = str | PathLike[str]
SCHEMA_OF = {topic_names.ASSIGNED: ASSIGNMENTS_SCHEMA} | dict.fromkeys(
    (topic_names.ESTIMATES, topic_names.SMOOTHED), ESTIMATES_SCHEMA
)
"""Of the topics of a tracker that are read again."""


def read_tracks(source: LogSource | Sequence[PathOrText], options: ReadOptions = EVERYTHING, **changes: Any) -> Tracks:
    """The tracks of logs and tables; what could not be read is logged, and returned by `read_track_logs`.

    Direction and speed are taken where the log carries them for a whole track, and else derived from that
    track's positions by central differences. Of rows that repeat a vehicle and a time the first is kept.
    Groups of several logs are numbered anew, one after the other; an id that stands in more than one log gets
    the log's name in front.

    Args:
        source: a log, which may be open, or a .csv, .parquet or .feather; or several.
        options: what is read, and how.
        changes: fields of `ReadOptions` by name, in place of those of `options`.

    Raises:
        NotMcapError: a file is no MCAP log.
        NoTracksError: a log has no such topic, or none with moving objects.
        DamagedRecordingError: strict, and a log is damaged.
        DecodeError: strict, and a message is not what its schema says.
        MissingTransformError: no transform leads from an object's frame to the one asked for.
        ValueError: no log is given, or `topics` is neither a name nor a regular expression.
    """
    return read_track_logs(source, options, **changes).tracks


def read_track_logs(
    source: LogSource | Sequence[PathOrText], options: ReadOptions = EVERYTHING, *,
    progress: Callable[[int, int], None] | None = None, beside: Sequence[PathOrText] = (), **changes: Any,
) -> TrackResult:  # fmt: skip
    """As `read_tracks`, with what was lost.

    Args:
        source: a log or table, or several.
        options: what is read, and how.
        progress: gets how many of how many seconds are read.
        beside: logs whose transforms serve where a log has none, as do those of the others in `source`.
        changes: fields of `ReadOptions` by name.
    """
    sources: Sequence[LogSource] = [source] if isinstance(source, str | PathLike | Log) else list(source)
    if not sources:
        raise ValueError("source: expected at least one log, got none")
    losses = Losses()
    parts: list[Rows] = []
    names: list[str] = []
    frame, labels = "", dict[str, str]()
    options = replace(options, **changes)
    shared = SharedTransforms(one for one in (*sources, *beside) if not is_table(one))
    for one in sources:
        if is_table(one):
            from dirprim_filter.recording.tables import read_table  # noqa: PLC0415 - logs do without Arrow

            table = read_table(Path(one), options)
            seen = Detections.concatenate(table.detections.values())
            table.losses.note(ALONE, int(np.count_nonzero(seen.track_id == NO_ID)) * bool(len(table.tracks)))
            table.log(Path(one))
            if not len(table.tracks):
                _require_ids(Path(one), seen)
            parts.append(Rows.of_tracks(table.tracks))
            names.append(Path(one).name.partition(".")[0])
            losses += table.losses
            labels |= {str(name): label for name, label in table.labels.items()}
            options = _of_first(one, options, table.origin)
            continue
        with opened(one) as log:
            own = options.of_log(log.start_ns)
            scan = _wanted(log, choose_topics(log, own), own)
            observations = Observations(scan, own, shared)
            read = rows_of_log(_rows_of(log, observations, labels, progress, scan.end_ns))
            parts.append(plausible(read, observations.losses, log.path))
            if np.count_nonzero(np.bincount(read.track_id)) >= len(read) and not read.has_motion().any():
                _require_ids(log.path, read)
            names.append(log.path.stem)
            observations.losses.log(log.path)
        losses += observations.losses
        frame = observations.frame.target
        options = _of_first(one, options, observations.frame.origin, frame)
    alone = Losses()
    tracks = rows_of_logs(parts, names).to_tracks(alone).on_plane(options.origin)
    alone.log(", ".join(str(one.path if isinstance(one, Log) else one) for one in sources))
    losses += alone
    frame = tracks.origin.frame if tracks.origin else frame
    return TrackResult(tracks=tracks, losses=losses, frame=frame, labels=labels)


def _require_ids(path: Path, seen: Detections | Rows) -> None:
    """Raises where there are detections alone, none with an id that comes again, or none soon enough."""
    is_named = seen.track_id != NO_ID if isinstance(seen, Detections) else np.zeros(len(seen), np.bool_)
    if np.unique(vehicle_numbers(seen.track_id, seen.group)[is_named]).size < is_named.sum():
        raise DetectionsAloneError(
            f"{path}: expected rows of a vehicle at most {LONGEST_GAP_S:g} s apart, for its course, got none; "
            "`dirprim track` tracks them as detections"
        )
    if len(seen):
        ids, way = "ids that come again" if is_named.any() else "ids", "`dirprim track --no-ids` tracks them"
        raise DetectionsAloneError(f"{path}: expected tracks, got {len(seen)} detections without {ids}; {way}")


def _of_first(one: LogSource, options: ReadOptions, origin: Origin | None, frame: str = "") -> ReadOptions:
    """The options for further logs: all are of the frame and plane of the first, unless another was asked for."""
    options = replace(options, frame=options.frame or frame or None)
    if options.origin is not None or options.meets:
        return options
    return replace(options, origin=origin, meets=str(one.path if isinstance(one, Log) else one))


def _rows_of(
    log: Log, observations: Observations, labels: dict[str, str], progress: Callable[[int, int], None] | None,
    end_ns: int | None,
) -> Iterator[Rows]:  # fmt: skip
    """The observed rows; labels get the last one of each vehicle that has one, progress after each part how far it is.

    Raises:
        RecordingError: a log holds more rows than its size allows.
    """
    n, most, first_ns = 0, most_rows(log.n_bytes), None
    for part in observations:
        n += len(part)
        if n > most:
            raise RecordingError(
                f"{log.path}: expected at most {most} rows of objects in so small a log, got more; if they are right, "
                "write it with less compression (`mcap decompress`)"
            )
        if (part.label != "").any():
            labels |= {name: of for name, of in zip(part.track_id.tolist(), part.label.tolist(), strict=True) if of}
        yield part
        first_ns = int(part.time_ns[0]) if first_ns is None else first_ns
        if progress is not None and end_ns is not None and end_ns > first_ns:
            progress((int(part.time_ns[-1]) - first_ns) // NANOSECONDS, math.ceil((end_ns - first_ns) / NANOSECONDS))


def stream_detections(
    source: LogSource, options: ReadOptions = EVERYTHING, *, motion: bool = False, live: bool = False, **changes: Any
) -> DetectionStream | TableDetections:
    """The detections of a log, an instant at a time, in bounded memory; or of a table.

    Args:
        source: the log, which may be open, or a .csv, .parquet or .feather.
        options: as for `read_tracks`; without topics, `/detections` goes before all others. Messages that go back in
            the time that counts are left out and counted.
        motion: take the log's directions and speeds for measurements. Often they are no sensor's, but were derived from
            the positions, and would count twice.
        live: of a pipe instants come as they are written, in its own order, with the transforms that came before the
            first; else all of it is waited for.
        changes: as for `read_tracks`.

    Raises:
        NotMcapError: the file is no MCAP log.
        NoTracksError: the log has no such topic, or none with moving objects.
        ValueError: `topics` is neither a name nor a regular expression.
    """
    options = replace(options, **changes)
    if is_table(source):
        from dirprim_filter.recording.tables import TableDetections  # noqa: PLC0415 - logs do without Arrow

        return TableDetections(Path(source), options, motion=motion)
    log = source if isinstance(source, Log) else Log(source, live=live)
    options = options.of_log(log.start_ns)
    chosen = choose_topics(log, options, prefer_detections=True)
    return DetectionStream(_wanted(log, chosen, options), options, topics=chosen, motion=motion)


def _wanted(log: Log, topics: frozenset[str], options: ReadOptions) -> Scan:
    """The messages of topics; chunks of log times that are not wanted stay closed."""
    if options.time_source != "log":
        return Scan(log, topics.__contains__)
    return Scan(log, topics.__contains__, start_ns=options.start_ns, end_ns=options.end_ns)


def read_estimates(source: LogSource, *, smoothed: bool = False, losses: Losses | None = None) -> Estimates:
    """All estimates of a log that `dirprim track` wrote, in order of time; what could not be read is logged.

    Args:
        source: the log, which may be open.
        smoothed: those that `--smooth` or `--lag` wrote beside the filter's.
        losses: gets what could not be read.

    Raises:
        NotMcapError: the file is no MCAP log.
        NoTracksError: the log has no such topic.
    """
    topic = topic_names.SMOOTHED if smoothed else topic_names.ESTIMATES
    return Estimates.concatenate(_parts(source, topic, losses))


def read_assigned(source: LogSource, *, losses: Losses | None = None) -> Assignments:
    """Which track each detection was assigned to, of a log of `dirprim track`; the rest as `read_estimates`."""
    return Assignments.concatenate(_parts(source, topic_names.ASSIGNED, losses))


def _parts(source: LogSource, topic: str, losses: Losses | None) -> list[Any]:
    """What each message of a topic of ours holds."""
    own = Losses()
    with opened(source) as log:
        if not has_estimates(log, topic):
            wanted = f"topic {topic!r} of {SCHEMA_OF[topic]}"
            raise NoTracksError(log.path, has=log.channels(), wanted=wanted, damage=Scan(log).damage)
        found = [part for _, part in estimate_messages(log, topic, own)]
    if losses is not None:
        losses += own
    return found


def origin_of_estimates(path: PathOrText) -> Origin | None:
    """Of the plane of the estimates in a log that `dirprim track` or `smooth` wrote."""
    with Log(path) as log:
        topics = (topic for topic in (topic_names.ESTIMATES, topic_names.SMOOTHED) if has_estimates(log, topic))
        found = (rows.origin for topic in topics for _, rows in estimate_messages(log, topic, Losses()) if len(rows))
        return next(found, None)


def has_estimates(log: Log, topic: str) -> bool:
    """Whether a log has a topic of `SCHEMA_OF`, of its schema."""
    return any(channel.topic == topic and channel.schema.name == SCHEMA_OF[topic] for channel in log.channels())


def estimate_messages(
    log: Log, topic: str, losses: Losses, options: ReadOptions = EVERYTHING
) -> Iterator[tuple[int, Any]]:
    """The log time and the estimates, or assignments, of each message of a topic within the wanted times.

    Args:
        log: what is read.
        topic: of `SCHEMA_OF`.
        losses: gets what is damaged, and messages that are not what their schema says.
        options: the times, and `strict`.

    Raises:
        DamagedRecordingError: strict, and the log is damaged.
    """
    scan = Scan(log, topic.__eq__, start_ns=options.start_ns, end_ns=options.end_ns)
    messages, losses.damage = iter(scan), scan.damage
    for message in messages:
        if message.schema_name == SCHEMA_OF[topic]:
            try:
                yield message.log_time_ns, decoded(message.schema_name, message.data)
            except ProtobufDecodeError as error:
                losses.fail([str(error)])
    if options.strict and losses.damage:
        raise DamagedRecordingError(log.path, losses.damage)
    losses.log(log.path)
