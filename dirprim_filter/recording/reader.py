"""Observed motion, detections and estimates out of MCAP logs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Unpack

from google.protobuf.message import DecodeError as ProtobufDecodeError

from dirprim_filter.estimates import Estimates
from dirprim_filter.recording import topic_names
from dirprim_filter.recording.container.damage import Damage
from dirprim_filter.recording.container.log import Log, Scan
from dirprim_filter.recording.errors import DecodeError, NoTracksError
from dirprim_filter.recording.inspection import inspect
from dirprim_filter.recording.losses import ClockFaults, Drops
from dirprim_filter.recording.objects.detection_stream import DetectionStream
from dirprim_filter.recording.objects.observations import Observations, TimedRows, log_losses
from dirprim_filter.recording.objects.options import Reading, ReadOptions, TimeSource
from dirprim_filter.recording.objects.topics import choose_topics
from dirprim_filter.recording.objects.tracks import TrackResult, rows_of_log, rows_of_logs
from dirprim_filter.recording.schemas import ESTIMATES_SCHEMA
from dirprim_filter.recording.schemas.dirprim import decode_estimates
from dirprim_filter.recording.schemas.field_mapping import FieldMapping
from dirprim_filter.recording.summary import LogSummary, TopicSummary
from dirprim_filter.recording.transforms.geodesy import Origin
from dirprim_filter.recording.vehicle_rows import VehicleRows
from dirprim_filter.track_ids import repeated_rows
from dirprim_filter.tracks import Tracks

__all__ = [
    "Damage", "DetectionStream", "Drops", "FieldMapping", "LogSummary", "Origin", "TimeSource", "TopicSummary",
    "TrackResult", "inspect", "read_estimates", "read_track_logs", "read_tracks", "stream_detections",
]  # fmt: skip

PathOrText = str | PathLike[str]
NS_PER_S = 1_000_000_000


def read_tracks(
    source: PathOrText | Sequence[PathOrText],
    *,
    topics: str | None = None,
    **reading: Unpack[Reading],
) -> Tracks:
    """The tracks of a log, or of several; what could not be read is logged, and returned by `read_track_logs`.

    Direction and speed are taken where the log carries them for a whole track, and else derived from that
    track's positions by central differences. Of rows that repeat a vehicle and a time the first is kept.
    Groups of several logs are numbered anew, one after the other; an id that stands in more than one log gets
    the log's name in front.

    Args:
        source: a log, or several.
        topics: name of the topic, or a regular expression that matches topics in full. Left out: one topic,
            by what its schema holds: `dirprim.Observations` before ASAM OSI before `foxglove.SceneUpdate`; of
            several of one kind the one with most messages, `/detections...` last, `/dirprim/...` never.
        reading: any of these:
            time_source: "log" (the default), "publish" or "header": which time of a message counts.
            start_ns: the first time wanted, nanoseconds.
            end_ns: the first time no longer wanted.
            strict: raise at the first damage instead of going on.
            frame: in which frame positions are wanted; left out: the root of the tree of the log's transforms, which
                must not be a vehicle's. Without transforms all objects must be of one frame.
            mapping: where to find the fields of objects, for schemas that are not known.
            origin: of the plane for satellite positions; left out: the first position.
            labels: what the wanted objects are, such as "car|truck": a name or a regular expression for the label that
                their schema gives them, which is empty where it gives none.
            group: the one that is wanted of those that a log holds, by its number there: recordings made apart, whose
                times may overlap. Left out: all; an id that stands in several of them is a vehicle in each.

    Raises:
        NotMcapError: a file is no MCAP log.
        NoTracksError: a log has no such topic, or none with moving objects.
        DamagedRecordingError: strict, and a log is damaged.
        DecodeError: strict, and a message is not what its schema says.
        MissingTransformError: no transform leads from an object's frame to the one asked for.
        ValueError: no log is given, or `topics` is neither a name nor a regular expression.
    """
    return read_track_logs(source, topics=topics, **reading).tracks


def read_track_logs(
    source: PathOrText | Sequence[PathOrText],
    *,
    topics: str | None = None,
    progress: Callable[[int, int], None] | None = None,
    **reading: Unpack[Reading],
) -> TrackResult:
    """As `read_tracks`, with what was lost; `progress` gets how many of how many seconds are read."""
    paths = [Path(source)] if isinstance(source, str | PathLike) else [Path(path) for path in source]
    if not paths:
        raise ValueError("source: expected at least one log, got none")
    dropped, clock = Drops(), ClockFaults()
    damage: list[tuple[Path, Damage]] = []
    parts: list[VehicleRows] = []
    options = ReadOptions(**reading)
    for path in paths:
        with Log(path) as log:
            scan = _wanted(log, choose_topics(log, topics, options), options)
            observations = Observations(scan, options)
            rows = observations if progress is None else _reporting(observations, scan.end_ns, progress)
            read = rows_of_log(rows)
            repeated = repeated_rows(read.vehicle, read.time_ns)
            observations.drops.repeated += int(repeated.sum())
            parts.append(read[~repeated])
            damage += [(path, broken) for broken in scan.damage]
            log_losses(path, scan.damage, observations.drops, observations.clock)
        dropped += observations.drops
        clock += observations.clock
        options = replace(options, origin=observations.origin)  # one plane for all logs
    tracks, n_alone = rows_of_logs(parts, [path.stem for path in paths]).to_tracks()
    dropped.alone += n_alone
    return TrackResult(tracks=tracks, damage=tuple(damage), dropped=dropped, clock=clock, frame=observations.frame)


def _reporting(
    observations: Iterable[TimedRows], end_ns: int | None, progress: Callable[[int, int], None]
) -> Iterator[TimedRows]:
    """The same, and after each part how far that is."""
    first_ns: int | None = None
    for part in observations:
        yield part
        first_ns = int(part.time_ns[0]) if first_ns is None else first_ns
        if end_ns is not None and end_ns > first_ns:
            progress((int(part.time_ns[-1]) - first_ns) // NS_PER_S, math.ceil((end_ns - first_ns) / NS_PER_S))


def stream_detections(
    path: PathOrText,
    *,
    topics: str | None = None,
    motion: bool = False,
    **reading: Unpack[Reading],
) -> DetectionStream:
    """The detections of a log, an instant at a time, in bounded memory.

    Args:
        path: the log.
        topics: as for `read_tracks`; left out, `/detections` goes before all others.
        motion: take the log's directions and speeds for measurements. Often they are no sensor's, but were derived from
            the positions, and would be believed twice.
        reading: as for `read_tracks`; messages that go back in the time that counts are left out and counted.

    Raises:
        NotMcapError: the file is no MCAP log.
        NoTracksError: the log has no such topic, or none with moving objects.
        ValueError: `topics` is neither a name nor a regular expression.
    """
    options = ReadOptions(**reading)
    log = Log(path)
    chosen = choose_topics(log, topics, options, prefer_detections=True)
    return DetectionStream(_wanted(log, chosen, options), options, topics=chosen, motion=motion)


def _wanted(log: Log, topics: frozenset[str], options: ReadOptions) -> Scan:
    """The messages of topics; chunks of log times that are not wanted stay closed."""
    if options.time_source != "log":
        return log.scan(topics.__contains__)
    return log.scan(topics.__contains__, start_ns=options.start_ns, end_ns=options.end_ns)


def read_estimates(path: PathOrText, *, smoothed: bool = False, topic: str | None = None) -> Estimates:
    """All estimates of a log that `dirprim track` wrote, in order of time.

    Args:
        path: the log.
        smoothed: those that `--smooth` or `--lag` wrote beside the filter's.
        topic: a topic of `dirprim.TrackEstimates`; left out, the filter's or the smoother's.

    Raises:
        NotMcapError: the file is no MCAP log.
        NoTracksError: the log has no such topic.
        DecodeError: a message is not what its schema says.
    """
    topic = topic or (topic_names.SMOOTHED if smoothed else topic_names.ESTIMATES)
    parts = []
    with Log(path) as log:
        scan = log.scan(lambda name: name == topic)
        if not any(c.topic == topic and c.schema.name == ESTIMATES_SCHEMA for c in log.channels()):
            wanted = f"topic {topic!r} of {ESTIMATES_SCHEMA}"
            raise NoTracksError(log.path, has=log.channels(), wanted=wanted, damage=scan.damage)
        for message in scan:
            if message.schema_name == ESTIMATES_SCHEMA:
                try:
                    parts.append(decode_estimates(message.data))
                except ProtobufDecodeError as error:
                    raise DecodeError(
                        log.path, topic=topic, time_ns=message.log_time_ns,
                        expected=f"a message of {ESTIMATES_SCHEMA}", got=str(error),
                    ) from error  # fmt: skip
        log_losses(log.path, scan.damage, Drops())
    return Estimates.concatenate(parts)
