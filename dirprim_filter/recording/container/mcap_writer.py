"""Writing MCAP: messages into chunks, indexes behind them, a summary at the end.

Each chunk goes to the operating system when it is closed, so that it outlives the process. Chunks of another file can
be taken over byte for byte. The same calls give the same bytes.

Source: the MCAP specification, version 0 (https://mcap.dev/spec).
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from io import FileIO

import numpy as np
import zstandard

from dirprim_filter.recording.container import encoding
from dirprim_filter.recording.container.records import (
    ATTACHMENT_INDEX,
    CHANNEL,
    CHUNK_INDEX,
    MAGIC,
    MESSAGE,
    MESSAGE_HEADER,
    METADATA_INDEX,
    NO_SCHEMA,
    RECORD_HEADER_SIZE,
    SCHEMA,
    STATISTICS,
    U32,
    Attachment,
    Channel,
    Schema,
)
from tessellation.arrays import AnyArray

CHUNK_BYTES = 1 << 20
LEVEL = 3
"""Of zstd: its own default."""
FIELDS_SIZE = MESSAGE_HEADER.size - RECORD_HEADER_SIZE
N_IDS = 1 << 16
NO_TIME = (1 << 64) - 1


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
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, tuple[int, Channel]] = {}
        self._counts: dict[int, int] = {}
        self._times = (NO_TIME, 0)
        self._chunk_indexes: list[bytes] = []
        self._attachment_indexes: list[bytes] = []
        self._metadata_indexes: list[bytes] = []
        self._buffer = bytearray()
        self._entries: list[int] = []  # channel, log time, offset; again and again
        self._put(MAGIC + encoding.header(profile, library))

    def define(self, channel: Channel, channel_id: int | None = None, schema_id: int | None = None) -> int:
        """Write a channel and its schema into the open chunk. -> its id.

        Args:
            channel: to be defined.
            channel_id: wanted; another is given where it is taken.
            schema_id: wanted, likewise.

        Raises:
            ValueError: all ids are taken.
        """
        schema_id = 0 if channel.schema == NO_SCHEMA else self.define_schema(channel.schema, schema_id)
        channel_id = _free_id(self.channels, channel_id, first=1)
        self._buffer += encoding.channel(channel_id, schema_id, channel)
        self.adopt_channel(channel_id, schema_id, channel)
        return channel_id

    def define_schema(self, schema: Schema, schema_id: int | None = None) -> int:
        """Write a schema into the open chunk, unless it is there under some id. -> its id."""
        for known_id, known in self.schemas.items():
            if known == schema:
                return known_id
        schema_id = _free_id(self.schemas, schema_id or None, first=1)
        self._buffer += encoding.schema(schema_id, schema)
        self.schemas[schema_id] = schema
        return schema_id

    def adopt_channel(self, channel_id: int, schema_id: int, channel: Channel) -> None:
        """Take note of a channel that is defined in the file already; its schema too."""
        if schema_id:
            self.schemas[schema_id] = channel.schema
        self.channels[channel_id] = (schema_id, channel)
        self._counts.setdefault(channel_id, 0)

    def add(self, channel_id: int, sequence: int, log_time_ns: int, publish_time_ns: int, data: bytes) -> None:
        """Append a message of a channel that is defined."""
        buffer = self._buffer
        self._entries += (channel_id, log_time_ns, len(buffer))
        buffer += MESSAGE_HEADER.pack(
            MESSAGE, FIELDS_SIZE + len(data), channel_id, sequence, log_time_ns, publish_time_ns
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
        chunk = encoding.ChunkRecord.of(contents, data, start_ns=first, end_ns=last, compression="zstd")
        self.put_chunk(chunk, entries[:, 0], entries[:, 1:])

    def put_chunk(self, chunk: encoding.ChunkRecord, channel_id: AnyArray, entries: AnyArray) -> None:
        """Write a whole chunk and its message indexes, behind what was appended so far.

        Args:
            chunk: the record.
            channel_id: (n) of its messages.
            entries: (n, 2) uint64, their log times and their offsets in the contents.
        """
        order = np.argsort(channel_id, kind="stable")
        ids, starts = np.unique(channel_id[order], return_index=True)
        packed = np.ascontiguousarray(entries[order].astype("<u8", copy=False))
        indexes, places, index_start = [], {}, self._at + len(chunk.written)
        at = index_start
        for one, rows in zip(ids.tolist(), np.split(packed, starts[1:]), strict=False):
            indexes.append(encoding.message_index(one, rows.tobytes()))
            places[one] = at
            at += len(indexes[-1])
            self._counts[one] += len(rows)
        if len(channel_id):
            self._times = (min(self._times[0], chunk.start_ns), max(self._times[1], chunk.end_ns))
        self._chunk_indexes.append(encoding.chunk_index(chunk, self._at, places, at - index_start))
        self._put(chunk.written + b"".join(indexes))

    def add_metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """Write a metadata record."""
        written = encoding.metadata(name, entries)
        self._metadata_indexes.append(encoding.metadata_index(self._at, len(written), name))
        self._put(written)

    def add_attachment(self, attachment: Attachment, written: bytes) -> None:
        """Take over an attachment: its record as it stands in another file."""
        self._attachment_indexes.append(encoding.attachment_index(attachment, self._at))
        self._put(written)

    def add_private(self, written: bytes) -> None:
        """Take over a record of a private opcode."""
        self._put(written)

    def finish(self) -> None:
        """Close the last chunk; write the summary and the footer."""
        self.close_chunk()
        self._put(encoding.data_end(self._crc))
        times = self._times if self._times[0] != NO_TIME else (0, 0)
        statistics = encoding.statistics(
            {i: self._counts[i] for i in self.channels}, times, n_schemas=len(self.schemas),
            n_attachments=len(self._attachment_indexes), n_metadata=len(self._metadata_indexes),
            n_chunks=len(self._chunk_indexes),
        )  # fmt: skip
        channels = [encoding.channel(i, schema_id, channel) for i, (schema_id, channel) in self.channels.items()]
        groups = {
            SCHEMA: [encoding.schema(i, schema) for i, schema in self.schemas.items()],
            CHANNEL: channels,
            STATISTICS: [statistics],
            CHUNK_INDEX: self._chunk_indexes,
            ATTACHMENT_INDEX: self._attachment_indexes,
            METADATA_INDEX: self._metadata_indexes,
        }
        summary_start = at = self._at
        offsets = []
        for opcode, records in groups.items():
            length = sum(map(len, records))
            if records:
                offsets.append(encoding.summary_offset(opcode, at, length))
            at += length
        summary = b"".join(part for records in groups.values() for part in records) + b"".join(offsets)
        summary += encoding.footer_before_crc(summary_start, at)
        self._put(summary + U32.pack(zlib.crc32(summary)) + MAGIC)

    def _put(self, data: bytes) -> None:
        view = memoryview(data)
        self._crc = zlib.crc32(view, self._crc)
        self._at += len(view)
        while view:
            view = view[self._file.write(view) :]


def _free_id(taken: Mapping[int, object], wanted: int | None, *, first: int) -> int:
    if wanted is not None and wanted not in taken:
        return wanted
    free = next((i for i in range(first, N_IDS) if i not in taken), None)
    if free is None:
        raise ValueError(f"expected fewer than {N_IDS} channels and schemas in one file")
    return free
