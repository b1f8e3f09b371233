"""Reading a log once, in whole, to tell what is in it and what is broken."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike

import numpy as np
from google.protobuf.message import DecodeError

from dirprim_filter.recording.decoding import Decoders, by_schema, carries_objects
from dirprim_filter.recording.errors import DamagedRecordingError
from dirprim_filter.recording.message_columns import MessageColumns
from dirprim_filter.recording.records import Channel, Message
from dirprim_filter.recording.scan import Scan
from dirprim_filter.recording.schemas import ESTIMATES_SCHEMA
from dirprim_filter.recording.schemas.dirprim import decode_estimates
from dirprim_filter.recording.summary import LogSummary, Stamps, TopicSummary

logger = logging.getLogger(__name__)


@dataclass(slots=True)
class _Tally:
    messages: int = 0
    track_ids: set[str] = field(default_factory=set)


class _StampCounter:
    """Compares each log time with the one before of the same channel, chunk by chunk in the order of the file."""

    def __init__(self) -> None:
        self.zero = self.backward = self.duplicate = 0
        self._last: dict[int, int] = {}

    def take(self, columns: MessageColumns) -> None:
        order = np.lexsort((columns.start, columns.channel))
        times, channel = columns.log_time_ns[order], columns.channel[order]
        first = np.flatnonzero(np.diff(channel, prepend=-1))
        before = np.roll(times, 1)
        for row, one in zip(first.tolist(), channel[first].tolist(), strict=True):
            before[row] = self._last.get(one, 0)
        known = np.ones(len(times), np.bool_)
        known[first] = [one in self._last for one in channel[first].tolist()]
        self.zero += int((times == 0).sum())
        self.backward += int((known & (times < before)).sum())
        self.duplicate += int((known & (times == before) & (times > 0)).sum())
        last = np.append(first[1:], len(times)) - 1
        self._last |= dict(zip(channel[first].tolist(), times[last].tolist(), strict=True))


def inspect(
    path: str | PathLike[str],
    *,
    topics: Callable[[str], bool] | None = None,
    start_ns: int | None = None,
    end_ns: int | None = None,
    strict: bool = False,
) -> LogSummary:
    """Read a log once and tell what is in it.

    Args:
        path: the log.
        topics: says whether a topic is wanted.
        start_ns: the first log time wanted.
        end_ns: the first log time no longer wanted.
        strict: raise where something is damaged.

    Raises:
        NotMcapError: the file is no MCAP log.
        DamagedRecordingError: strict, and the log is damaged.
        OSError: it cannot be opened.
    """
    decoders = Decoders()
    stamps = _StampCounter()
    undecodable = 0
    first, last = [], []
    with Scan(path, topics, start_ns=start_ns, end_ns=end_ns) as log:
        wanted = [channel for channel in log.channels() if topics is None or topics(channel.topic)]
        tallies = {_key(channel): _Tally() for channel in wanted}
        for _, columns in log.parts():
            if not len(columns):
                continue
            first.append(int(columns.log_time_ns[0]))
            last.append(int(columns.log_time_ns[-1]))
            stamps.take(columns)
            counts = np.bincount(columns.channel, minlength=len(log.channel_list)).tolist()
            for channel, n in zip(log.channel_list, counts, strict=True):
                tallies.setdefault(_key(channel), _Tally()).messages += n
            carrying = np.array([_has_tracks(channel) for channel in log.channel_list])
            told = list(columns[carrying[columns.channel]].messages(log.channel_list))
            for _, messages in by_schema(told):
                undecodable += _count_tracks(messages, decoders, tallies)
        damage = tuple(log.damage)
        attachments = tuple(attachment.name for attachment in log.layout.attachments)
        metadata = tuple(name for name, _ in log.metadata)
    if strict and damage:
        raise DamagedRecordingError(path, damage)
    if undecodable:
        logger.warning("%s: %d messages are not what their schema says", path, undecodable)
    summaries = tuple(
        TopicSummary(
            name=name, schema=schema, encoding=encoding, messages=tally.messages,
            tracks=len(tally.track_ids) if has_tracks else None,
        )
        for (name, schema, encoding, has_tracks), tally in sorted(tallies.items())
    )  # fmt: skip
    return LogSummary(
        topics=summaries,
        messages=sum(topic.messages for topic in summaries),
        start_ns=min(first, default=None),
        end_ns=max(last, default=None),
        damage=damage,
        is_checked=True,
        stamps=Stamps(zero=stamps.zero, backward=stamps.backward, duplicate=stamps.duplicate),
        attachments=attachments,
        metadata=metadata,
    )


def _key(channel: Channel) -> tuple[str, str, str, bool]:
    return channel.topic, channel.schema.name, channel.message_encoding, _has_tracks(channel)


def _has_tracks(channel: Channel) -> bool:
    return carries_objects(channel) or channel.schema.name == ESTIMATES_SCHEMA


def _count_tracks(
    messages: Sequence[Message], decoders: Decoders, tallies: Mapping[tuple[str, str, str, bool], _Tally]
) -> int:
    """Tally the track ids of messages of one schema; -> how many messages could not be read."""
    if carries_objects(messages[0].channel):
        rows, failures = decoders.rows(messages)
        topics = [tallies[_key(message.channel)].track_ids for message in messages]
        for number, name in zip(rows.message.tolist(), rows.track_id.tolist(), strict=True):
            topics[number].add(name)
        return len(failures)
    undecodable = 0
    for message in messages:
        try:
            names = decode_estimates(message.data).track_id.tolist()
        except DecodeError:
            undecodable += 1
            continue
        tallies[_key(message.channel)].track_ids.update(str(name) for name in names)
    return undecodable
