"""The Summary section at the end of an MCAP file: what it holds and where, known without reading the data.

Trusted only where it is whole: its checksum, if it has one, must hold, and every place it names must lie in the file.

Source: the MCAP specification, version 0, "Summary Section".
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from mmap import mmap

from mcap.opcode import Opcode
from mcap.records import Statistics

from dirprim_filter.recording.container.records import (
    MAGIC,
    RECORD_HEADER_SIZE,
    U32,
    Channel,
    MalformedRecordError,
    Schema,
    parse,
    parse_channel,
    parse_schema,
    record_end,
)

FOOTER_SIZE = RECORD_HEADER_SIZE + 20
CHUNK_PLACE = struct.Struct("<QQ")
"""Of a chunk index, behind two times: where the chunk starts, and its length."""
CHUNK_PLACE_END = RECORD_HEADER_SIZE + 4 * 8


@dataclass(slots=True, kw_only=True)
class Summary:
    """A Summary section.

    Attributes:
        schemas: by id.
        channels: by id.
        statistics: None where there is no such record.
        attachments: their names.
        metadata: their records' names.
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    statistics: Statistics | None = None
    attachments: list[str] = field(default_factory=list)
    metadata: list[str] = field(default_factory=list)


def read_summary(file: mmap) -> Summary | None:
    """The Summary section of a file; None where it has none, or one that cannot be trusted."""
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
        return _parsed(file, start, footer, data_end)
    except MalformedRecordError:
        return None


def _parsed(file: mmap, at: int, footer: int, data_end: int) -> Summary:
    summary = Summary()
    while at < footer:
        end, opcode = record_end(file, at), file[at]
        if end > footer:
            raise MalformedRecordError("a record of the summary ends behind the footer")
        if opcode == Opcode.SCHEMA:
            schema_id, schema = parse_schema(file, at)
            summary.schemas[schema_id] = schema
        elif opcode == Opcode.CHANNEL:
            channel_id, channel = parse_channel(file, at, summary.schemas)
            summary.channels[channel_id] = channel
        elif opcode == Opcode.CHUNK_INDEX:
            _check_chunk(file, at, end, data_end)
        elif opcode == Opcode.ATTACHMENT_INDEX:
            summary.attachments.append(parse(file, at).name)
        elif opcode == Opcode.METADATA_INDEX:
            summary.metadata.append(parse(file, at).name)
        elif opcode == Opcode.STATISTICS:
            summary.statistics = parse(file, at)
        at = end
    return summary


def _check_chunk(file: mmap, at: int, end: int, data_end: int) -> None:
    """What a chunk index, the record from `at` to `end`, says is a chunk; a long log has hundreds of thousands.

    Raises:
        MalformedRecordError: otherwise.
    """
    if end - at >= CHUNK_PLACE_END:
        start, length = CHUNK_PLACE.unpack_from(file, at + CHUNK_PLACE_END - CHUNK_PLACE.size)
        stop = start + length
        if stop <= data_end and file[start] == Opcode.CHUNK and record_end(file, start) == stop:
            return
    raise MalformedRecordError("a chunk index of the summary points where no chunk is")
