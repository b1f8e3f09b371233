"""The records of an MCAP file, as the `mcap` package has them, read, checked and written by one table.

Source: the MCAP specification, version 0 (https://mcap.dev/spec): little endian; a record is an opcode, a
length of 64 bits, and that many bytes; strings and maps carry a length of 32 bits in front.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from mmap import mmap
from typing import Any, NamedTuple

from mcap import records as fields
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
U32 = struct.Struct("<I")
U64 = struct.Struct("<Q")
_NUMBER = struct.Struct("<HQ")
"""An entry of a map of numbers."""
_CODES: dict[int | str, str] = {
    1: "B", 2: "H", 4: "I", 8: "Q", "text": "I", "data": "I", "texts": "I", "numbers": "I", "place": "Q",
}  # fmt: skip
"""Forms of numbers, given by their bytes, and of the length that other fields carry in front."""
RECORDS: dict[int, dict[str, int | str]] = {
    Opcode.HEADER: {"profile": "text", "library": "text"},
    Opcode.FOOTER: {"summary_start": 8, "summary_offset_start": 8, "summary_crc": 4},
    Opcode.SCHEMA: {"id": 2, "name": "text", "encoding": "text", "data": "data"},
    Opcode.CHANNEL: {"id": 2, "schema_id": 2, "topic": "text", "message_encoding": "text", "metadata": "texts"},
    Opcode.CHUNK: {
        "message_start_time": 8, "message_end_time": 8, "uncompressed_size": 8, "uncompressed_crc": 4,
        "compression": "text", "data": "place",
    },
    Opcode.MESSAGE_INDEX: {"channel_id": 2, "records": "data"},
    Opcode.CHUNK_INDEX: {
        "message_start_time": 8, "message_end_time": 8, "chunk_start_offset": 8, "chunk_length": 8,
        "message_index_offsets": "numbers", "message_index_length": 8, "compression": "text", "compressed_size": 8,
        "uncompressed_size": 8,
    },
    Opcode.ATTACHMENT: {
        "log_time": 8, "create_time": 8, "name": "text", "media_type": "text", "data": "place", "crc": 4,
    },
    Opcode.ATTACHMENT_INDEX: {
        "offset": 8, "length": 8, "log_time": 8, "create_time": 8, "data_size": 8, "name": "text", "media_type": "text",
    },
    Opcode.STATISTICS: {
        "message_count": 8, "schema_count": 2, "channel_count": 4, "attachment_count": 4, "metadata_count": 4,
        "chunk_count": 4, "message_start_time": 8, "message_end_time": 8, "channel_message_counts": "numbers",
    },
    Opcode.METADATA: {"name": "text", "metadata": "texts"},
    Opcode.METADATA_INDEX: {"offset": 8, "length": 8, "name": "text"},
    Opcode.SUMMARY_OFFSET: {"group_opcode": 1, "group_start": 8, "group_length": 8},
    Opcode.DATA_END: {"data_section_crc": 4},
}  # fmt: skip
"""The fields of all records but messages, by the names of the mcap package: by this table they are read, checked and
written."""
_KINDS = {int(opcode): getattr(fields, Opcode(opcode).name.title().replace("_", "")) for opcode in RECORDS}
_OPCODES = {kind: opcode for opcode, kind in _KINDS.items()}


def _parts_of(layout: dict[str, int | str]) -> list[tuple[struct.Struct, str]]:
    """Fields that stand beside each other are read at once, which is sooner: numbers, and the length behind them.

    Returns:
        forms, each with the kind of what follows that length; the last may have none.
    """
    parts, codes = [], "<"
    for kind in layout.values():
        codes += _CODES[kind]
        if isinstance(kind, str):
            parts.append((struct.Struct(codes), kind))
            codes = "<"
    return [*parts, (struct.Struct(codes), "")] if codes != "<" else parts


_PARTS = {int(opcode): _parts_of(layout) for opcode, layout in RECORDS.items()}
CHUNK, CHUNK_INDEX, MESSAGE_INDEX = (
    _PARTS[opcode][0][0] for opcode in (Opcode.CHUNK, Opcode.CHUNK_INDEX, Opcode.MESSAGE_INDEX)
)
"""The numbers that these records begin with, and the length of what stands behind them."""


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


def record_header(opcode: int, length: int) -> bytes:
    """What stands in front of a record's fields."""
    return bytes([opcode]) + U64.pack(length)


def record_end(buffer: Bytes, at: int) -> int:
    """The byte after the record at `at`, by its length alone."""
    length: int = U64.unpack_from(buffer, at + 1)[0]
    return at + RECORD_HEADER_SIZE + length


def fields_end(buffer: Bytes, at: int, end: int) -> int | None:
    """The byte after the fields that this version knows of the record at `at`; None where they end past `end`."""
    opcode, at = buffer[at], at + RECORD_HEADER_SIZE
    for form, kind in _PARTS[opcode]:
        start, at = at, at + form.size
        if at > end:
            return None
        if kind:
            at += form.unpack_from(buffer, start)[-1]
    return at if at <= end else None


def fields_of(buffer: Bytes, at: int) -> dict[str, Any]:
    """The fields of the record at `at` by name; of data of any size the place.

    Raises:
        MalformedRecordError: they do not fit, or a text is no UTF-8.
    """
    opcode, end = buffer[at], record_end(buffer, at)
    if end > len(buffer) or fields_end(buffer, at, end) is None:
        raise MalformedRecordError(f"the fields of a {Opcode(opcode).name} record end past it")
    values: list[Any] = []
    at += RECORD_HEADER_SIZE
    try:
        for form, kind in _PARTS[opcode]:
            values += form.unpack_from(buffer, at)
            at += form.size
            if kind:
                start, at = at, at + values[-1]
                values[-1] = (start, at) if kind == "place" else _READERS[kind](buffer[start:at])
    except UnicodeDecodeError as error:
        raise MalformedRecordError(f"a field of a {Opcode(opcode).name} record is not UTF-8") from error
    except struct.error as error:
        raise MalformedRecordError(f"a map of a {Opcode(opcode).name} record does not end where it says") from error
    return dict(zip(RECORDS[opcode], values, strict=True))


def _texts(data: bytes) -> dict[str, str]:
    texts, at = [], 0
    while at < len(data):
        start = at + U32.size
        at = start + int(U32.unpack_from(data, at)[0])
        texts.append(data[start:at].decode())
    if at != len(data) or len(texts) % 2:
        raise struct.error
    return dict(zip(texts[::2], texts[1::2], strict=True))


_READERS: dict[str, Callable[[bytes], Any]] = {
    "text": bytes.decode,
    "data": bytes,
    "texts": _texts,
    "numbers": lambda data: dict(_NUMBER.iter_unpack(data)),
}


def parse(buffer: Bytes, at: int) -> Any:
    """The record at `at` as the mcap package has it; no message, chunk or attachment.

    Raises:
        MalformedRecordError: its fields do not fit, or a text is no UTF-8.
    """
    return _KINDS[buffer[at]](**fields_of(buffer, at))


def parse_schema(buffer: Bytes, at: int) -> tuple[int, Schema]:
    """A schema record's id and contents.

    Raises:
        MalformedRecordError: its fields do not fit.
    """
    record = parse(buffer, at)
    return record.id, Schema(name=record.name, encoding=record.encoding, data=record.data)


def parse_channel(buffer: Bytes, at: int, schemas: Mapping[int, Schema]) -> tuple[int, Channel]:
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
    said = fields_of(file, at)
    start, stop = said["data"]
    return Attachment(
        name=said["name"], media_type=said["media_type"], log_time_ns=said["log_time"], crc=said["crc"],
        create_time_ns=said["create_time"], data_offset=start, size=stop - start, offset=at, end=record_end(file, at),
    )  # fmt: skip


def written(*records: fields.McapRecord) -> bytes:
    """Records as they stand in a file."""
    return b"".join(encoded(_OPCODES[type(record)], vars(record)) for record in records)


def encoded(opcode: int, values: Mapping[str, Any]) -> bytes:
    """A record of these fields."""
    body = b"".join(_encoded(kind, values[name]) for name, kind in RECORDS[opcode].items())
    return record_header(opcode, len(body)) + body


def _encoded(kind: int | str, value: Any) -> bytes:
    if isinstance(kind, int):
        return int(value).to_bytes(kind, "little")
    if kind == "numbers":
        value = b"".join(_NUMBER.pack(*entry) for entry in value.items())
    elif kind == "texts":
        value = b"".join(_encoded("text", text) for entry in value.items() for text in entry)
    data: bytes = value.encode() if kind == "text" else value
    return struct.pack(f"<{_CODES[kind]}", len(data)) + data


def schema_record(schema_id: int, schema: Schema) -> fields.Schema:
    """A schema to be written."""
    return fields.Schema(id=schema_id, name=schema.name, encoding=schema.encoding, data=schema.data)


def channel_record(channel_id: int, schema_id: int, channel: Channel) -> fields.Channel:
    """A channel to be written; schema id 0 is none."""
    return fields.Channel(
        id=channel_id, topic=channel.topic, message_encoding=channel.message_encoding,
        metadata=dict(channel.metadata), schema_id=schema_id,
    )  # fmt: skip
