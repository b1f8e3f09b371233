"""The records of an MCAP file: the `mcap` package reads and writes their fields, here they are checked.

Source: the MCAP specification, version 0 (https://mcap.dev/spec): little endian; a record is an opcode, a
length of 64 bits, and that many bytes; strings and maps carry a length of 32 bits in front.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from io import BytesIO
from mmap import mmap
from typing import IO, Any, NamedTuple, cast

from mcap import records as fields
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.well_known import MessageEncoding
from mcap.writer import MCAP0_MAGIC

Bytes = bytes | mmap

ENCODINGS = (MessageEncoding.Protobuf, MessageEncoding.CDR, MessageEncoding.JSON)
"""Of messages, those that can be read as objects."""
MAGIC = MCAP0_MAGIC
PRIVATE = 0x80
"""The first of the opcodes that anybody may use."""
RECORD_HEADER_SIZE = 9
MESSAGE_HEADER = struct.Struct("<BQHIQQ")
"""Opcode, length, channel, sequence, log time, publish time."""
U16 = struct.Struct("<H")
U32 = struct.Struct("<I")
U64 = struct.Struct("<Q")
_CHUNK_INDEX_HEAD, _PLACE = struct.Struct("<QQQQI"), struct.Struct("<HQ")
TEXT, DATA = -4, -8
"""A field that carries its length in front, in 4 or 8 bytes; other fields are given by their size."""
FIELDS: dict[int, tuple[int, ...]] = {
    Opcode.HEADER: (TEXT, TEXT),
    Opcode.FOOTER: (20,),
    Opcode.SCHEMA: (2, TEXT, TEXT, TEXT),
    Opcode.CHANNEL: (4, TEXT, TEXT, TEXT),
    Opcode.MESSAGE_INDEX: (2, TEXT),
    Opcode.CHUNK_INDEX: (32, TEXT, 8, TEXT, 16),
    Opcode.ATTACHMENT: (16, TEXT, TEXT, DATA, 4),
    Opcode.ATTACHMENT_INDEX: (40, TEXT, TEXT),
    Opcode.STATISTICS: (42, TEXT),
    Opcode.METADATA: (TEXT, TEXT),
    Opcode.METADATA_INDEX: (16, TEXT),
    Opcode.SUMMARY_OFFSET: (17,),
    Opcode.DATA_END: (4,),
}
"""Of all records but messages and chunks."""


class MalformedRecordError(ValueError):
    """A record's fields do not fit in its length."""


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Attachment:
    """A file that was attached to a log, and where it stands.

    Attributes:
        name: of the file.
        media_type: such as "text/plain".
        log_time_ns: when it was recorded.
        create_time_ns: when it was made.
        data_offset: byte where its data start.
        size: bytes of them.
        crc: CRC-32 of all its fields but this; 0 where the writer gave none.
        offset: byte where its record starts.
        end: byte after its record.
    """

    name: str
    media_type: str
    log_time_ns: int
    create_time_ns: int
    data_offset: int
    size: int
    crc: int
    offset: int
    end: int


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

    @property
    def schema_encoding(self) -> str:
        """How `schema_data` is encoded."""
        return self.channel.schema.encoding

    @property
    def schema_data(self) -> bytes:
        """The definition of its schema."""
        return self.channel.schema.data


def record_end(buffer: Bytes, at: int) -> int:
    """The byte after the record at `at`, by its length alone."""
    return at + RECORD_HEADER_SIZE + int(U64.unpack_from(buffer, at + 1)[0])


def fields_end(buffer: Bytes, at: int, end: int) -> int | None:
    """The byte after the fields that this version knows of the record at `at`; None where they do not fit."""
    opcode, at = buffer[at], at + RECORD_HEADER_SIZE
    for size in FIELDS[opcode]:
        if size > 0:
            at += size
        elif at - size > end:
            return None
        else:
            at += -size + int((U32 if size == TEXT else U64).unpack_from(buffer, at)[0])
    return at if at <= end else None


class _Fields(ReadDataStream):
    """The fields of one record: what is cut is no field."""

    def read(self, length: int) -> bytes:
        data = super().read(length)
        if len(data) < length:
            raise EndOfFile
        return data


def parse(buffer: Bytes, at: int) -> Any:
    """The record at `at` as the mcap package has it; no message, chunk or attachment.

    Raises:
        MalformedRecordError: its fields do not fit, or a text is no UTF-8.
    """
    body, end = at + RECORD_HEADER_SIZE, record_end(buffer, at)
    stop = fields_end(buffer, at, end) if end <= len(buffer) else None
    opcode = Opcode(buffer[at])
    if stop is None:
        raise MalformedRecordError(f"the fields of a {opcode.name} record end past it")
    if opcode == Opcode.CHUNK_INDEX:
        return _chunk_index(buffer[body:stop])
    stream = _Fields(BytesIO(buffer[body:stop]))
    try:
        record = getattr(fields, opcode.name.title().replace("_", "")).read(stream)
    except (EndOfFile, UnicodeDecodeError) as error:
        why = "is not UTF-8" if isinstance(error, UnicodeDecodeError) else "ends past its record"
        raise MalformedRecordError(f"a field of a {opcode.name} record {why}") from error
    if stream.count != stop - body:
        raise MalformedRecordError(f"a map of a {opcode.name} record does not end where it says")
    return record


def _chunk_index(body: bytes) -> fields.ChunkIndex:
    """As the mcap package reads it, all places at once: a long log has them by the hundred thousand."""
    start_ns, end_ns, offset, length, n_bytes = _CHUNK_INDEX_HEAD.unpack_from(body)
    at = _CHUNK_INDEX_HEAD.size + n_bytes
    if n_bytes % _PLACE.size:
        raise MalformedRecordError("a map of a CHUNK_INDEX record does not end where it says")
    return fields.ChunkIndex(
        message_start_time=start_ns, message_end_time=end_ns, chunk_start_offset=offset, chunk_length=length,
        message_index_offsets=dict(_PLACE.iter_unpack(body[_CHUNK_INDEX_HEAD.size : at])),
        message_index_length=int(U64.unpack_from(body, at)[0]),
        compression=body[at + 12 : -16].decode(errors="replace"),
        compressed_size=int(U64.unpack_from(body, len(body) - 16)[0]),
        uncompressed_size=int(U64.unpack_from(body, len(body) - 8)[0]),
    )  # fmt: skip


def parse_schema(buffer: Bytes, at: int) -> tuple[int, Schema]:
    """A schema record's id and contents.

    Raises:
        MalformedRecordError: its fields do not fit.
    """
    record = parse(buffer, at)
    return record.id, Schema(name=record.name, encoding=record.encoding, data=record.data)


def parse_channel(buffer: Bytes, at: int, schemas: dict[int, Schema]) -> tuple[int, Channel]:
    """A channel record's id and contents; schema id 0 is no schema.

    Raises:
        MalformedRecordError: its fields do not fit.
        UndefinedSchemaError: its schema is not among `schemas`.
    """
    record = parse(buffer, at)
    schema = schemas.get(record.schema_id) if record.schema_id else NO_SCHEMA
    if schema is None:
        raise UndefinedSchemaError(
            f"channel {record.id} ({record.topic}) names schema {record.schema_id}, which is not defined"
        )
    metadata = tuple(record.metadata.items())
    return record.id, Channel(
        topic=record.topic, message_encoding=record.message_encoding, schema=schema, metadata=metadata
    )


def parse_attachment(file: mmap, at: int) -> Attachment:
    """An attachment record, without its data.

    Raises:
        MalformedRecordError: its fields do not fit.
    """
    body, end = at + RECORD_HEADER_SIZE, record_end(file, at)
    if fields_end(file, at, end) is None:
        raise MalformedRecordError("the fields of an ATTACHMENT record end past it")
    file.seek(body)
    stream = _Fields(cast("IO[bytes]", file))
    log_time_ns, create_time_ns = stream.read8(), stream.read8()
    try:
        name, media_type = stream.read_prefixed_string(), stream.read_prefixed_string()
    except UnicodeDecodeError as error:
        raise MalformedRecordError("a field of an ATTACHMENT record is not UTF-8") from error
    size = stream.read8()
    data_offset = body + stream.count
    return Attachment(
        name=name, media_type=media_type, log_time_ns=log_time_ns, create_time_ns=create_time_ns, size=size,
        data_offset=data_offset, crc=int(U32.unpack_from(file, data_offset + size)[0]), offset=at, end=end,
    )  # fmt: skip


def written(*records: fields.McapRecord) -> bytes:
    """Records as they stand in a file."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())


def schema_record(schema_id: int, schema: Schema) -> fields.Schema:
    """A schema to be written."""
    return fields.Schema(id=schema_id, name=schema.name, encoding=schema.encoding, data=schema.data)


def channel_record(channel_id: int, schema_id: int, channel: Channel) -> fields.Channel:
    """A channel to be written; schema id 0 is none."""
    return fields.Channel(
        id=channel_id, topic=channel.topic, message_encoding=channel.message_encoding,
        metadata=dict(channel.metadata), schema_id=schema_id,
    )  # fmt: skip
