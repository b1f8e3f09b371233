"""The Summary section at the end of an MCAP file: what it holds and where, known without reading the data.

Read alone it is trusted only where it is whole: its checksum, if it has one, must hold, and every place it names must
lie in the file.

Source: the MCAP specification, version 0, "Summary Section".
"""

from __future__ import annotations

import zlib
from collections import ChainMap
from dataclasses import dataclass, field

from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Statistics

from dirprim_filter.recording.container.file_bytes import FileBytes
from dirprim_filter.recording.container.records import (
    CHUNK_INDEX,
    MAGIC,
    RECORD_HEADER_SIZE,
    U32,
    Bytes,
    Channel,
    MalformedRecordError,
    Schema,
    UndefinedSchemaError,
    parse,
    parse_channel,
    parse_schema,
    record_end,
)

FOOTER_SIZE = RECORD_HEADER_SIZE + 20


@dataclass(slots=True, kw_only=True)
class Summary:
    """A Summary section.

    Attributes:
        schemas: by id.
        channels: by id.
        chunks: chunk indexes, by the offset of their chunk.
        statistics: None where there is no such record.
        attachments: their names.
        metadata: their records' names.
        is_whole: it is not damaged, and the schemas of all its channels are known.
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: dict[int, ChunkIndex] = field(default_factory=dict)
    statistics: Statistics | None = None
    attachments: list[str] = field(default_factory=list)
    metadata: list[str] = field(default_factory=list)
    is_whole: bool = True

    def take(self, file: Bytes, at: int, schemas: dict[int, Schema]) -> None:
        """Learn from the record at `at`; a summary need not repeat the `schemas` that stand in the data.

        Raises:
            MalformedRecordError: it cannot be parsed.
        """
        opcode = file[at]
        if opcode == Opcode.CHUNK_INDEX:
            index = parse(file, at)
            self.chunks[index.chunk_start_offset] = index
        elif opcode == Opcode.SCHEMA:
            schema_id, self.schemas[schema_id] = parse_schema(file, at)
        elif opcode == Opcode.CHANNEL:
            try:
                channel_id, self.channels[channel_id] = parse_channel(file, at, ChainMap(self.schemas, schemas))
            except UndefinedSchemaError:
                self.is_whole = False
        elif opcode == Opcode.ATTACHMENT_INDEX:
            self.attachments.append(parse(file, at).name)
        elif opcode == Opcode.METADATA_INDEX:
            self.metadata.append(parse(file, at).name)
        elif opcode == Opcode.STATISTICS:
            self.statistics = parse(file, at)


def read_summary(file: FileBytes, *, with_chunks: bool = False) -> Summary | None:
    """The Summary section of a file; None where it has none, or one that cannot be trusted.

    A long log has hundreds of thousands of chunk indexes: unless they are wanted, only where they point is looked at.
    """
    footer = len(file) - len(MAGIC) - FOOTER_SIZE
    if footer < len(MAGIC) or file[-len(MAGIC) :] != MAGIC or file[footer] != Opcode.FOOTER:
        return None
    try:
        said = parse(file, footer)
        start = said.summary_start
        data_end = start - RECORD_HEADER_SIZE - U32.size
        if not len(MAGIC) <= data_end < start <= footer or file[data_end] != Opcode.DATA_END:
            return None
        with memoryview(file) as view:
            if said.summary_crc not in (0, zlib.crc32(view[start : footer + FOOTER_SIZE - U32.size])):
                return None
        summary, at = Summary(), start
        while at < footer:
            end = record_end(file, at)
            is_passed = file[at] == Opcode.CHUNK_INDEX and not with_chunks
            if end > footer or (is_passed and not _is_of_chunk(file, at, end, data_end)):
                return None
            if not is_passed:
                summary.take(file, at, {})
            at = end
    except MalformedRecordError:
        return None
    return summary if summary.is_whole else None


def _is_of_chunk(file: FileBytes, at: int, end: int, data_end: int) -> bool:
    """Whether a chunk stands where the chunk index, the record from `at` to `end`, says."""
    if end - at < RECORD_HEADER_SIZE + CHUNK_INDEX.size:
        return False
    _, _, start, length, _ = CHUNK_INDEX.unpack_from(file, at + RECORD_HEADER_SIZE)
    stop = start + length
    return bool(stop <= data_end and file[start] == Opcode.CHUNK and record_end(file, start) == stop)
