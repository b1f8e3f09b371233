"""What stands in a log, topic by topic: the contents of `dirprim info`; of long logs by their index alone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from mcap.records import Statistics

from dirprim_filter.recording.container.errors import Damage
from dirprim_filter.recording.container.records import Channel
from dirprim_filter.recording.container.source import Files
from dirprim_filter.recording.container.summary_section import Summary, read_summary
from dirprim_filter.recording.name_patterns import matching

LONG_LOG_BYTES = 1 << 25
"""Shorter logs are read in whole: that takes about a second, and shows more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicSummary:
    """One topic of one schema.

    Attributes:
        name: the topic.
        schema: name of its schema; empty where it has none.
        encoding: of its messages.
        messages: how many could be read.
        tracks: distinct track ids in them; None where the schema carries none, or they were not counted.
        detections: objects without an id in them.
        undecodable: how many of the messages cannot be decoded.
        why: the most frequent reason; or why objects are not read of this topic; empty where they are.
    """

    name: str
    schema: str
    encoding: str
    messages: int
    tracks: int | None
    detections: int = 0
    undecodable: int = 0
    why: str = ""


TopicKey = tuple[str, str, str]
"""Topic, name of the schema and encoding."""


def key_of(channel: Channel) -> TopicKey:
    """What its messages are counted by."""
    return channel.topic, channel.schema.name, channel.message_encoding


@dataclass(frozen=True, slots=True, kw_only=True)
class LogSummary:
    """What stands in a log.

    Attributes:
        topics: by name.
        messages: how many could be read.
        start_ns: the first log time; None where there is no message, or where the index knows that of all topics only.
        end_ns: the last log time.
        damage: what could not be read.
        is_checked: every chunk was read; else all this is what the log's index says.
        labels: by topic, how many rows each label of its objects has; of topics that have labels.
        groups: by topic, how many rows each group of its objects has; of topics that have more than one.
        attachments: names of the files attached.
        metadata: names of the metadata records.
    """

    topics: tuple[TopicSummary, ...]
    messages: int
    start_ns: int | None
    end_ns: int | None
    damage: tuple[Damage, ...]
    is_checked: bool
    labels: Mapping[str, Mapping[str, int]]
    groups: Mapping[str, Mapping[int, int]]
    attachments: tuple[str, ...]
    metadata: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """The same in types that json writes."""
        return {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self).items()}


def summarise_by_index(
    files: Files, *, topics: str | None = None, from_bytes: int = LONG_LOG_BYTES
) -> LogSummary | None:  # fmt: skip
    """What a long log's own index says of it, without reading a chunk; None where it is short or has no whole index.

    Args:
        files: those of the log, open, as `log_files` gives them.
        topics: a name, or a regular expression that matches topics in full; left out: all.
        from_bytes: logs of this size are long.
    """
    if sum(len(bytes_of) for _, bytes_of in files) < from_bytes:
        return None
    wanted = None if topics is None else matching(topics, of="topics")
    messages, sections = Counter[TopicKey](), list[tuple[Summary, Statistics]]()
    for _, bytes_of in files:
        section = read_summary(bytes_of)
        if section is None or section.statistics is None:
            return None
        sections.append((section, section.statistics))
        for channel_id, channel in section.channels.items():
            if wanted is None or wanted(channel.topic):
                messages[key_of(channel)] += section.statistics.channel_message_counts.get(channel_id, 0)
    times = [(of.message_start_time, of.message_end_time) for _, of in sections if of.message_count and not wanted]
    return LogSummary(
        topics=tuple(
            TopicSummary(name=name, schema=schema, encoding=encoding, messages=n, tracks=None)
            for (name, schema, encoding), n in sorted(messages.items())
        ),
        messages=messages.total(), damage=(), is_checked=False, labels={}, groups={},
        start_ns=min((start for start, _ in times), default=None), end_ns=max((end for _, end in times), default=None),
        attachments=tuple(one.name for section, _ in sections for one in section.attachments),
        metadata=tuple(one.name for section, _ in sections for one in section.metadata),
    )  # fmt: skip
