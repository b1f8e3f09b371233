"""The objects that a log's messages tell of, message by message, and what had to be left out of them."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Literal, Self

import numpy as np
from google.protobuf.message import DecodeError as ProtobufDecodeError

from dirprim_filter.recording.damage import Damage
from dirprim_filter.recording.errors import DamagedRecordingError, DecodeError
from dirprim_filter.recording.records import Channel, Message
from dirprim_filter.recording.scan import Scan
from dirprim_filter.recording.schemas import DECODERS, Decoder
from dirprim_filter.recording.schemas.observed import ObservedFrame

logger = logging.getLogger(__name__)

TimeSource = Literal["log", "publish", "header"]
"""Which of a message's times counts: of logging, of publishing, or the one its contents carry."""

MAX_ID_LENGTH = 256
"""Longer ids are no names; as one column of text, a single one would cost every row its length."""
TIME_END_NS = 1 << 63


@dataclass(slots=True, kw_only=True)
class Drops:
    """What of the readable messages was left out, counted.

    Attributes:
        undecodable: messages that are not what their schema says.
        untimed: messages without a time of the chosen source, or with one beyond int64.
        invalid: rows whose position is not finite, or whose id is longer than `MAX_ID_LENGTH`.
        repeated: rows of a vehicle at a time at which it had a row already.
        backward: rows of a time before one that was delivered already.
        alone: rows too far in time from others of their track to derive a velocity.
    """

    undecodable: int = 0
    untimed: int = 0
    invalid: int = 0
    repeated: int = 0
    backward: int = 0
    alone: int = 0

    def __iadd__(self, other: Self) -> Self:
        for f in fields(self):
            setattr(self, f.name, getattr(self, f.name) + getattr(other, f.name))
        return self

    @property
    def total(self) -> int:
        """Messages and rows left out."""
        return sum(getattr(self, f.name) for f in fields(self))

    def __str__(self) -> str:
        words = {
            "undecodable": "messages that cannot be decoded",
            "untimed": "messages without a usable time",
            "invalid": "rows with a position that is not finite or an overlong id",
            "repeated": "rows that repeat a vehicle and a time",
            "backward": "rows out of order in time",
            "alone": "rows too far from others in time to derive a velocity",
        }
        told = [f"{getattr(self, name)} {text}" for name, text in words.items() if getattr(self, name)]
        return ", ".join(told) or "nothing"


class Decoders:
    """The decoders of one log, made when first needed, one for each channel."""

    def __init__(self) -> None:
        self._made: dict[Channel, Decoder] = {}

    def decode(self, message: Message) -> ObservedFrame:
        """The objects of a message whose channel `is_decodable`.

        Raises:
            google.protobuf.message.DecodeError: the message or its schema is not what it should be.
        """
        decoder = self._made.get(message.channel)
        if decoder is None:
            schema = message.channel.schema
            decoder = self._made[message.channel] = DECODERS[schema.name](schema.data)
        return decoder(message.data)


def is_decodable(channel: Channel) -> bool:
    """Whether the channel's messages can be read as objects."""
    return channel.schema.name in DECODERS and channel.message_encoding == "protobuf"


def observed_frames(
    log: Scan,
    *,
    drops: Drops,
    time_source: TimeSource = "log",
    start_ns: int | None = None,
    end_ns: int | None = None,
    strict: bool = False,
) -> Iterator[tuple[int, ObservedFrame]]:
    """Time and objects of each message that can be decoded, in order of log time.

    Args:
        log: gives the messages; those of other schemas are passed over.
        drops: where what is left out is counted.
        time_source: which time of a message counts.
        start_ns: the first time wanted.
        end_ns: the first time no longer wanted.
        strict: raise at the first damage instead of going on.

    Raises:
        DamagedRecordingError: strict, and the log is damaged.
        DecodeError: strict, and a message is not what its schema says.
    """
    decoders = Decoders()
    for message in log:
        if strict and log.damage:
            raise DamagedRecordingError(log.path, log.damage)
        if not is_decodable(message.channel):
            continue
        try:
            frame = decoders.decode(message)
        except ProtobufDecodeError as error:
            if strict:
                raise DecodeError(
                    log.path, topic=message.topic, time_ns=message.log_time_ns,
                    expected=f"a message of {message.schema_name}", got=str(error),
                ) from error  # fmt: skip
            drops.undecodable += 1
            continue
        times = {"log": message.log_time_ns, "publish": message.publish_time_ns, "header": frame.stamp_ns}
        time_ns = times[time_source]
        if time_ns is None or time_ns >= TIME_END_NS:
            drops.untimed += bool(frame.track_id)
        elif (start_ns is None or start_ns <= time_ns) and (end_ns is None or time_ns < end_ns):
            yield time_ns, _valid_rows(frame, drops)
    if strict and log.damage:
        raise DamagedRecordingError(log.path, log.damage)


def log_losses(path: Path, damage: Sequence[Damage], drops: Drops) -> None:
    """One warning for what of a file could not be read, one for what was left out."""
    if damage:
        more = f", and {len(damage) - 1} more" if len(damage) > 1 else ""
        logger.warning("%s: damaged, the rest is read: %s%s", path, damage[0], more)
    if drops.total:
        logger.warning("%s: left out %s", path, drops)


def _valid_rows(frame: ObservedFrame, drops: Drops) -> ObservedFrame:
    valid = np.isfinite(frame.position[:, 0]) & np.isfinite(frame.position[:, 1])
    valid &= np.array([len(name) <= MAX_ID_LENGTH for name in frame.track_id], np.bool_)
    if valid.all():
        return frame
    drops.invalid += int((~valid).sum())
    return frame[valid]
