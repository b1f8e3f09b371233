"""The first pass over an MCAP file: record headers only, so that the second can read chunks in order of time.

Nothing here is decompressed, and the summary is not needed: it helps with channels that stand in chunks, and says
which chunks need not be opened.

Source: the MCAP specification, version 0.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from mcap.opcode import Opcode

from dirprim_filter.recording.container._kernels import MESSAGE_HEAD, MIN_MESSAGE, message_run
from dirprim_filter.recording.container.chunk import Chunk, chunk_at, indexes_after
from dirprim_filter.recording.container.damage import Damage, DamageKind
from dirprim_filter.recording.container.file_bytes import FileBytes
from dirprim_filter.recording.container.records import (
    CHUNK,
    MAGIC,
    MESSAGE_HEADER,
    PRIVATE,
    RECORD_HEADER_SIZE,
    U32,
    U64,
    Attachment,
    Channel,
    MalformedRecordError,
    Schema,
    parse,
    parse_attachment,
    parse_channel,
    parse_schema,
    record_end,
)
from dirprim_filter.recording.container.resync import Resync
from dirprim_filter.recording.container.summary_section import Summary, read_summary

RUN_BYTES = 1 << 22
"""Unchunked messages are read in runs of about this size."""
INDEXES = (Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX, Opcode.STATISTICS)
"""What stands in the Summary section alone."""
BEFORE_INDEX = (Opcode.CHUNK, Opcode.MESSAGE_INDEX)
"""What a message index stands behind."""


@dataclass(slots=True, kw_only=True)
class Outline:
    """Where everything stands.

    Attributes:
        chunks: in order of the file.
        channels: by id, as the data section defines them outside of chunks.
        schemas: by id, likewise.
        summary: what the Summary section repeats; without chunk indexes where these cannot be trusted.
        metadata: name and entries of each metadata record.
        attachments: those that are whole.
        private: first byte of each record of a private opcode, and the byte after it.
        profile: of the header.
        library: of the header: who wrote the file.
        damage: what is broken, in order of the file.
    """

    chunks: list[Chunk] = field(default_factory=list)
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    summary: Summary = field(default_factory=Summary)
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    attachments: list[Attachment] = field(default_factory=list)
    private: list[tuple[int, int]] = field(default_factory=list)
    profile: str = ""
    library: str = ""
    damage: list[Damage] = field(default_factory=list)


class LogFile:
    """One file of a log.

    Of a file elsewhere that has a whole Summary section with the places of its chunks, nothing else is read; damage in
    what is not read is not seen then.

    Args:
        name: of the file, where the log has several; else empty.
        bytes_of: what it holds.

    Attributes:
        outline: where everything stands in it, and what of that is broken; of a live pipe as far as it has come.
        kept: contents of chunks by their offset, with what is wrong with them.
    """

    def __init__(self, name: str, bytes_of: FileBytes) -> None:
        self.name, self.bytes_of = name, bytes_of
        self.kept: dict[int, tuple[bytes, Damage | None]] = {}
        self.outline = (_by_summary(bytes_of) if bytes_of.is_remote else None) or Outline()
        self._walk: _Walk | None = None
        if not self.outline.chunks:
            self._walk = _Walk(bytes_of, self.outline)

    def chunks(self) -> Iterator[Chunk]:
        """Those of the outline, and those that come meanwhile."""
        i = 0
        while i < len(self.outline.chunks) or (self._walk is not None and self._walk.advance()):
            yield self.outline.chunks[i]
            i += 1


def _by_summary(file: FileBytes) -> Outline | None:
    """By the Summary section alone; None where that is not whole or does not say where chunks stand."""
    summary = read_summary(file)
    if summary is None or not summary.chunks:
        return None
    outline = Outline(summary=summary)
    for index in sorted(summary.chunks.values(), key=lambda index: index.chunk_start_offset):
        head = RECORD_HEADER_SIZE + CHUNK.size + len(index.compression.encode()) + U64.size
        if head + index.compressed_size != index.chunk_length:
            return None
        outline.chunks.append(
            Chunk(
                offset=index.chunk_start_offset, data_offset=index.chunk_start_offset + head,
                data_length=index.compressed_size, size=index.uncompressed_size,
                start_ns=index.message_start_time, end_ns=index.message_end_time, crc=0, compression=index.compression,
            )
        )  # fmt: skip
    try:
        for one in summary.metadata:
            record = parse(file, one.offset)
            outline.metadata.append((record.name, record.metadata))
        outline.attachments = [parse_attachment(file, one.offset) for one in summary.attachments]
    except (MalformedRecordError, IndexError, struct.error, AttributeError):
        return None
    return outline


class _Walk:
    """The state of the pass: what was found so far, what the summary claims."""

    def __init__(self, file: FileBytes, outline: Outline) -> None:
        self.file = file
        self.resync = Resync(file)
        self.outline = outline
        self.has_unchunked = False
        self.data_end: int | None = None  # the byte after the DataEnd record
        self.summary_crc_holds = False
        self.at: int | None = len(MAGIC)
        self.previous = len(MAGIC)  # where the record before starts
        self.after_index = False  # the record before was a chunk or a message index
        opening = file.peek(0, len(MAGIC))
        if opening != MAGIC:
            self.damaged("magic", 0, len(MAGIC), 0, f"expected {MAGIC!r} at the start, got {opening!r}")
        while not file.is_live and self.at is not None:
            self.advance()

    def advance(self) -> bool:
        """Go on, to the next chunk at least; whether there is one."""
        n = len(self.outline.chunks)
        while self.at is not None and len(self.outline.chunks) == n:
            try:
                after = self.step(self.at)
            except (struct.error, IndexError):
                self.damaged("truncated", self.at, 0, None, "the file was cut short while it was read")
                after = None
            self.previous, self.at = self.at, after
            if after is None:
                self.check_summary()
        return len(self.outline.chunks) > n

    def step(self, at: int) -> int | None:
        """Take the record at `at`; the byte after it, or None at the end of the file."""
        header = self.file.peek(at, RECORD_HEADER_SIZE)
        if len(header) < RECORD_HEADER_SIZE:
            self.ended_early(at)
            return None
        opcode, after_index, end = header[0], self.after_index, at + record_end(header, 0)
        self.after_index = opcode in BEFORE_INDEX
        if opcode == Opcode.CHUNK:
            return self.take_chunk(at, end)
        after = at
        if opcode == Opcode.MESSAGE:
            if self.data_end is None and not (after_index and self.is_message_index(at, end)):
                if after_index and (found := self.swallowed(at)) is not None:
                    return found  # no bare messages: the rest of a chunk that the one before reaches into
                after = self.take_messages(at, end)
        elif opcode == Opcode.MESSAGE_INDEX and (after := indexes_after(self.file, at)[0]) == at:
            return end if self.resync.is_record(at, end) else self.recover(at, end)  # an index may have bytes more
        elif opcode != Opcode.MESSAGE_INDEX and self.resync.is_record(at, end):
            return self.take_small(opcode, at, end)
        return after if after > at else self.recover(at, end)

    def is_message_index(self, at: int, end: int) -> bool:
        """Whether a message behind a chunk is an index whose opcode was hit: its two lengths would agree."""
        body = at + RECORD_HEADER_SIZE
        if not body + 6 <= end or not self.file.has(end):
            return False
        return int(U32.unpack(self.file.peek(body + 2, U32.size))[0]) == end - body - 6

    def take_messages(self, at: int, end: int) -> int:
        """The messages that stand one after the other from `at` on, as one chunk of bounded size; the byte after."""
        if end < at + RECORD_HEADER_SIZE + MIN_MESSAGE or not self.file.has(end):
            return at
        window = self.file.window(at, MESSAGE_HEAD)
        length, first_ns, last_ns = message_run(np.frombuffer(window, np.uint8), 0, RUN_BYTES)
        if not length:  # it is longer than the window
            first_ns = last_ns = MESSAGE_HEADER.unpack_from(window)[4]
        stop = at + int(length) if length else end
        self.has_unchunked = True
        run = Chunk(
            offset=at, data_offset=at, data_length=stop - at, size=stop - at, start_ns=int(first_ns),
            end_ns=int(last_ns), crc=0, compression="",
        )  # fmt: skip
        chunks = self.outline.chunks
        before = chunks[-1] if chunks and not self.file.is_live else None
        if before and before.data_offset == before.offset and before.end == at and before.size < RUN_BYTES:
            run = replace(
                before, data_length=stop - before.offset, size=stop - before.offset,
                start_ns=min(before.start_ns, run.start_ns), end_ns=max(before.end_ns, run.end_ns),
            )  # fmt: skip
            chunks.pop()
        chunks.append(run)
        return stop

    def take_chunk(self, at: int, end: int) -> int | None:
        """A chunk by its record's length; where that and its own fields differ, by what fits in the file."""
        chunk = chunk_at(self.file, at, end)
        if not chunk:
            return self.recover(at, end)
        if chunk.is_cut and self.resync.next_chunk(chunk.data_offset, len(self.file)) is not None:
            return self.recover(at, end)  # the file goes on: not its end, but the chunk's length is wrong
        self.outline.chunks.append(chunk)
        return chunk.end if not chunk.is_cut else None

    def take_small(self, opcode: int, at: int, end: int) -> int | None:
        """A record that is no message, chunk or message index; the byte after it, None behind the last footer."""
        if opcode == Opcode.FOOTER:
            self.take_footer(at, end)
            return self.resync.next_chunk(end, len(self.file))  # of a log that goes on, this was not the end
        try:
            self.learn(opcode, at, end)
        except MalformedRecordError as error:
            self.damaged("attachment" if opcode == Opcode.ATTACHMENT else "definition", at, end - at, None, str(error))
        return end

    def learn(self, opcode: int, at: int, end: int) -> None:
        outline, file = self.outline, self.file
        if opcode == Opcode.HEADER:
            header = parse(file, at)
            outline.profile, outline.library = header.profile, header.library
        elif opcode in INDEXES or (self.data_end is not None and opcode in (Opcode.SCHEMA, Opcode.CHANNEL)):
            outline.summary.take(opcode, file, at, outline.schemas)
        elif opcode == Opcode.SCHEMA:
            schema_id, outline.schemas[schema_id] = parse_schema(file, at)
        elif opcode == Opcode.CHANNEL:
            channel_id, outline.channels[channel_id] = parse_channel(file, at, outline.schemas)
        elif opcode == Opcode.METADATA:
            record = parse(file, at)
            outline.metadata.append((record.name, record.metadata))
        elif opcode == Opcode.ATTACHMENT:
            self.take_attachment(at)
        elif opcode == Opcode.DATA_END:
            self.check_data(at, parse(file, at).data_section_crc)
            self.data_end = end
        elif opcode >= PRIVATE:
            outline.private.append((at, end))

    def take_attachment(self, at: int) -> None:
        attachment = parse_attachment(self.file, at)
        crc_at = attachment.data_offset + attachment.size
        if U32.unpack(self.file.peek(crc_at, U32.size))[0] in (0, self.file.crc(at + RECORD_HEADER_SIZE, crc_at)):
            self.outline.attachments.append(attachment)
        else:
            detail = f"attachment {attachment.name!r}: its checksum does not hold"
            self.damaged("attachment", at, attachment.end - at, 0, detail)

    def check_data(self, start: int, expected: int) -> None:
        """Messages in chunks have their own checksums; for those outside only this one vouches."""
        if expected and self.has_unchunked and (found := self.file.crc(0, start)) != expected:
            detail = f"expected CRC {expected:#010x}, got {found:#010x}; bare messages may be wrong"
            self.damaged("data_crc", 0, start, None, detail)

    def take_footer(self, at: int, end: int) -> None:
        footer = parse(self.file, at)
        start, expected = footer.summary_start, footer.summary_crc
        if self.data_end is None:
            self.damaged("record", at, end - at, None, "expected a DataEnd record before the footer, got none")
        elif start not in (0, self.data_end):
            detail = f"the footer puts the summary at byte {start}, it starts at {self.data_end}"
            self.damaged("summary", at, end - at, 0, detail)
        elif expected and start:
            found = self.file.crc(start, at + RECORD_HEADER_SIZE + 16)
            self.summary_crc_holds = found == expected
            if found != expected:
                detail = f"expected CRC {expected:#010x}, got {found:#010x}"
                self.damaged("summary", start, end - start, 0, detail)
        closing = self.file.peek(end, len(MAGIC))
        n_more = len(self.file) - end - len(MAGIC)
        if closing != MAGIC:
            self.damaged("magic", end, len(closing), 0, f"expected {MAGIC!r} at the end, got {closing!r}")
        elif n_more:
            self.damaged("trailing", end + len(MAGIC), n_more, None, f"{n_more} bytes after the end of the log")

    def recover(self, at: int, end: int) -> int | None:
        """Go on after a record that makes no sense: with the chunk it may still be, or the next one."""
        if (swallowed := self.swallowed(at)) is not None:
            return swallowed
        size, opcode = len(self.file), self.file.peek(at, 1)[0]
        got = f"opcode {opcode:#04x}, length {end - at - RECORD_HEADER_SIZE}"
        if chunk := self.resync.salvageable(at):
            self.damaged("record", at, RECORD_HEADER_SIZE, 0, f"{got}; by its fields a chunk, and read as one")
            self.outline.chunks.append(chunk)
            return chunk.end
        is_skipped = end > at + RECORD_HEADER_SIZE and self.resync.starts_record(end)
        if is_skipped and self.resync.next_chunk(at + 1, end) is None:
            self.damaged("record", at, end - at, None, f"{got}; skipped")
            return end
        found = self.resync.next_chunk(at + 1, size)
        is_cut = found is None and Opcode.HEADER <= opcode <= Opcode.DATA_END
        until = size if found is None else found
        got += f"; {until - at} bytes from there on cannot be read"
        self.damaged("truncated" if is_cut else "record", at, until - at, None, got)
        return found

    def swallowed(self, at: int) -> int | None:
        """A chunk within the record before, of which bytes are missing: its length then reaches beyond its end."""
        start = self.previous
        found = self.resync.next_chunk(start + 1, at) if start < at else None
        last = self.outline.chunks[-1] if self.outline.chunks else None
        if found is None or (last and last.offset == start and self.resync.is_sound(last)):
            return None
        self.damaged("record", start, found - start, None, f"a record of {at - start} bytes holds the chunk behind it")
        return found

    def ended_early(self, at: int) -> None:
        where = "after the data, before the footer" if self.data_end is not None else "before the end of the data"
        n_left = len(self.file) - at
        self.damaged("truncated", at, n_left, None if self.data_end is None else 0, f"the file ends {where}")

    def check_summary(self) -> None:
        """Compare with the data what the summary repeats of them."""
        if self.summary_crc_holds:
            self.check_channels()
        self.check_chunk_indexes()
        if any(damage.kind in ("summary", "truncated", "magic") for damage in self.outline.damage):
            self.outline.summary.chunks.clear()
            self.outline.summary.is_whole = False

    def check_channels(self) -> None:
        """No checksum protects what stands outside of chunks; what the summary's vouches for goes before."""
        for channel_id, channel in self.outline.summary.channels.items():
            own = self.outline.channels.get(channel_id, channel)
            if own != channel:
                detail = (
                    f"channel {channel_id}: {own.topic!r} in the data, {channel.topic!r} in the summary, which holds"
                )
                self.damaged("definition", 0, 0, 0, detail)
                self.outline.channels[channel_id] = channel

    def check_chunk_indexes(self) -> None:
        """Take the earlier of two start times; find chunks that only the summary knows."""
        outline = self.outline
        for i, chunk in enumerate(outline.chunks):  # no checksum protects a chunk's times; one of the two may be right
            said = outline.summary.chunks.get(chunk.offset)
            if said and said.message_start_time < chunk.start_ns:
                outline.chunks[i] = replace(chunk, start_ns=said.message_start_time)
        found = {chunk.offset for chunk in outline.chunks}
        missing = [offset for offset in outline.summary.chunks if offset not in found]
        if missing and not outline.damage:
            detail = f"{len(missing)} of {len(outline.summary.chunks)} chunk indexes point where no chunk is"
            self.damaged("summary", missing[0], 0, None, detail)

    def damaged(self, kind: DamageKind, offset: int, length: int, messages: int | None, detail: str) -> None:
        self.outline.damage.append(Damage(kind=kind, offset=offset, length=length, messages=messages, detail=detail))
