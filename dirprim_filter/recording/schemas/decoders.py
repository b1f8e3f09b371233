"""The objects of a log's messages, channel by channel, each by the definition that the log carries."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise

import numpy as np

from dirprim_filter.arrays import IntArray
from dirprim_filter.recording.container.budget import MOST_TIMES, SMALL_BYTES
from dirprim_filter.recording.container.errors import ZSTD
from dirprim_filter.recording.container.message_columns import MessageColumns, gathered
from dirprim_filter.recording.container.records import ENCODINGS, Channel, Schema, refused_encoding
from dirprim_filter.recording.decoding.cdr_plan import CdrPlan, full_name
from dirprim_filter.recording.decoding.column_plan import ColumnPlan, TooManyRowsError
from dirprim_filter.recording.decoding.field_columns import FieldColumns, SchemaError
from dirprim_filter.recording.decoding.json_plan import JsonPlan
from dirprim_filter.recording.decoding.protobuf_plan import protobuf_plan
from dirprim_filter.recording.rows import Rows
from dirprim_filter.recording.schemas import ASSIGNMENTS_SCHEMA, ESTIMATES_SCHEMA
from dirprim_filter.recording.schemas.families import FAMILIES, TRANSFORMS
from dirprim_filter.recording.schemas.family import Family, FieldMapping
from dirprim_filter.track_ids import rows_of_each

Plan = ColumnPlan | CdrPlan | JsonPlan
BATCH_MESSAGES = 1 << 14
BATCH_BYTES = 1 << 21
"""Messages are decoded together up to about so many: memory is bounded by a batch."""
NOT_KNOWN = "its schema is not known to hold objects; --set fields=... says where they are"
NO_PLACES = {
    f"vision_msgs/msg/{name}": "boxes in an image are no places on the ground; a 3D detector's topic has them"
    for name in ("Detection2D", "Detection2DArray", "BoundingBox2DArray")
} | {
    ESTIMATES_SCHEMA: "holds results; `dirprim export` makes a table of them that is read, `track --smooth` smooths",
    ASSIGNMENTS_SCHEMA: "`dirprim export --assigned` makes a table of it",
}
"""Why some schemas of objects cannot be read."""
ONLY_NAMED = "read only where --topics names it"


def family_of(channel: Channel) -> Family | None:
    """The decoder of a channel's objects; None where its schema is not known to contain any."""
    if channel.message_encoding not in ENCODINGS:
        return None
    return FAMILIES.get(schema_name(channel))


def schema_name(channel: Channel) -> str:
    """The name of a channel's schema; that of a ROS 2 message in full."""
    name = channel.schema.name
    return full_name(name) if channel.message_encoding in ("cdr", "ros1") else name


class Decoders:
    """The plans of one log, made when first needed, one for each schema.

    With a mapping every schema is read by that which has its fields, without one the schemas of `FAMILIES`.

    Attributes:
        notes: what was odd so far, but read.
    """

    def __init__(self, mapping: FieldMapping | None = None) -> None:
        self._mapped = mapping.family() if mapping else None
        self._plans: dict[tuple[str, Schema], Plan | SchemaError] = {}
        self.notes = set[str]()
        self._left = SMALL_BYTES  # of what messages may become that are compressed one by one; each that comes adds

    def reads(self, channel: Channel) -> bool:
        """Whether the channel's messages can be read as objects; without a mapping a broken definition counts."""
        if self._mapped is None:
            return family_of(channel) is not None
        return channel.message_encoding in ENCODINGS and not isinstance(self._plan(channel), SchemaError)

    def carries_objects(self, channel: Channel) -> bool:
        """Whether the channel's objects are read by default; those of transforms only on request."""
        return self.reads(channel) and (self._mapped is not None or family_of(channel) not in TRANSFORMS)

    def is_of_one_body(self, schema: str) -> bool:
        """Whether each message of a schema that is read is of one object: a topic of them is then a vehicle."""
        family = self._mapped or FAMILIES[schema]
        return not any(field.table for field in family.fields.values())

    def refusal(self, channel: Channel) -> str:
        """Why the channel's objects are not read, whatever its messages; empty where they are, or these will say."""
        if why := refused_encoding(channel.message_encoding):
            return why
        if self._mapped is None and (name := schema_name(channel)) not in FAMILIES:
            return NO_PLACES.get(name, NOT_KNOWN)
        if self._mapped is not None and isinstance(plan := self._plan(channel), SchemaError):
            return str(plan)
        return "" if self.carries_objects(channel) else ONLY_NAMED

    def _plan(self, channel: Channel) -> Plan | SchemaError:
        """What reads a channel's messages, or why its definition cannot be read, or which field it lacks."""
        encoding, schema = key = channel.message_encoding, channel.schema
        if key not in self._plans:
            fields = self._family(channel).fields
            try:
                if encoding == "json":
                    self._plans[key] = JsonPlan(fields)
                elif encoding == "protobuf":
                    self._plans[key] = protobuf_plan(schema.name, schema.data, fields)
                else:
                    self._plans[key] = CdrPlan(schema.name, schema.encoding, schema.data, fields)
            except SchemaError as error:
                self._plans[key] = error
        return self._plans[key]

    def _family(self, channel: Channel) -> Family:
        return self._mapped or FAMILIES[schema_name(channel)]

    def rows(self, messages: MessageColumns) -> tuple[Rows, dict[int, str]]:
        """The objects of messages, and by number why a message cannot be read.

        Args:
            messages: of one schema and encoding, that it `reads`; of one channel or of several.
        """
        parts, failures = list[Rows](), dict[int, str]()
        for first, own, columns in self.columns(messages):
            with np.errstate(all="ignore"):  # numbers of any origin; where rows are checked, only finite ones stay
                rows = self._family(own.first_channel).objects(columns, own.topic)
            self.notes |= columns.notes
            if columns.failures:
                rows = rows[~np.isin(rows.message, list(columns.failures))]
                failures |= {first + message: reason for message, reason in columns.failures.items()}
            parts.append(replace(rows, message=rows.message + first) if first else rows)
        return parts[0] if len(parts) == 1 else Rows.concatenate(parts), failures

    def columns(self, messages: MessageColumns) -> Iterator[tuple[int, MessageColumns, FieldColumns]]:
        """The wanted fields of messages, of one schema and encoding: so many at a time that memory stays bounded.

        Returns:
            which message is the first of the part, the part, and its columns; all fail by a definition that cannot be
            read.
        """
        plan = self._plan(messages.first_channel)
        if isinstance(plan, SchemaError):
            yield 0, messages, FieldColumns.failed(self._family(messages.first_channel).fields, len(messages), plan)
            return
        parts = [(0, len(messages))]
        while parts:
            first, last = parts.pop()
            try:
                part = messages[first:last]
                part = self._unpacked(part) if part.first_channel.message_encoding == "cdr" else part
                columns = plan.read(np.frombuffer(part.contents, np.uint8), part.start, part.stop)
            except TooManyRowsError:
                half = (first + last) // 2
                parts += [(half, last), (first, half)]
            else:
                yield first, part, columns

    def _unpacked(self, messages: MessageColumns) -> MessageColumns:
        """Messages of CDR, those decompressed that rosbag2 compressed one by one, which no encapsulation looks like.

        Those that do not decompress, or become far more together than they are, stay as they are.

        Raises:
            TooManyRowsError: several together are larger than `SMALL_BYTES`.
        """
        data, filled = np.frombuffer(messages.contents, np.uint8), messages.start < messages.stop
        if not (data[messages.start[filled]] == ZSTD[0]).any():
            return messages
        import zstandard  # noqa: PLC0415 - few logs need it

        parts, size, left, decompressor = list[bytes](), 0, self._left, zstandard.ZstdDecompressor()
        for first, end in zip(messages.start.tolist(), messages.stop.tolist(), strict=True):
            part = messages.contents[first:end]
            if part.startswith(ZSTD):
                left += MOST_TIMES * len(part)
                with suppress(zstandard.ZstdError):
                    if zstandard.frame_content_size(part) <= min(left, SMALL_BYTES):
                        part = decompressor.decompress(part, max_output_size=min(left, SMALL_BYTES))
                left -= len(part)
            parts.append(part)
            size += len(part)
            if size > SMALL_BYTES and len(messages) > 1:
                raise TooManyRowsError
        self._left = left
        stop = np.cumsum([len(part) for part in parts])
        start = np.append(0, stop[:-1])
        return replace(messages, start=start, stop=stop, contents=b"".join(parts))


def batches(
    columns: Iterable[MessageColumns], reads: Callable[[Channel], bool], *, at_once: bool = False
) -> Iterator[MessageColumns]:
    """The messages of channels that can be decoded, some together; `at_once` those of each part."""
    batch: list[MessageColumns] = []
    size = n = 0
    for part in columns:
        readable = part.by_channel(reads)
        for piece in pieces(part if readable.all() else part[readable]):
            own = int((piece.stop - piece.start).sum())
            if n and (size + own > BATCH_BYTES or n + len(piece) > BATCH_MESSAGES):
                yield joined(batch)
                batch, size, n = [], 0, 0
            batch.append(piece.compact())
            n, size = n + len(piece), size + own
            if size >= BATCH_BYTES or n >= BATCH_MESSAGES or (at_once and n):
                yield joined(batch)
                batch, size, n = [], 0, 0
    if n:
        yield joined(batch)


def pieces(messages: MessageColumns) -> Iterator[MessageColumns]:
    """The same, so few together that what is made of them is bounded: chunks may be of any size."""
    through = np.cumsum(messages.stop - messages.start) // BATCH_BYTES + np.arange(len(messages)) // BATCH_MESSAGES
    for first, last in pairwise([0, *(np.flatnonzero(np.diff(through)) + 1).tolist(), len(messages)]):
        yield messages[first:last]


def joined(parts: list[MessageColumns]) -> MessageColumns:
    """The messages of all parts, one after the other."""
    return parts[0] if len(parts) == 1 else gathered(parts)


def by_schema(batch: MessageColumns) -> Iterator[tuple[IntArray, MessageColumns]]:
    """The messages of each schema and encoding together, with where they stand in the batch."""
    keys: dict[tuple[str, Schema], int] = {}
    group = batch.by_channel(lambda c: keys.setdefault((c.message_encoding, c.schema), len(keys)))
    for places in rows_of_each(group):
        yield places, batch if len(places) == len(batch) else batch[places]
