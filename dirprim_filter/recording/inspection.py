"""Inspection: reading a log once, in whole, for its contents and its damage."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np

from dirprim_filter.detections import NO_ID
from dirprim_filter.recording.container.log import LogSource, Scan, opened
from dirprim_filter.recording.container.message_columns import MessageColumns
from dirprim_filter.recording.container.records import Channel
from dirprim_filter.recording.errors import DamagedRecordingError, warn
from dirprim_filter.recording.name_patterns import matching
from dirprim_filter.recording.objects.options import EVERYTHING, ReadOptions
from dirprim_filter.recording.objects.topics import Failures
from dirprim_filter.recording.schemas import ESTIMATES_SCHEMA
from dirprim_filter.recording.schemas.decoders import Decoders, batches, by_schema
from dirprim_filter.recording.schemas.family import FieldMapping
from dirprim_filter.recording.summary import LogSummary, TopicKey, TopicSummary, key_of
from dirprim_filter.track_ids import rows_of_each

_ESTIMATES = FieldMapping.parse("id=.track_id[],x=.x[],y=.y[]")


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
        for batch in batches(reading.counted(log.parts()), reading.reads):
            for _, messages in by_schema(batch):
                reading.take_objects(messages)
        damage = tuple(log.damage)
        attachments = tuple(name for file in one.files for _, name in file.outline.attachments)
    if options.strict and damage:
        raise DamagedRecordingError(one.path, damage)
    found = tuple(map(reading.topic, sorted(reading.messages)))
    if options.mapping and not any(topic.tracks or topic.detections for topic in found):
        why = next((topic.why for topic in found if topic.why), "in no message")
        warn(one.path, f"expected objects at {options.mapping}, got none: {why}")
    return LogSummary(
        topics=found, messages=reading.messages.total(), damage=damage, is_checked=True, attachments=attachments,
        start_ns=min(reading.times, default=None), end_ns=max(reading.times, default=None),
        groups=_by_topic(reading.groups, lambda counts: len(counts) > 1),
        labels=_by_topic(reading.labels, lambda counts: set(counts) != {""}),
        metadata=tuple(name for name, _ in log.metadata),
    )  # fmt: skip


def _by_topic(counts: dict[str, Counter[Any]], is_shown: Callable[[Counter[Any]], bool]) -> dict[str, dict[Any, int]]:
    return {topic: dict(sorted(of.items())) for topic, of in sorted(counts.items()) if is_shown(of)}


class _Inspection:
    """Counts, chunk after chunk in the order of the file."""

    def __init__(self, log: Scan, decoders: Decoders) -> None:
        self.messages: Counter[TopicKey] = Counter()
        self.track_ids: dict[TopicKey, set[str]] = {}  # of topics whose schema carries objects
        self.detections: Counter[TopicKey] = Counter()
        self.labels: dict[str, Counter[str]] = {}
        self.groups: dict[str, Counter[int]] = {}
        self.refused: dict[TopicKey, str] = {}
        self.failures = Failures()
        self.times: list[int] = []  # the first and the last of each chunk
        self.decoders, self._estimates = decoders, Decoders(_ESTIMATES)
        for channel in log.channels():
            if log.is_wanted(channel.topic):
                self._count(channel, 0)

    def counted(self, parts: Iterable[MessageColumns]) -> Iterator[MessageColumns]:
        """The messages of chunks, once they are counted."""
        for columns in parts:
            if len(columns):
                self.times += columns.log_time_ns[[0, -1]].tolist()
                for i, n in zip(*np.unique(columns.channel, return_counts=True), strict=True):
                    self._count(columns.channels[i], int(n))
                yield columns

    def reads(self, channel: Channel) -> bool:
        """Whether the objects of a channel that was counted are looked at."""
        return key_of(channel) in self.track_ids

    def _count(self, channel: Channel, n: int) -> None:
        key = key_of(channel)
        if key not in self.messages:
            decoders = self._decoders_of(channel)
            self.refused[key] = decoders.refusal(channel)
            if decoders.carries_objects(channel):
                self.track_ids[key] = set()
        self.messages[key] += n

    def _decoders_of(self, channel: Channel) -> Decoders:
        return self._estimates if channel.schema.name == ESTIMATES_SCHEMA else self.decoders

    def take_objects(self, messages: MessageColumns) -> None:
        """The messages of one schema."""
        rows, failures = self._decoders_of(messages.first_channel).rows(messages)
        is_placed = np.asarray(np.isfinite(rows.position).all(axis=1))  # else not where `--fields` says
        channel = messages.channel[rows.message]
        for own in rows_of_each(channel):
            of, here = messages.channels[channel[own[0]]], rows[own]
            ids = here.track_id[is_placed[own]]
            self.track_ids[key_of(of)].update(ids[ids != NO_ID].tolist())
            self.detections[key_of(of)] += int((ids == NO_ID).sum())
            self.labels.setdefault(of.topic, Counter()).update(here.label.tolist())
            self.groups.setdefault(of.topic, Counter()).update(here.group.tolist())
        self.failures.take(messages, failures)

    def topic(self, key: TopicKey) -> TopicSummary:
        """What was counted of a topic."""
        name, schema, encoding = key
        n, reason = self.failures.of(key)
        return TopicSummary(
            name=name, schema=schema, encoding=encoding, messages=self.messages[key], detections=self.detections[key],
            tracks=len(self.track_ids[key]) if key in self.track_ids else None, undecodable=n,
            why=reason or self.refused[key],
        )  # fmt: skip
