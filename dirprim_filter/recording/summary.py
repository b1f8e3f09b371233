"""What stands in a log, topic by topic: the contents of `dirprim info`."""

from __future__ import annotations

import logging
from dataclasses import asdict, dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

from google.protobuf.message import DecodeError

from dirprim_filter.recording.damage import Damage
from dirprim_filter.recording.decoding import Decoders, is_decodable
from dirprim_filter.recording.records import Channel, Message
from dirprim_filter.recording.scan import Scan
from dirprim_filter.recording.schemas import ESTIMATES_SCHEMA
from dirprim_filter.recording.schemas.dirprim import decode_estimates

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicSummary:
    """One topic of one schema.

    Attributes:
        name: the topic.
        schema: name of its schema; empty where it has none.
        encoding: of its messages.
        messages: how many could be read.
        tracks: distinct track ids in them; None where the schema carries none.
    """

    name: str
    schema: str
    encoding: str
    messages: int
    tracks: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class LogSummary:
    """What stands in a log.

    Attributes:
        topics: by name.
        messages: how many could be read.
        start_ns: the first log time; None where there is no message.
        end_ns: the last log time.
        damage: what could not be read.
    """

    topics: tuple[TopicSummary, ...]
    messages: int
    start_ns: int | None
    end_ns: int | None
    damage: tuple[Damage, ...]

    def as_json(self) -> dict[str, Any]:
        """The same in types that json writes."""
        return {
            "topics": [asdict(topic) for topic in self.topics],
            "messages": self.messages,
            "start_ns": self.start_ns,
            "end_ns": self.end_ns,
            "damage": [asdict(damage) for damage in self.damage],
        }


@dataclass(slots=True)
class _Tally:
    messages: int = 0
    track_ids: set[str] = field(default_factory=set)


def inspect(path: str | PathLike[str]) -> LogSummary:
    """Read a log once and tell what is in it.

    Raises:
        NotMcapError: the file is no MCAP log.
        OSError: it cannot be opened.
    """
    decoders = Decoders()
    start_ns = end_ns = None
    undecodable = 0
    with Scan(Path(path)) as log:
        tallies = {_key(channel): _Tally() for channel in log.channels()}
        for message in log:
            start_ns = message.log_time_ns if start_ns is None else start_ns
            end_ns = message.log_time_ns
            tally = tallies.setdefault(_key(message.channel), _Tally())
            tally.messages += 1
            try:
                tally.track_ids.update(_track_ids(message, decoders))
            except DecodeError:
                undecodable += 1
        damage = tuple(log.damage)
    if undecodable:
        logger.warning("%s: %d messages are not what their schema says", path, undecodable)
    topics = tuple(
        TopicSummary(
            name=name, schema=schema, encoding=encoding, messages=tally.messages,
            tracks=len(tally.track_ids) if has_tracks else None,
        )
        for (name, schema, encoding, has_tracks), tally in sorted(tallies.items())
    )  # fmt: skip
    return LogSummary(
        topics=topics,
        messages=sum(topic.messages for topic in topics),
        start_ns=start_ns,
        end_ns=end_ns,
        damage=damage,
    )


def _key(channel: Channel) -> tuple[str, str, str, bool]:
    has_tracks = is_decodable(channel) or channel.schema.name == ESTIMATES_SCHEMA
    return channel.topic, channel.schema.name, channel.message_encoding, has_tracks


def _track_ids(message: Message, decoders: Decoders) -> list[str]:
    if is_decodable(message.channel):
        return list(decoders.decode(message).track_id)
    if message.schema_name == ESTIMATES_SCHEMA:
        return [str(name) for name in decode_estimates(message.data).track_id.tolist()]
    return []
