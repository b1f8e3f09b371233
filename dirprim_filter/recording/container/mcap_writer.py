"""Writing MCAP by the records of the `mcap` package: messages into chunks, indexes behind them, a summary at the end.

Its own writer takes four times as long, and knows no level of compression. Each chunk goes to the operating system when
it is closed, so that it outlives the process. The same calls give the same bytes.
"""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Mapping
from io import FileIO

import numpy as np
import zstandard
from mcap import records as fields
from mcap.opcode import Opcode

from dirprim_filter.recording.container.records import (
    MAGIC,
    MESSAGE_HEADER,
    MESSAGE_INDEX,
    NO_SCHEMA,
    RECORD_HEADER_SIZE,
    U32,
    Attachment,
    Channel,
    Schema,
    channel_record,
    record_header,
    schema_record,
    written,
)

CHUNK_BYTES = 1 << 20
LEVEL = 3
"""Of zstd: its own default."""
FIELDS_SIZE = MESSAGE_HEADER.size - RECORD_HEADER_SIZE
N_IDS = 1 << 16


class McapWriter:
    """Writes one file; `finish` makes it whole.

    Args:
        file: unbuffered, at its start.
        profile: of the header.
        library: of the header: who writes.
        chunk_bytes: a chunk is closed when its contents exceed this.
        level: of the compression.
    """

    def __init__(
        self, file: FileIO, *, profile: str = "", library: str, chunk_bytes: int = CHUNK_BYTES, level: int = LEVEL
    ) -> None:
        self._file = file
        self._at = 0
        self._crc = 0
        self._chunk_bytes = chunk_bytes
        self._compressor = zstandard.ZstdCompressor(level=level)
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, tuple[int, Channel]] = {}
        self._counts: Counter[int] = Counter()
        self._chunks: list[fields.ChunkIndex] = []
        self._attachments: list[fields.AttachmentIndex] = []
        self._metadata: list[fields.MetadataIndex] = []
        self._buffer = bytearray()
        self._entries: list[int] = []  # channel, log time, offset; again and again
        self._put(MAGIC + written(fields.Header(profile, library)))

    def define(self, channel: Channel) -> int:
        """Write a channel and its schema into the open chunk. -> its id.

        Raises:
            ValueError: all ids are taken.
        """
        schema_id = 0 if channel.schema == NO_SCHEMA else self._define_schema(channel.schema)
        channel_id = _free_id(self._channels)
        self._buffer += written(channel_record(channel_id, schema_id, channel))
        self._channels[channel_id] = (schema_id, channel)
        return channel_id

    def _define_schema(self, schema: Schema) -> int:
        for known_id, known in self._schemas.items():
            if known == schema:
                return known_id
        schema_id = _free_id(self._schemas)
        self._buffer += written(schema_record(schema_id, schema))
        self._schemas[schema_id] = schema
        return schema_id

    def add(self, channel_id: int, sequence: int, log_time_ns: int, publish_time_ns: int, data: bytes) -> None:
        """Append a message of a channel that is defined."""
        buffer = self._buffer
        self._entries += (channel_id, log_time_ns, len(buffer))
        buffer += MESSAGE_HEADER.pack(
            Opcode.MESSAGE, FIELDS_SIZE + len(data), channel_id, sequence, log_time_ns, publish_time_ns
        )
        buffer += data
        if len(buffer) >= self._chunk_bytes:
            self.close_chunk()

    def close_chunk(self) -> None:
        """Write what was appended as a chunk of its own and hand it to the operating system."""
        if not self._buffer:
            return
        entries = np.array(self._entries, np.uint64).reshape(-1, 3)
        contents = bytes(self._buffer)
        self._buffer.clear()
        self._entries.clear()
        first, last = (int(entries[:, 1].min()), int(entries[:, 1].max())) if len(entries) else (0, 0)
        data = self._compressor.compress(contents)
        chunk = fields.Chunk(
            compression="zstd", data=data, message_start_time=first, message_end_time=last,
            uncompressed_crc=zlib.crc32(contents), uncompressed_size=len(contents),
        )  # fmt: skip
        record = written(chunk)
        index = fields.ChunkIndex(
            message_start_time=first, message_end_time=last, compression="zstd", compressed_size=len(data),
            uncompressed_size=len(contents), chunk_start_offset=self._at, chunk_length=len(record),
            message_index_length=0, message_index_offsets={},
        )  # fmt: skip
        entries = entries[np.argsort(entries[:, 0], kind="stable")]
        ids, starts = np.unique(entries[:, 0], return_index=True)
        indexes = bytearray()
        for one, rows in zip(ids.tolist(), np.split(entries[:, 1:], starts[1:]), strict=False):
            index.message_index_offsets[one] = self._at + len(record) + len(indexes)
            body = MESSAGE_INDEX.pack(one, 16 * len(rows)) + rows.astype("<u8").tobytes()
            indexes += record_header(Opcode.MESSAGE_INDEX, len(body)) + body
            self._counts[one] += len(rows)
        index.message_index_length = len(indexes)
        self._chunks.append(index)
        self._put(record + indexes)

    def add_metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """Write a metadata record."""
        data = written(fields.Metadata(name=name, metadata=dict(entries)))
        self._metadata.append(fields.MetadataIndex(offset=self._at, length=len(data), name=name))
        self._put(data)

    def add_attachment(self, attachment: Attachment, data: bytes) -> None:
        """Take over an attachment: its record as it stands in another file."""
        index = fields.AttachmentIndex(
            offset=self._at, length=len(data), log_time=attachment.log_time_ns, create_time=attachment.create_time_ns,
            data_size=attachment.size, name=attachment.name, media_type=attachment.media_type,
        )  # fmt: skip
        self._attachments.append(index)
        self._put(data)

    def add_private(self, data: bytes) -> None:
        """Take over a record of a private opcode."""
        self._put(data)

    def finish(self) -> None:
        """Close the last chunk; write the summary and the footer."""
        self.close_chunk()
        self._put(written(fields.DataEnd(self._crc)))
        groups: dict[Opcode, list[fields.McapRecord]] = {
            Opcode.SCHEMA: [schema_record(*schema) for schema in self._schemas.items()],
            Opcode.CHANNEL: [channel_record(i, *channel) for i, channel in self._channels.items()],
            Opcode.STATISTICS: [self._statistics()],
            Opcode.CHUNK_INDEX: [*self._chunks],
            Opcode.ATTACHMENT_INDEX: [*self._attachments],
            Opcode.METADATA_INDEX: [*self._metadata],
        }
        summary, offsets = b"", []
        for opcode, records in groups.items():
            group = written(*records)
            if records:
                offsets.append(
                    fields.SummaryOffset(
                        group_opcode=opcode, group_start=self._at + len(summary), group_length=len(group)
                    )
                )
            summary += group
        footer = fields.Footer(self._at, self._at + len(summary), 0)
        end = (summary + written(*offsets, footer))[: -U32.size]
        self._put(end + U32.pack(zlib.crc32(end)) + MAGIC)

    def _statistics(self) -> fields.Statistics:
        with_messages = [chunk for chunk in self._chunks if chunk.message_index_offsets]
        return fields.Statistics(
            message_count=self._counts.total(),
            channel_message_counts={i: self._counts[i] for i in self._channels},
            message_start_time=min((chunk.message_start_time for chunk in with_messages), default=0),
            message_end_time=max((chunk.message_end_time for chunk in with_messages), default=0),
            schema_count=len(self._schemas), channel_count=len(self._channels), chunk_count=len(self._chunks),
            attachment_count=len(self._attachments), metadata_count=len(self._metadata),
        )  # fmt: skip

    def _put(self, data: bytes) -> None:
        view = memoryview(data)
        self._crc = zlib.crc32(view, self._crc)
        self._at += len(view)
        while view:
            view = view[self._file.write(view) :]


def _free_id(taken: Mapping[int, object]) -> int:
    if len(taken) >= N_IDS - 1:
        raise ValueError(f"expected fewer than {N_IDS} channels and schemas in one file")
    return len(taken) + 1
