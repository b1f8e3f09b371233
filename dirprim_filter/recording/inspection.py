"""Inspection: reading a log once, in whole, for its contents and its damage."""

from __future__ import annotations

import logging
from collections import Counter
from dataclasses import dataclass

import numpy as np
from google.protobuf.message import DecodeError

from dirprim_filter.recording.container.log import LogSource, Scan, opened
from dirprim_filter.recording.container.message_columns import MessageColumns
from dirprim_filter.recording.container.records import Channel
from dirprim_filter.recording.errors import DamagedRecordingError
from dirprim_filter.recording.name_patterns import matching
from dirprim_filter.recording.objects.options import EVERYTHING, ReadOptions
from dirprim_filter.recording.schemas import ESTIMATES_SCHEMA
from dirprim_filter.recording.schemas.decoders import Decoders, by_schema, pieces
from dirprim_filter.recording.schemas.dirprim import decode_estimates
from dirprim_filter.recording.summary import LogSummary, TopicSummary

logger = logging.getLogger(__name__)


@dataclass(slots=True)
class _Tally:
    """What was counted of a topic; no track ids where its schema carries none."""

    messages: int = 0
    track_ids: set[str] | None = None


def inspect(source: LogSource, options: ReadOptions = EVERYTHING) -> LogSummary:
    """Read a log once and summarise its contents.

    Args:
        source: the log.
        options: its topics, left out all; the log times that are wanted, `mapping` and `strict`.

    Raises:
        NotMcapError: the file is no MCAP log.
        DamagedRecordingError: strict, and the log is damaged.
        OSError: it cannot be opened.
    """
    topics = None if options.topics is None else matching(options.topics, of="topics")
    with opened(source) as one:
        options = options.of_log(one.start_ns)
        log = Scan(one, topics, start_ns=options.start_ns, end_ns=options.end_ns)
        reading = _Inspection(log, Decoders(options.mapping))
        for _, columns in log.parts():
            if len(columns):
                reading.take(columns)
        damage = tuple(log.damage)
        attachments = tuple(attachment.name for file in one.files for attachment in file.outline.attachments)
    if options.strict and damage:
        raise DamagedRecordingError(one.path, damage)
    if options.mapping and not any(tally.track_ids for tally in reading.tallies.values()):
        why = next(iter(reading.decoders.unreadable()), "in no message")
        logger.warning("%s: expected objects at %s, got none: %s", one.path, options.mapping, why)
    if reading.undecodable:
        logger.warning("%s: %d messages are not what their schema says", one.path, reading.undecodable)
    summaries = tuple(
        TopicSummary(
            name=name, schema=schema, encoding=encoding, messages=tally.messages,
            tracks=None if tally.track_ids is None else len(tally.track_ids),
        )
        for (name, schema, encoding), tally in sorted(reading.tallies.items(), key=lambda item: item[0])
    )  # fmt: skip
    return LogSummary(
        topics=summaries,
        messages=sum(topic.messages for topic in summaries),
        start_ns=reading.start_ns,
        end_ns=reading.end_ns,
        damage=damage,
        is_checked=True,
        groups={
            topic: dict(sorted(counts.items())) for topic, counts in sorted(reading.groups.items()) if len(counts) > 1
        },
        labels={
            topic: dict(sorted(counts.items()))
            for topic, counts in sorted(reading.labels.items())
            if set(counts) != {""}
        },
        attachments=attachments,
        metadata=tuple(name for name, _ in log.metadata),
    )


class _Inspection:
    """Counts, chunk after chunk in the order of the file."""

    def __init__(self, log: Scan, decoders: Decoders) -> None:
        self.labels: dict[str, Counter[str]] = {}
        self.groups: dict[str, Counter[int]] = {}
        self.undecodable = 0
        self.start_ns: int | None = None
        self.end_ns: int | None = None
        self.tallies: dict[tuple[str, str, str], _Tally] = {}
        self._log = log
        self.decoders = decoders
        for channel in log.channels():
            if log.is_wanted(channel.topic):
                self._tally(channel)

    def take(self, columns: MessageColumns) -> None:
        """The messages of a chunk, of which there is at least one."""
        first_ns, last_ns = int(columns.log_time_ns[0]), int(columns.log_time_ns[-1])
        self.start_ns = first_ns if self.start_ns is None else min(self.start_ns, first_ns)
        self.end_ns = last_ns if self.end_ns is None else max(self.end_ns, last_ns)
        for i, n in zip(*np.unique(columns.channel, return_counts=True), strict=True):
            self._tally(columns.channels[i]).messages += int(n)
        for piece in pieces(columns[columns.by_channel(lambda channel: self._tally(channel).track_ids is not None)]):
            for _, messages in by_schema(piece):
                if messages.first_channel.schema.name == ESTIMATES_SCHEMA:
                    self._take_estimates(messages)
                else:
                    self._take_objects(messages)

    def _tally(self, channel: Channel) -> _Tally:
        key = (channel.topic, channel.schema.name, channel.message_encoding)
        if key not in self.tallies:
            self.tallies[key] = _Tally(track_ids=set() if self._has_tracks(channel) else None)
        return self.tallies[key]

    def _has_tracks(self, channel: Channel) -> bool:
        return channel.schema.name == ESTIMATES_SCHEMA or self.decoders.carries_objects(channel)

    def _take_objects(self, messages: MessageColumns) -> None:
        rows, failures = self.decoders.rows(messages)
        is_placed = np.asarray(np.isfinite(rows.position).all(axis=1))  # else not where `--fields` says
        channel = messages.channel[rows.message]
        order = np.argsort(channel, kind="stable")
        for own in np.split(order, np.flatnonzero(np.diff(channel[order])) + 1) if len(rows) else ():
            of, here = messages.channels[channel[own[0]]], rows[own]
            if (ids := self._tally(of).track_ids) is not None:
                ids.update(here.track_id[is_placed[own]].tolist())
            self.labels.setdefault(of.topic, Counter()).update(here.label.tolist())
            self.groups.setdefault(of.topic, Counter()).update(here.group.tolist())
        self.undecodable += len(failures)

    def _take_estimates(self, messages: MessageColumns) -> None:
        for message in messages.messages():
            known = self._tally(message.channel).track_ids
            try:
                names = decode_estimates(message.data).track_id.tolist()
            except DecodeError:
                self.undecodable += 1
                continue
            if known is not None:
                known.update(map(str, names))
