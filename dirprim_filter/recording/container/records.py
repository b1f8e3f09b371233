"""The records of an MCAP file that matter here, and how their bytes are laid out.

Source: the MCAP specification, version 0 (https://mcap.dev/spec): little endian; a record is an opcode, a
length of 64 bits, and that many bytes; strings and maps carry a length of 32 bits in front.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from mmap import mmap
from typing import NamedTuple

Bytes = bytes | mmap

ENCODINGS = ("protobuf", "cdr", "json")
"""Of messages, those that can be read as objects."""
MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = range(9, 16)
RECORD_HEADER_SIZE = 9
MESSAGE_HEADER = struct.Struct("<BQHIQQ")
"""Opcode, length, channel, sequence, log time, publish time."""
U16 = struct.Struct("<H")
U32 = struct.Struct("<I")
U64 = struct.Struct("<Q")


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


def parse_schema(buffer: Bytes, start: int, end: int) -> tuple[int, Schema]:
    """A schema record's id and contents.

    Raises:
        MalformedRecordError: its fields do not fit.
    """
    schema_id = _u16(buffer, start, end)
    name, at = parse_text(buffer, start + 2, end)
    encoding, at = parse_text(buffer, at, end)
    data, _ = _bytes(buffer, at, end)
    return schema_id, Schema(name=name, encoding=encoding, data=data)


def parse_channel(buffer: Bytes, start: int, end: int, schemas: dict[int, Schema]) -> tuple[int, Channel]:
    """A channel record's id and contents; schema id 0 is no schema.

    Raises:
        MalformedRecordError: its fields do not fit.
        UndefinedSchemaError: its schema is not among `schemas`.
    """
    channel_id, schema_id = _u16(buffer, start, end), _u16(buffer, start + 2, end)
    topic, at = parse_text(buffer, start + 4, end)
    encoding, at = parse_text(buffer, at, end)
    metadata, _ = _text_map(buffer, at, end)
    schema = schemas.get(schema_id) if schema_id else NO_SCHEMA
    if schema is None:
        raise UndefinedSchemaError(f"channel {channel_id} ({topic}) names schema {schema_id}, which is not defined")
    return channel_id, Channel(topic=topic, message_encoding=encoding, schema=schema, metadata=tuple(metadata.items()))


def parse_header(buffer: Bytes, start: int, end: int) -> tuple[str, str]:
    """A header record's profile and library.

    Raises:
        MalformedRecordError: its fields do not fit.
    """
    profile, at = parse_text(buffer, start, end)
    return profile, parse_text(buffer, at, end)[0]


def parse_attachment(buffer: Bytes, start: int, end: int) -> Attachment:
    """An attachment record, without its data.

    Raises:
        MalformedRecordError: its fields do not fit.
    """
    log_time_ns, create_time_ns = _u64(buffer, start, end), _u64(buffer, start + 8, end)
    name, at = parse_text(buffer, start + 16, end)
    media_type, at = parse_text(buffer, at, end)
    size = _u64(buffer, at, end)
    data_offset = at + 8
    crc = _u32(buffer, data_offset + size, end)
    return Attachment(
        name=name, media_type=media_type, log_time_ns=log_time_ns, create_time_ns=create_time_ns,
        data_offset=data_offset, size=size, crc=crc, offset=start - RECORD_HEADER_SIZE, end=end,
    )  # fmt: skip


def parse_metadata(buffer: Bytes, start: int, end: int) -> tuple[str, dict[str, str]]:
    """A metadata record's name and entries.

    Raises:
        MalformedRecordError: its fields do not fit.
    """
    name, at = parse_text(buffer, start, end)
    return name, _text_map(buffer, at, end)[0]


def parse_text(buffer: Bytes, start: int, end: int) -> tuple[str, int]:
    """A string and where the next field starts.

    Raises:
        MalformedRecordError: it does not fit, or is no UTF-8.
    """
    data, at = _bytes(buffer, start, end)
    try:
        return data.decode(), at
    except UnicodeDecodeError as error:
        raise MalformedRecordError(f"text at byte {start} of the record's section is not UTF-8") from error


def _text_map(buffer: Bytes, start: int, end: int) -> tuple[dict[str, str], int]:
    stop = start + 4 + _u32(buffer, start, end)
    if stop > end:
        raise MalformedRecordError(f"a map ends {stop - end} bytes past its record")
    entries: dict[str, str] = {}
    at = start + 4
    while at < stop:
        key, at = parse_text(buffer, at, stop)
        entries[key], at = parse_text(buffer, at, stop)
    return entries, stop


def _bytes(buffer: Bytes, start: int, end: int) -> tuple[bytes, int]:
    stop = start + 4 + _u32(buffer, start, end)
    if stop > end:
        raise MalformedRecordError(f"a field ends {stop - end} bytes past its record")
    return bytes(buffer[start + 4 : stop]), stop


def _u16(buffer: Bytes, start: int, end: int) -> int:
    if start + 2 > end:
        raise MalformedRecordError("the record ends inside a number")
    return int(U16.unpack_from(buffer, start)[0])


def _u32(buffer: Bytes, start: int, end: int) -> int:
    if start + 4 > end:
        raise MalformedRecordError("the record ends inside a number")
    return int(U32.unpack_from(buffer, start)[0])


def _u64(buffer: Bytes, start: int, end: int) -> int:
    if start + 8 > end:
        raise MalformedRecordError("the record ends inside a number")
    return int(U64.unpack_from(buffer, start)[0])
