"""The bytes of MCAP records.

Source: the MCAP specification, version 0 (https://mcap.dev/spec).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from dirprim_filter.recording.container.records import (
    ATTACHMENT_INDEX,
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    HEADER,
    MESSAGE_INDEX,
    METADATA,
    METADATA_INDEX,
    SCHEMA,
    STATISTICS,
    SUMMARY_OFFSET,
    U16,
    U32,
    U64,
    Attachment,
    Channel,
    Schema,
)

RECORD_HEAD = struct.Struct("<BQ")


def record(opcode: int, *fields: bytes) -> bytes:
    """A record of these fields."""
    body = b"".join(fields)
    return RECORD_HEAD.pack(opcode, len(body)) + body


def text(value: str | bytes) -> bytes:
    """A string, or bytes with a length of 32 bits."""
    data = value.encode() if isinstance(value, str) else value
    return U32.pack(len(data)) + data


def text_map(entries: Mapping[str, str]) -> bytes:
    """A map of strings."""
    return text(b"".join(text(key) + text(value) for key, value in entries.items()))


def header(profile: str, library: str) -> bytes:
    """The first record."""
    return record(HEADER, text(profile), text(library))


def schema(schema_id: int, defined: Schema) -> bytes:
    """A schema."""
    return record(SCHEMA, U16.pack(schema_id), text(defined.name), text(defined.encoding), text(defined.data))


def channel(channel_id: int, schema_id: int, defined: Channel) -> bytes:
    """A channel; schema id 0 is none."""
    ids = U16.pack(channel_id) + U16.pack(schema_id)
    return record(CHANNEL, ids, text(defined.topic), text(defined.message_encoding), text_map(dict(defined.metadata)))


def metadata(name: str, entries: Mapping[str, str]) -> bytes:
    """A metadata record."""
    return record(METADATA, text(name), text_map(entries))


@dataclass(frozen=True, slots=True, kw_only=True)
class ChunkRecord:
    """A chunk as it goes into a file, and what its index repeats of it.

    Attributes:
        start_ns: log time of its first message.
        end_ns: log time of its last message.
        compression: of its data.
        compressed_size: bytes of its data.
        size: bytes of its contents.
        written: the whole record.
    """

    start_ns: int
    end_ns: int
    compression: str
    compressed_size: int
    size: int
    written: bytes

    @classmethod
    def of(cls, contents: bytes, data: bytes, *, start_ns: int, end_ns: int, compression: str) -> Self:
        """A chunk of contents that are compressed to `data`."""
        head = struct.pack("<QQQI", start_ns, end_ns, len(contents), zlib.crc32(contents))
        return cls(
            start_ns=start_ns, end_ns=end_ns, compression=compression, compressed_size=len(data), size=len(contents),
            written=record(CHUNK, head, text(compression), U64.pack(len(data)), data),
        )  # fmt: skip


def message_index(channel_id: int, entries: bytes) -> bytes:
    """The places of one channel's messages in a chunk: log time and offset of each, packed."""
    return record(MESSAGE_INDEX, U16.pack(channel_id), text(entries))


def chunk_index(chunk: ChunkRecord, offset: int, indexes: Mapping[int, int], index_length: int) -> bytes:
    """Where a chunk stands; `indexes` has the offsets of its message indexes by channel."""
    places = b"".join(struct.pack("<HQ", *place) for place in indexes.items())
    head = struct.pack("<QQQQ", chunk.start_ns, chunk.end_ns, offset, len(chunk.written))
    sizes = struct.pack("<QQ", chunk.compressed_size, chunk.size)
    return record(CHUNK_INDEX, head, text(places), U64.pack(index_length), text(chunk.compression), sizes)


def attachment_index(attachment: Attachment, offset: int) -> bytes:
    """Where an attachment stands in the new file."""
    length = attachment.end - attachment.offset
    head = struct.pack("<QQQQQ", offset, length, attachment.log_time_ns, attachment.create_time_ns, attachment.size)
    return record(ATTACHMENT_INDEX, head, text(attachment.name), text(attachment.media_type))


def metadata_index(offset: int, length: int, name: str) -> bytes:
    """Where a metadata record stands."""
    return record(METADATA_INDEX, struct.pack("<QQ", offset, length), text(name))


def statistics(
    counts: Mapping[int, int],
    times: tuple[int, int],
    *,
    n_schemas: int,
    n_attachments: int,
    n_metadata: int,
    n_chunks: int,
) -> bytes:
    """What the log holds; `counts` are the messages by channel."""
    head = struct.pack(
        "<QHIIIIQQ", sum(counts.values()), n_schemas, len(counts), n_attachments, n_metadata, n_chunks, *times
    )
    return record(STATISTICS, head, text(b"".join(struct.pack("<HQ", *count) for count in counts.items())))


def summary_offset(opcode: int, start: int, length: int) -> bytes:
    """Where the records of one kind stand in the summary."""
    return record(SUMMARY_OFFSET, struct.pack("<BQQ", opcode, start, length))


def data_end(crc: int) -> bytes:
    """The end of the data section."""
    return record(DATA_END, U32.pack(crc))


def footer_before_crc(summary_start: int, offsets_start: int) -> bytes:
    """The footer but for its last field, the checksum of the summary up to there."""
    return RECORD_HEAD.pack(FOOTER, 20) + struct.pack("<QQ", summary_start, offsets_start)
