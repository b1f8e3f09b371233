"""The summary at the end of an MCAP file: what it holds and where, told without reading the data.

Trusted only where it is whole: its checksum, if it has one, must hold, and every place it names must lie in the file.

Source: the MCAP specification, version 0, "Summary Section".
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from mmap import mmap

from dirprim_filter.recording.container.records import (
    ATTACHMENT_INDEX,
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    MAGIC,
    METADATA_INDEX,
    RECORD_HEADER_SIZE,
    SCHEMA,
    STATISTICS,
    U32,
    U64,
    Channel,
    MalformedRecordError,
    Schema,
    parse_channel,
    parse_schema,
    parse_text,
)

FOOTER_BODY = struct.Struct("<QQI")
"""Start of the summary, start of its offsets, CRC of the summary."""
STATISTICS_HEAD = struct.Struct("<QHIIIIQQI")
"""Numbers of messages, schemas, channels, attachments, metadata, chunks; first and last log time; bytes of counts."""
COUNT = struct.Struct("<HQ")
CHUNK_INDEX_HEAD = struct.Struct("<QQQQI")
"""First and last log time; offset and length of the chunk's record; bytes of the message indexes' places."""
PLACE = struct.Struct("<HQ")
ATTACHMENT_NAME_AT, METADATA_NAME_AT = 40, 16
"""Bytes before the name in an attachment index and in a metadata index."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChunkIndex:
    """What the summary says of a chunk.

    Attributes:
        start_ns: log time of its first message.
        end_ns: log time of its last message.
        offset: byte where its record starts.
        length: bytes of its record.
        channels: ids of the channels in it; empty where the log has no message indexes.
    """

    start_ns: int
    end_ns: int
    offset: int
    length: int
    channels: frozenset[int]


@dataclass(slots=True, kw_only=True)
class Index:
    """A summary.

    Attributes:
        schemas: by id.
        channels: by id.
        chunks: by the byte where they start.
        counts: messages by channel id; None where there is no Statistics record.
        start_ns: first log time, by the Statistics record.
        end_ns: last log time.
        attachments: their names.
        metadata: their records' names.
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: dict[int, ChunkIndex] = field(default_factory=dict)
    counts: dict[int, int] | None = None
    start_ns: int = 0
    end_ns: int = 0
    attachments: list[str] = field(default_factory=list)
    metadata: list[str] = field(default_factory=list)


def read_index(file: mmap) -> Index | None:
    """The summary of a file; None where it has none, or one that cannot be trusted."""
    footer = len(file) - len(MAGIC) - RECORD_HEADER_SIZE - FOOTER_BODY.size
    if footer < len(MAGIC) or file[-len(MAGIC) :] != MAGIC or file[footer] != FOOTER:
        return None
    start, _, expected = FOOTER_BODY.unpack_from(file, footer + RECORD_HEADER_SIZE)
    data_end = start - RECORD_HEADER_SIZE - U32.size
    if not len(MAGIC) <= data_end < start <= footer or file[data_end] != DATA_END:
        return None
    with memoryview(file) as view:
        if expected not in (0, zlib.crc32(view[start : footer + RECORD_HEADER_SIZE + 16])):
            return None
    index = Index()
    try:
        _read_records(index, file, start, footer)
    except (MalformedRecordError, struct.error):
        return None
    return index if all(_is_chunk(file, chunk, data_end) for chunk in index.chunks.values()) else None


def _read_records(index: Index, file: mmap, at: int, footer: int) -> None:
    while at < footer:
        end = at + RECORD_HEADER_SIZE + int(U64.unpack_from(file, at + 1)[0])
        if end > footer:
            raise MalformedRecordError("a record of the summary ends behind the footer")
        _take(index, file, at, end)
        at = end


def _take(index: Index, file: mmap, at: int, end: int) -> None:
    """Learn from one record of the summary."""
    opcode, body = file[at], at + RECORD_HEADER_SIZE
    if opcode == SCHEMA:
        schema_id, schema = parse_schema(file, body, end)
        index.schemas[schema_id] = schema
    elif opcode == CHANNEL:
        channel_id, channel = parse_channel(file, body, end, index.schemas)
        index.channels[channel_id] = channel
    elif opcode == CHUNK_INDEX:
        chunk = parse_chunk_index(file, body, end)
        index.chunks[chunk.offset] = chunk
    elif opcode == ATTACHMENT_INDEX:
        index.attachments.append(parse_text(file, body + ATTACHMENT_NAME_AT, end)[0])
    elif opcode == METADATA_INDEX:
        index.metadata.append(parse_text(file, body + METADATA_NAME_AT, end)[0])
    elif opcode == STATISTICS:
        *_, index.start_ns, index.end_ns, n_bytes = STATISTICS_HEAD.unpack_from(file, body)
        first = body + STATISTICS_HEAD.size
        if first + n_bytes > end or n_bytes % COUNT.size:
            raise MalformedRecordError("the counts do not fit in their record")
        index.counts = dict(COUNT.iter_unpack(file[first : first + n_bytes]))


def parse_chunk_index(file: mmap, body: int, end: int) -> ChunkIndex:
    """A chunk index record.

    Raises:
        MalformedRecordError: its fields do not fit.
    """
    if body + CHUNK_INDEX_HEAD.size > end:
        raise MalformedRecordError("a chunk index ends inside a number")
    start_ns, end_ns, offset, length, n_bytes = CHUNK_INDEX_HEAD.unpack_from(file, body)
    first = body + CHUNK_INDEX_HEAD.size
    if first + n_bytes > end or n_bytes % PLACE.size:
        raise MalformedRecordError("a chunk index's places do not fit in their record")
    channels = frozenset(channel for channel, _ in PLACE.iter_unpack(file[first : first + n_bytes]))
    return ChunkIndex(start_ns=start_ns, end_ns=end_ns, offset=offset, length=length, channels=channels)


def _is_chunk(file: mmap, chunk: ChunkIndex, data_end: int) -> bool:
    if chunk.offset + chunk.length > data_end or file[chunk.offset] != CHUNK:
        return False
    return int(U64.unpack_from(file, chunk.offset + 1)[0]) + RECORD_HEADER_SIZE == chunk.length
