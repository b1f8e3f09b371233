"""The Summary section at the end of an MCAP file: what it holds and where, known without reading the data.

Read alone it is trusted only where it is whole: its checksum, if it has one, must hold, and every chunk that it names
must lie in the data section.

Source: the MCAP specification, version 0, "Summary Section".
"""

from __future__ import annotations

import struct
import zlib
from collections import ChainMap
from contextlib import suppress
from dataclasses import dataclass, field

from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, ChunkIndex, MetadataIndex, Statistics

from dirprim_filter.recording.container.file_bytes import FileBytes
from dirprim_filter.recording.container.records import (
    DEFINITIONS,
    KINDS,
    MAGIC,
    RECORD_HEADER_SIZE,
    U32,
    Bytes,
    Channel,
    MalformedRecordError,
    Schema,
    UndefinedSchemaError,
    define,
    parse,
    record_end,
)

FOOTER_SIZE = RECORD_HEADER_SIZE + 20
MOST_BYTES = 1 << 28
"""At once in memory."""


@dataclass(slots=True, kw_only=True)
class Summary:
    """A Summary section.

    Attributes:
        schemas: by id.
        channels: by id.
        chunks: chunk indexes, by the offset of their chunk.
        statistics: None where there is no such record.
        attachments: their indexes.
        metadata: likewise.
        is_whole: it is not damaged, and the schemas of all its channels are known.
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: dict[int, ChunkIndex] = field(default_factory=dict)
    statistics: Statistics | None = None
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    is_whole: bool = True

    def take(self, opcode: int, buffer: Bytes, at: int, schemas: dict[int, Schema]) -> None:
        """Learn from the record at `at`; a summary need not repeat the `schemas` that stand in the data.

        Raises:
            MalformedRecordError: it cannot be parsed.
        """
        if opcode == Opcode.CHUNK_INDEX:
            index = parse(buffer, at)
            self.chunks[index.chunk_start_offset] = index
        elif opcode in DEFINITIONS:
            try:
                define(buffer, at, ChainMap(self.schemas, schemas), self.channels)
            except UndefinedSchemaError:
                self.is_whole = False
        elif opcode == Opcode.ATTACHMENT_INDEX:
            self.attachments.append(parse(buffer, at))
        elif opcode == Opcode.METADATA_INDEX:
            self.metadata.append(parse(buffer, at))
        elif opcode == Opcode.STATISTICS:
            self.statistics = parse(buffer, at)


def read_summary(file: FileBytes) -> Summary | None:
    """The Summary section of a file; None where it has none, or one that cannot be trusted."""
    with suppress(MalformedRecordError, struct.error):
        summary = _summary_of(file)
        return summary if summary.is_whole else None
    return None


def _summary_of(file: FileBytes) -> Summary:
    footer_at = len(file) - len(MAGIC) - FOOTER_SIZE
    ending = file.read(max(footer_at, 0), len(file))
    if footer_at < len(MAGIC) or ending[-len(MAGIC) :] != MAGIC or ending[0] != Opcode.FOOTER:
        raise MalformedRecordError("no footer at the end")
    footer = parse(ending, 0)
    start = footer.summary_start
    data_end = start - RECORD_HEADER_SIZE - U32.size
    if not len(MAGIC) <= data_end < start <= footer_at or footer_at - start > MOST_BYTES:
        raise MalformedRecordError("the footer names no place of a summary")
    section = file.read(start, footer_at)
    crc = zlib.crc32(section + ending[: FOOTER_SIZE - U32.size])
    if file.peek(data_end, 1)[0] != Opcode.DATA_END or footer.summary_crc not in (0, crc):
        raise MalformedRecordError("the checksum does not hold, or no data end before it")
    summary, at = Summary(), 0
    while at < len(section):
        if section[at] in KINDS:
            summary.take(section[at], section, at, {})
        at = record_end(section, at)
    chunks = summary.chunks.values()
    are_there = all(chunk.chunk_start_offset + chunk.chunk_length <= data_end for chunk in chunks)
    summary.is_whole &= at == len(section) and are_there
    return summary
