"""The records of an MCAP file, read and checked by the `mcap` package.

Source: the MCAP specification, version 0 (https://mcap.dev/spec): little endian; a record is an opcode, a
length of 64 bits, and that many bytes; strings and maps carry a length of 32 bits in front.
"""

from __future__ import annotations

import struct
from collections.abc import MutableMapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, cast

from mcap import records as fields
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.well_known import MessageEncoding
from mcap.writer import MCAP0_MAGIC

if TYPE_CHECKING:
    from dirprim_filter.recording.container.file_bytes import FileBytes

Bytes: TypeAlias = "bytes | FileBytes"

ENCODINGS = (MessageEncoding.Protobuf, MessageEncoding.CDR, MessageEncoding.JSON, MessageEncoding.ROS1)
"""Of messages, those that can be read as objects."""
MAGIC = MCAP0_MAGIC
SHORT_BYTES = 1 << 16
"""Longer fields, as of attachments, are not kept at hand."""
DEFINITIONS = (Opcode.SCHEMA, Opcode.CHANNEL)
PRIVATE = 0x80
"""The first of the opcodes that anybody may use."""
RECORD_HEADER_SIZE = 9
MESSAGE_HEADER = struct.Struct("<BQHIQQ")
"""Opcode, length, channel, sequence, log time, publish time."""
U32 = struct.Struct("<I")
U64 = struct.Struct("<Q")
CHUNK, CHUNK_INDEX, MESSAGE_INDEX = (struct.Struct(form) for form in ("<QQQII", "<QQQQI", "<HI"))
"""The numbers that these records begin with, and the length of what stands behind them."""
KINDS: dict[int, Any] = {
    int(opcode): getattr(fields, Opcode(opcode).name.title().replace("_", ""))
    for opcode in Opcode
    if opcode not in (Opcode.MESSAGE, Opcode.CHUNK, Opcode.MESSAGE_INDEX)
}
"""What the mcap package reads records by; the others are read here, where they stand."""


class MalformedRecordError(ValueError):
    """A record's fields do not fit in its length."""


class BadTextError(MalformedRecordError):
    """A text of a record is no UTF-8."""


class UndefinedSchemaError(MalformedRecordError):
    """A channel names a schema that has not been seen yet."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Schema:
    """How the messages of a channel are structured: name, encoding of the definition, and the definition."""

    name: str
    encoding: str
    data: bytes


NO_SCHEMA = Schema(name="", encoding="", data=b"")


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """A stream of messages of one topic and one schema."""

    topic: str
    message_encoding: str
    schema: Schema
    metadata: tuple[tuple[str, str], ...]


class Message(NamedTuple):
    """One message of a log; times in nanoseconds."""

    log_time_ns: int
    publish_time_ns: int
    sequence: int
    channel: Channel
    data: bytes

    @property
    def topic(self) -> str:
        """Topic of its channel."""
        return self.channel.topic

    @property
    def message_encoding(self) -> str:
        """How `data` is encoded: "protobuf", "cdr", "json", ..."""
        return self.channel.message_encoding

    @property
    def schema_name(self) -> str:
        """Name of its schema; empty where it has none."""
        return self.channel.schema.name


def record_end(buffer: bytes, at: int) -> int:
    """The byte after the record at `at`, by its length alone."""
    length: int = U64.unpack_from(buffer, at + 1)[0]
    return at + RECORD_HEADER_SIZE + length


class _Fields:
    """Those of a record, as a stream that ends where it does; of a length that leads past it nothing is read."""

    def __init__(self, buffer: Bytes, at: int) -> None:
        head = _between(buffer, at, at + RECORD_HEADER_SIZE)
        self._buffer, self._at, self._end = buffer, at + RECORD_HEADER_SIZE, at + record_end(head, 0)
        self.opcode = head[0]

    def read(self, n: int) -> bytes:
        start, self._at = self._at, self._at + n
        data = _between(self._buffer, start, self._at) if self._at <= self._end else b""
        if len(data) < n:
            raise EndOfFile
        return data


def _between(buffer: Bytes, start: int, stop: int) -> bytes:
    if isinstance(buffer, bytes):
        return buffer[start:stop]
    return buffer.peek(start, stop - start) if stop - start < SHORT_BYTES else buffer.read(start, stop)


def parse_known(buffer: Bytes, at: int) -> tuple[Any, int]:
    """The record of `KINDS` at `at` as the mcap package has it, and the byte after the fields that this version knows.

    Raises:
        MalformedRecordError: its fields do not fit.
        BadTextError: a text is no UTF-8.
    """
    fields_of = _Fields(buffer, at)
    stream = ReadDataStream(cast("Any", fields_of))
    try:
        return KINDS[fields_of.opcode].read(stream), at + RECORD_HEADER_SIZE + stream.count
    except (EndOfFile, struct.error) as error:
        raise MalformedRecordError(f"the fields of a {Opcode(fields_of.opcode).name} record end past it") from error
    except UnicodeDecodeError as error:
        raise BadTextError(f"a field of a {Opcode(fields_of.opcode).name} record is not UTF-8") from error


def parse(buffer: Bytes, at: int) -> Any:
    """The same record alone."""
    return parse_known(buffer, at)[0]


def define(
    buffer: Bytes, at: int, schemas: MutableMapping[int, Schema], channels: MutableMapping[int, Channel]
) -> None:
    """Take the schema or the channel of `DEFINITIONS` at `at` among those by id; schema id 0 is no schema.

    Raises:
        MalformedRecordError: its fields do not fit.
        UndefinedSchemaError: a channel's schema is not among `schemas`.
    """
    said = parse(buffer, at)
    if isinstance(said, fields.Schema):
        schemas[said.id] = Schema(name=said.name, encoding=said.encoding, data=said.data)
        return
    schema = schemas.get(said.schema_id) if said.schema_id else NO_SCHEMA
    if schema is None:
        raise UndefinedSchemaError(f"channel {said.id} ({said.topic}) names schema {said.schema_id}, not defined")
    channels[said.id] = Channel(
        topic=said.topic, message_encoding=said.message_encoding, schema=schema, metadata=tuple(said.metadata.items())
    )


def refused_encoding(encoding: str) -> str:
    """Why messages of an encoding are not read, and the way out; empty where they are."""
    known = ", ".join(ENCODINGS)
    return "" if encoding in ENCODINGS else f"messages encoded as {encoding or 'nothing'} are not read; write {known}"
