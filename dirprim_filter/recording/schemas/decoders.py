"""The objects of a log's messages, channel by channel, each by the definition that the log carries."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from operator import attrgetter

import numpy as np

from dirprim_filter.recording.container.records import ENCODINGS, Channel, Message, Schema
from dirprim_filter.recording.decoding.cdr_plan import cdr_plan, full_name
from dirprim_filter.recording.decoding.column_plan import Plan
from dirprim_filter.recording.decoding.field_columns import Shredded
from dirprim_filter.recording.decoding.fields import SchemaError
from dirprim_filter.recording.decoding.json_plan import JsonPlan
from dirprim_filter.recording.decoding.protobuf_plan import protobuf_plan
from dirprim_filter.recording.schemas import FAMILIES, KINDS
from dirprim_filter.recording.schemas.field_mapping import FieldMapping
from dirprim_filter.recording.schemas.object_rows import NO_ROWS, Family, ObservedRows
from tessellation.arrays import IntArray

BATCH_MESSAGES = 1 << 14
BATCH_BYTES = 1 << 21
"""Messages are decoded together up to about so many: memory is bounded by a batch."""
CHANNEL, DATA, TOPIC = attrgetter("channel"), attrgetter("data"), attrgetter("channel.topic")
"""Of a message; mapped over many, faster than a loop."""


class PayloadError(SchemaError):
    """A message is not what its schema says."""


def family_of(channel: Channel) -> Family | None:
    """What reads the objects of a channel; None where its messages tell of none that is known."""
    if channel.message_encoding not in ENCODINGS:
        return None
    return FAMILIES.get(schema_name(channel))


def schema_name(channel: Channel) -> str:
    """The name of a channel's schema; that of a ROS 2 message in full."""
    name = channel.schema.name
    return full_name(name) if channel.message_encoding == "cdr" else name


def plan_of(channel: Channel, family: Family) -> Plan:
    """A plan for the messages of a channel.

    Raises:
        SchemaError: the definition cannot be read, or lacks a field.
    """
    schema = channel.schema
    if channel.message_encoding == "json":
        return JsonPlan(family.fields)
    if channel.message_encoding == "protobuf":
        return protobuf_plan(schema.name, schema.data, family.fields)
    return cdr_plan(schema.name, schema.encoding, schema.data, family.fields)


class Decoders:
    """The plans of one log, made when first needed, one for each schema.

    With a mapping every schema is read by that which has its fields, without one the schemas of `FAMILIES`.
    """

    def __init__(self, mapping: FieldMapping | None = None) -> None:
        self._mapped = mapping.family() if mapping else None
        self._plans: dict[tuple[str, Schema], Plan | SchemaError] = {}

    def reads(self, channel: Channel) -> bool:
        """Whether the channel's messages can be read as objects; without a mapping a broken definition counts."""
        if self._mapped is None:
            return family_of(channel) is not None
        return channel.message_encoding in ENCODINGS and not isinstance(self._plan(channel), SchemaError)

    def carries_objects(self, channel: Channel) -> bool:
        """Whether the channel's messages tell of objects unasked; transforms do so only where they are named."""
        family = family_of(channel)
        return self.reads(channel) and (self._mapped is not None or any(family in kind for kind in KINDS))

    def unreadable(self) -> list[str]:
        """Why schemas that were looked at cannot be read."""
        return [str(plan) for plan in self._plans.values() if isinstance(plan, SchemaError)]

    def _plan(self, channel: Channel) -> Plan | SchemaError:
        key = (channel.message_encoding, channel.schema)
        if key not in self._plans:
            try:
                self._plans[key] = plan_of(channel, self._family(channel))
            except SchemaError as error:
                self._plans[key] = error
        return self._plans[key]

    def _family(self, channel: Channel) -> Family:
        return self._mapped or FAMILIES[schema_name(channel)]

    def rows(self, messages: Sequence[Message]) -> tuple[ObservedRows, dict[int, str]]:
        """The objects of messages, and by number why a message cannot be read.

        Args:
            messages: of one schema and encoding, that it `reads`; of one channel or of several.
        """
        try:
            shredded = self.shredded(messages)
        except SchemaError as error:
            return NO_ROWS, dict.fromkeys(range(len(messages)), str(error))
        topics = np.array(list(map(TOPIC, messages)), dtype=np.str_)
        with np.errstate(
            all="ignore"
        ):  # of a stranger's numbers, what is not finite is left out where rows are checked
            rows = self._family(messages[0].channel).objects(shredded, topics)
        if shredded.failures:
            rows = rows[~np.isin(rows.message, list(shredded.failures))]
        return rows, shredded.failures

    def shredded(self, messages: Sequence[Message]) -> Shredded:
        """The wanted fields of messages, of one schema and encoding.

        Raises:
            SchemaError: the definition cannot be read, or lacks a field.
        """
        plan = self._plan(messages[0].channel)
        if isinstance(plan, SchemaError):
            raise plan
        return plan.run(list(map(DATA, messages)))

    def decode(self, message: Message) -> ObservedRows:
        """The objects of one message whose channel it `reads`.

        Raises:
            PayloadError: the message or its schema is not what it should be.
        """
        rows, failures = self.rows([message])
        if failures:
            raise PayloadError(f"{message.schema_name}: {failures[0]}")
        return rows


def batches(messages: Iterable[Message], decoders: Decoders) -> Iterator[list[Message]]:
    """The messages that can be decoded, some together."""
    batch: list[Message] = []
    size, n = 0, 1
    readable: dict[int, tuple[Channel, bool]] = {}  # by identity: hashing the channels themselves is slow
    messages = iter(messages)
    while block := list(islice(messages, n)):  # blocks grow while they are small: a step for each message is slow
        channels = list(map(CHANNEL, block))
        numbers = list(map(id, channels))
        for number in set(numbers) - readable.keys():
            channel = channels[numbers.index(number)]
            readable[number] = (channel, decoders.reads(channel))
        length = sum(map(len, map(DATA, block)))
        n = max(1, min(2 * n, BATCH_MESSAGES // 4, BATCH_BYTES // 4 * len(block) // max(length, 1)))
        if not all(readable[number][1] for number in set(numbers)):
            block = [message for message, number in zip(block, numbers, strict=True) if readable[number][1]]
        batch += block
        size += length
        if size >= BATCH_BYTES or len(batch) >= BATCH_MESSAGES:
            if batch:
                yield batch
            batch, size = [], 0
    if batch:
        yield batch


def by_schema(batch: Sequence[Message]) -> Iterator[tuple[IntArray, list[Message]]]:
    """The messages of each schema and encoding together, with where they stand in the batch."""
    channels = list(map(CHANNEL, batch))
    number = np.fromiter(map(id, channels), np.int64, len(batch))  # hashing the channels themselves is slow
    _, first, of = np.unique(number, return_index=True, return_inverse=True)
    keys: dict[tuple[str, Schema], int] = {}
    group = np.array(
        [keys.setdefault((channels[i].message_encoding, channels[i].schema), len(keys)) for i in first], np.int64
    )[of]
    for k in range(len(keys)):
        places = np.flatnonzero(group == k)
        yield places, [batch[i] for i in places.tolist()] if len(keys) > 1 else list(batch)
