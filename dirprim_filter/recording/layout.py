"""The first pass over an MCAP file: record headers only, so that the second can read chunks in order of time.

Nothing here is decompressed, and the summary is not needed: it only helps with channels that stand in chunks.
After a record whose length makes no sense the walk goes on at the next bytes that are a consistent chunk
header.

Source: the MCAP specification, version 0. Opcodes 0x10 to 0x7F are reserved, so a file of this version holds
none; 0x80 and above are private and skipped.
"""

from __future__ import annotations

import re
import struct
import zlib
from dataclasses import dataclass, field, replace
from mmap import mmap

from dirprim_filter.recording.chunk import FIXED_SIZE, Chunk, chunk_at
from dirprim_filter.recording.damage import Damage, DamageKind
from dirprim_filter.recording.records import (
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    HEADER,
    MAGIC,
    MESSAGE,
    MESSAGE_HEADER,
    MESSAGE_INDEX,
    METADATA,
    RECORD_HEADER_SIZE,
    SCHEMA,
    U32,
    U64,
    Channel,
    MalformedRecordError,
    Schema,
    UndefinedSchemaError,
    parse_channel,
    parse_metadata,
    parse_schema,
)

RUN_BYTES = 1 << 22
"""Unchunked messages are read in runs of about this size."""
FOOTER_SIZE = 20
CHUNK_INDEX_HEAD = struct.Struct("<QQQ")
"""Start time, end time and offset of the chunk."""
CHUNK_HEADER = re.compile(
    rb"\x06(?=.{6}\0\0.{16}.{6}\0\0.{4}(?:\x04\0\0\0zstd|\x03\0\0\0lz4|\0\0\0\0).{6}\0\0)", re.DOTALL
)
"""The start of what may be a chunk: lengths below 2^48, a known compression. `chunk_at` then checks the
lengths."""


@dataclass(slots=True, kw_only=True)
class Layout:
    """Where everything stands.

    Attributes:
        chunks: in order of the file.
        channels: by id, as the data section defines them outside of chunks.
        summary_channels: by id, as the summary repeats them.
        is_summarised: the summary repeats all channels.
        schemas: by id, as they stand outside of chunks.
        metadata: name and entries of each metadata record.
        damage: what is broken, in order of the file.
    """

    chunks: list[Chunk] = field(default_factory=list)
    channels: dict[int, Channel] = field(default_factory=dict)
    summary_channels: dict[int, Channel] = field(default_factory=dict)
    is_summarised: bool = True
    schemas: dict[int, Schema] = field(default_factory=dict)
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    damage: list[Damage] = field(default_factory=list)


def read_layout(file: mmap) -> Layout:
    """The layout of a file that starts like an MCAP log."""
    walk = _Walk(file)
    walk.check_opening()
    at = len(MAGIC)
    while (after := walk.step(at)) is not None:
        at = after
    walk.check_chunk_indexes()
    return walk.layout


class _Walk:
    """The state of the pass: what was found so far, what the summary claims."""

    def __init__(self, file: mmap) -> None:
        self.file = file
        self.size = len(file)
        self.layout = Layout()
        self.has_unchunked = False
        self.data_end: int | None = None  # the byte after the DataEnd record
        self.indexed: dict[int, int] = {}  # where the summary says that chunks start, and their start times

    def check_opening(self) -> None:
        if self.file[: len(MAGIC)] != MAGIC:
            self.damaged("magic", 0, len(MAGIC), 0, f"expected {MAGIC!r} at the start, got {self.file[: len(MAGIC)]!r}")

    def step(self, at: int) -> int | None:
        """Take the record at `at`; the byte after it, or None at the end of the file."""
        if at + RECORD_HEADER_SIZE > self.size:
            self.ended_early(at)
            return None
        opcode = self.file[at]
        length = int(U64.unpack_from(self.file, at + 1)[0])
        body, end = at + RECORD_HEADER_SIZE, at + RECORD_HEADER_SIZE + length
        if opcode == MESSAGE and (after := self.take_messages(at)) > at:
            return after
        if opcode == CHUNK:
            return self.take_chunk(at, length)
        if not self.is_plausible(opcode, body, length):
            return self.recover(at, f"opcode {opcode:#04x}, length {length}")
        if opcode == FOOTER:
            self.take_footer(at, end)
            return None
        try:
            self.take_small(opcode, body, end)
        except MalformedRecordError as error:
            self.damaged("definition", at, end - at, None, str(error))
        return end

    def is_plausible(self, opcode: int, body: int, length: int) -> bool:
        """Whether a record other than a message or a chunk can be what its header says."""
        if body + length > self.size or opcode == 0 or DATA_END < opcode < 0x80:
            return False
        if opcode == MESSAGE_INDEX:
            return length >= 6 and int(U32.unpack_from(self.file, body + 2)[0]) <= length - 6
        if opcode in (FOOTER, DATA_END):
            return length >= (FOOTER_SIZE if opcode == FOOTER else U32.size)
        disguised = length >= FIXED_SIZE and chunk_at(self.file, body - RECORD_HEADER_SIZE)
        return not disguised or disguised.end != body + length

    def take_messages(self, at: int) -> int:
        """The messages that stand one after the other from `at` on, as one chunk of bounded size."""
        first, times = at, []
        while at + MESSAGE_HEADER.size <= self.size and at - first < RUN_BYTES:
            opcode, length, _, _, time_ns, _ = MESSAGE_HEADER.unpack_from(self.file, at)
            end = at + RECORD_HEADER_SIZE + length
            if opcode != MESSAGE or end > self.size:
                break
            at = end
            times.append(time_ns)
        if times:
            self.has_unchunked = True
            self.layout.chunks.append(
                Chunk(
                    offset=first, data_offset=first, data_length=at - first, size=at - first,
                    start_ns=min(times), end_ns=max(times), crc=0, compression="",
                )
            )  # fmt: skip
        return at

    def take_chunk(self, at: int, length: int) -> int | None:
        """A chunk by its record's length; where that and its own fields differ, by what fits in the file."""
        end = at + RECORD_HEADER_SIZE + length
        chunk = chunk_at(self.file, at)
        if chunk and (chunk.end == end or (chunk.is_cut and end > self.size)):
            self.layout.chunks.append(chunk)
            return chunk.end if not chunk.is_cut else None
        return self.recover(at, f"a chunk of length {length} whose fields contradict that")

    def take_small(self, opcode: int, body: int, end: int) -> None:
        if opcode == SCHEMA:
            schema_id, schema = parse_schema(self.file, body, end)
            self.layout.schemas[schema_id] = schema
        elif opcode == CHANNEL:
            self.take_channel(body, end)
        elif opcode == METADATA:
            self.layout.metadata.append(parse_metadata(self.file, body, end))
        elif opcode == CHUNK_INDEX and end - body >= CHUNK_INDEX_HEAD.size:
            start_ns, _, offset = CHUNK_INDEX_HEAD.unpack_from(self.file, body)
            self.indexed[offset] = start_ns
        elif opcode == DATA_END:
            self.check_data(body)
            self.data_end = end

    def take_channel(self, body: int, end: int) -> None:
        if self.data_end is None:
            channel_id, channel = parse_channel(self.file, body, end, self.layout.schemas)
            self.layout.channels[channel_id] = channel
            return
        try:
            channel_id, channel = parse_channel(self.file, body, end, self.layout.schemas)
        except UndefinedSchemaError:
            self.layout.is_summarised = False  # a summary need not repeat the schemas that stand in chunks
            return
        self.layout.summary_channels[channel_id] = channel

    def check_data(self, body: int) -> None:
        """Messages in chunks have their own checksums; for those outside only this one vouches."""
        expected = int(U32.unpack_from(self.file, body)[0])
        start = body - RECORD_HEADER_SIZE
        if expected and self.has_unchunked:
            found = zlib.crc32(memoryview(self.file)[:start])
            if found != expected:
                detail = f"expected CRC {expected:#010x}, got {found:#010x}; bare messages may be wrong"
                self.damaged("data_crc", 0, start, None, detail)

    def take_footer(self, at: int, end: int) -> None:
        body = at + RECORD_HEADER_SIZE
        start = int(U64.unpack_from(self.file, body)[0])
        expected = int(U32.unpack_from(self.file, body + 16)[0])
        if self.data_end is None:
            self.damaged("record", at, end - at, None, "expected a DataEnd record before the footer, got none")
        elif start not in (0, self.data_end):
            detail = f"the footer puts the summary at byte {start}, it starts at {self.data_end}"
            self.damaged("summary", at, end - at, 0, detail)
        elif expected and start:
            found = zlib.crc32(memoryview(self.file)[start : body + 16])
            if found != expected:
                detail = f"expected CRC {expected:#010x}, got {found:#010x}"
                self.damaged("summary", start, end - start, 0, detail)
        closing = self.file[end : end + len(MAGIC)]
        if closing != MAGIC:
            self.damaged("magic", end, len(closing), 0, f"expected {MAGIC!r} at the end, got {closing!r}")
        elif end + len(MAGIC) < self.size:
            n = self.size - end - len(MAGIC)
            self.damaged("trailing", end + len(MAGIC), n, None, f"{n} bytes after the end of the log")

    def recover(self, at: int, got: str) -> int | None:
        """Go on after a record that makes no sense: with the chunk it may still be, or the next one."""
        legal_end = at + RECORD_HEADER_SIZE + int(U64.unpack_from(self.file, at + 1)[0])
        chunk = chunk_at(self.file, at)
        if chunk and not chunk.is_cut and chunk.size and self.starts_record(chunk.end):
            self.damaged("record", at, RECORD_HEADER_SIZE, 0, f"{got}; by its fields a chunk, and read as one")
            self.layout.chunks.append(chunk)
            return chunk.end
        if legal_end > at + RECORD_HEADER_SIZE and self.starts_record(legal_end):
            self.damaged("record", at, legal_end - at, None, f"{got}; skipped")
            return legal_end
        found = self.next_chunk(at + 1)
        is_cut = found is None and HEADER <= self.file[at] <= DATA_END
        kind: DamageKind = "truncated" if is_cut else "record"
        until = self.size if found is None else found
        self.damaged(kind, at, until - at, None, f"{got}; {until - at} bytes from there on cannot be read")
        return found

    def starts_record(self, at: int) -> bool:
        """Whether a known record that fits in the file starts at `at`, or the file ends there."""
        if at + RECORD_HEADER_SIZE > self.size:
            return at == self.size
        length = int(U64.unpack_from(self.file, at + 1)[0])
        return HEADER <= self.file[at] <= DATA_END and at + RECORD_HEADER_SIZE + length <= self.size

    def next_chunk(self, at: int) -> int | None:
        while match := CHUNK_HEADER.search(self.file, at):
            at = match.start()
            chunk = chunk_at(self.file, at)
            length = int(U64.unpack_from(self.file, at + 1)[0])
            if chunk and (chunk.end == at + RECORD_HEADER_SIZE + length or chunk.is_cut):
                return at
            at += 1
        return None

    def ended_early(self, at: int) -> None:
        where = "after the data, before the footer" if self.data_end is not None else "before the end of the data"
        self.damaged("truncated", at, self.size - at, None if self.data_end is None else 0, f"the file ends {where}")

    def check_chunk_indexes(self) -> None:
        """Take the earlier of two start times; a chunk that only the summary knows is lost."""
        chunks = self.layout.chunks
        for i, chunk in enumerate(chunks):  # no checksum protects a chunk's times; one of the two may be right
            if self.indexed.get(chunk.offset, chunk.start_ns) < chunk.start_ns:
                chunks[i] = replace(chunk, start_ns=self.indexed[chunk.offset])
        found = {chunk.offset for chunk in chunks}
        missing = [offset for offset in self.indexed if offset not in found]
        if missing and not self.layout.damage:
            detail = f"{len(missing)} of {len(self.indexed)} chunk indexes point where no chunk is"
            self.damaged("summary", missing[0], 0, None, detail)

    def damaged(self, kind: DamageKind, offset: int, length: int, messages: int | None, detail: str) -> None:
        self.layout.damage.append(Damage(kind=kind, offset=offset, length=length, messages=messages, detail=detail))
