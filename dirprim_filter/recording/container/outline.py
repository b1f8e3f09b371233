"""The first pass over an MCAP file: record headers only, so that the second can read chunks in order of time.

Nothing here is decompressed, and the summary is not needed: it helps with channels that stand in chunks, and says
which chunks need not be opened.

Source: the MCAP specification, version 0.
"""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
from mcap.opcode import Opcode

from dirprim_filter.recording.container._kernels import MESSAGE_HEAD, MIN_MESSAGE, message_run
from dirprim_filter.recording.container.chunk import Chunk, Resync, chunk_at, indexes_after
from dirprim_filter.recording.container.errors import Damage, DamageKind
from dirprim_filter.recording.container.file_bytes import FileBytes
from dirprim_filter.recording.container.records import (
    CHUNK,
    DEFINITIONS,
    MAGIC,
    MESSAGE_HEADER,
    PRIVATE,
    RECORD_HEADER_SIZE,
    U32,
    U64,
    Channel,
    MalformedRecordError,
    Schema,
    define,
    parse,
    parse_known,
    record_end,
)
from dirprim_filter.recording.container.summary_section import Summary, read_summary

RUN_BYTES = 1 << 22
"""Unchunked messages are read in runs of about this size."""
INDEXES = (Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX, Opcode.STATISTICS)
"""What stands in the Summary section alone."""
BEFORE_INDEX = (Opcode.CHUNK, Opcode.MESSAGE_INDEX)
"""What a message index stands behind."""


class Outline:
    """Where everything stands in a file.

    Of a file elsewhere that has a whole Summary section with the places of its chunks, nothing else is read.

    Attributes:
        chunks: in order of the file; of a live pipe as far as `advance` has come.
        channels: by id, as the data section defines them outside of chunks.
        schemas: by id, likewise.
        summary: what the Summary section repeats; without chunk indexes where these cannot be trusted.
        metadata: name and entries of each metadata record.
        attachments: first byte and name of those that are whole.
        private: first byte of each record of a private opcode, and the byte after it.
        profile: of the header.
        library: of the header: who wrote the file.
        damage: what is broken, in order of the file.
    """

    def __init__(self, file: FileBytes) -> None:
        self.chunks: list[Chunk] = []
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.summary = Summary()
        self.metadata: list[tuple[str, dict[str, str]]] = []
        self.attachments: list[tuple[int, str]] = []
        self.private: list[tuple[int, int]] = []
        self.profile = self.library = ""
        self.damage: list[Damage] = []
        self._file = file
        self._resync = Resync(file)
        self._has_unchunked = self._summary_crc_holds = False
        self._data_end: int | None = None  # the byte after the DataEnd record
        self._at: int | None = len(MAGIC)
        self._previous = len(MAGIC)  # where the record before starts
        self._after_index = False  # the record before was a chunk or a message index
        if file.is_remote and self._take_summary_alone():
            self._at = None
            return
        opening = file.peek(0, len(MAGIC))
        if opening != MAGIC:
            self._damaged("magic", 0, len(MAGIC), 0, f"expected {MAGIC!r} at the start, got {opening!r}")
        while not file.is_live and self._at is not None:
            self.advance()

    def _take_summary_alone(self) -> bool:
        """Whether a whole Summary section says where chunks, attachments and metadata stand."""
        summary = read_summary(self._file)
        if summary is None or not summary.chunks:
            return False
        chunks = []
        for index in sorted(summary.chunks.values(), key=lambda index: index.chunk_start_offset):
            head = RECORD_HEADER_SIZE + CHUNK.size + len(index.compression.encode()) + U64.size
            if head + index.compressed_size != index.chunk_length:
                return False
            chunks.append(
                Chunk(
                    offset=index.chunk_start_offset, data_offset=index.chunk_start_offset + head,
                    data_length=index.compressed_size, size=index.uncompressed_size,
                    start_ns=index.message_start_time, end_ns=index.message_end_time, compression=index.compression,
                )
            )  # fmt: skip
        try:
            records = [parse(self._file, one.offset) for one in summary.metadata]
            self.metadata = [(record.name, record.metadata) for record in records]
        except (MalformedRecordError, IndexError, KeyError, AttributeError, struct.error):  # they stand elsewhere
            return False
        if any(self._file.peek(one.offset, 1) != bytes([Opcode.ATTACHMENT]) for one in summary.attachments):
            return False
        self.attachments = [(one.offset, one.name) for one in summary.attachments]
        self.chunks, self.summary = chunks, summary
        return True

    def advance(self) -> bool:
        """Go on, to the next chunk at least; whether there is one."""
        n = len(self.chunks)
        while self._at is not None and len(self.chunks) == n:
            try:
                after = self._step(self._at)
            except (struct.error, IndexError):
                self._damaged("truncated", self._at, 0, None, "the file was cut short while it was read")
                after = None
            self._previous, self._at = self._at, after
            if after is None:
                self._check_summary()
        return len(self.chunks) > n

    def _step(self, at: int) -> int | None:
        """Take the record at `at`; the byte after it, or None at the end of the file."""
        header = self._file.peek(at, RECORD_HEADER_SIZE)
        if len(header) < RECORD_HEADER_SIZE:
            where = "before the end of the data" if self._data_end is None else "after the data, before the footer"
            n_left, lost = len(self._file) - at, None if self._data_end is None else 0
            self._damaged("truncated", at, n_left, lost, f"the file ends {where}")
            return None
        opcode, after_index, end = header[0], self._after_index, at + record_end(header, 0)
        self._after_index = opcode in BEFORE_INDEX
        if opcode == Opcode.CHUNK:
            return self._take_chunk(at, end)
        after = at
        if opcode == Opcode.MESSAGE:
            # behind a chunk it may be an index whose opcode was hit: its two lengths would agree
            is_index = after_index and self._resync.fields_end(Opcode.MESSAGE_INDEX, at, end) == end
            if self._data_end is None and not is_index:
                if after_index and (found := self._swallowed(at)) is not None:
                    return found  # no bare messages: the rest of a chunk that the one before reaches into
                after = self._take_messages(at, end)
        elif opcode == Opcode.MESSAGE_INDEX and (after := indexes_after(self._file, at)[0]) == at:
            return end if self._resync.is_record(at, end) else self._recover(at, end)  # an index may have bytes more
        elif opcode != Opcode.MESSAGE_INDEX and self._resync.is_record(at, end):
            return self._take_small(opcode, at, end)
        return after if after > at else self._recover(at, end)

    def _take_messages(self, at: int, end: int) -> int:
        """The messages that stand one after the other from `at` on, as one chunk of bounded size; the byte after."""
        if end < at + RECORD_HEADER_SIZE + MIN_MESSAGE or not self._file.has(end):
            return at
        window = self._file.window(at, MESSAGE_HEAD)
        length, first_ns, last_ns = message_run(np.frombuffer(window, np.uint8), 0, RUN_BYTES)
        if not length:  # it is longer than the window
            first_ns = last_ns = MESSAGE_HEADER.unpack_from(window)[4]
        stop = at + int(length) if length else end
        self._has_unchunked = True
        before = self.chunks[-1] if self.chunks and not self._file.is_live else None
        if before and before.data_offset == before.offset and before.end == at and before.size < RUN_BYTES:
            at, first_ns, last_ns = before.offset, min(before.start_ns, first_ns), max(before.end_ns, last_ns)
            self.chunks.pop()
        size = stop - at
        self.chunks.append(
            Chunk(offset=at, data_offset=at, data_length=size, size=size, start_ns=int(first_ns), end_ns=int(last_ns))
        )
        return stop

    def _take_chunk(self, at: int, end: int) -> int | None:
        """A chunk by its record's length; where that and its own fields differ, by what fits in the file."""
        chunk = chunk_at(self._file, at, end)
        if not chunk:
            return self._recover(at, end)
        if chunk.is_cut and self._resync.next_chunk(chunk.data_offset, len(self._file)) is not None:
            return self._recover(at, end)  # the file goes on: not its end, but the chunk's length is wrong
        self.chunks.append(chunk)
        return chunk.end if not chunk.is_cut else None

    def _take_small(self, opcode: int, at: int, end: int) -> int | None:
        """A record that is no message, chunk or message index; the byte after it, None behind the last footer."""
        if opcode == Opcode.FOOTER:
            self._take_footer(at, end)
            return self._resync.next_chunk(end, len(self._file))  # of a log that goes on, this was not the end
        try:
            self._learn(opcode, at, end)
        except MalformedRecordError as error:
            self._damaged("attachment" if opcode == Opcode.ATTACHMENT else "definition", at, end - at, None, str(error))
        return end

    def _learn(self, opcode: int, at: int, end: int) -> None:
        file = self._file
        if opcode == Opcode.HEADER:
            header = parse(file, at)
            self.profile, self.library = header.profile, header.library
        elif opcode in INDEXES or (self._data_end is not None and opcode in DEFINITIONS):
            self.summary.take(opcode, file, at, self.schemas)
        elif opcode in DEFINITIONS:
            define(file, at, self.schemas, self.channels)
        elif opcode == Opcode.METADATA:
            record = parse(file, at)
            self.metadata.append((record.name, record.metadata))
        elif opcode == Opcode.ATTACHMENT:
            self._take_attachment(at, end)
        elif opcode == Opcode.DATA_END:
            self._check_data(at, parse(file, at).data_section_crc)
            self._data_end = end
        elif opcode >= PRIVATE:
            self.private.append((at, end))

    def _take_attachment(self, at: int, end: int) -> None:
        attachment, stop = parse_known(self._file, at)
        crc_at = stop - U32.size
        if U32.unpack(self._file.peek(crc_at, U32.size))[0] in (0, self._file.crc(at + RECORD_HEADER_SIZE, crc_at)):
            self.attachments.append((at, attachment.name))
        else:
            detail = f"attachment {attachment.name!r}: its checksum does not hold"
            self._damaged("attachment", at, end - at, 0, detail)

    def _check_data(self, start: int, expected: int) -> None:
        """Messages in chunks have their own checksums; for those outside only this one vouches."""
        if expected and self._has_unchunked and (found := self._file.crc(0, start)) != expected:
            detail = f"expected CRC {expected:#010x}, got {found:#010x}; bare messages may be wrong"
            self._damaged("data_crc", 0, start, None, detail)

    def _take_footer(self, at: int, end: int) -> None:
        footer = parse(self._file, at)
        start, expected = footer.summary_start, footer.summary_crc
        if self._data_end is None:
            self._damaged("record", at, end - at, None, "expected a DataEnd record before the footer, got none")
        elif start not in (0, self._data_end):
            detail = f"the footer puts the summary at byte {start}, it starts at {self._data_end}"
            self._damaged("summary", at, end - at, 0, detail)
        elif expected and start:
            found = self._file.crc(start, at + RECORD_HEADER_SIZE + 16)
            self._summary_crc_holds = found == expected
            if found != expected:
                detail = f"expected CRC {expected:#010x}, got {found:#010x}"
                self._damaged("summary", start, end - start, 0, detail)
        closing = self._file.peek(end, len(MAGIC))
        n_more = len(self._file) - end - len(MAGIC)
        if closing != MAGIC:
            self._damaged("magic", end, len(closing), 0, f"expected {MAGIC!r} at the end, got {closing!r}")
        elif n_more:
            self._damaged("trailing", end + len(MAGIC), n_more, None, f"{n_more} bytes after the end of the log")

    def _recover(self, at: int, end: int) -> int | None:
        """Go on after a record that makes no sense: with the chunk it may still be, or the next one."""
        if (swallowed := self._swallowed(at)) is not None:
            return swallowed
        size, opcode = len(self._file), self._file.peek(at, 1)[0]
        got = f"opcode {opcode:#04x}, length {end - at - RECORD_HEADER_SIZE}"
        if chunk := self._resync.salvageable(at):
            self._damaged("record", at, RECORD_HEADER_SIZE, 0, f"{got}; by its fields a chunk, and read as one")
            self.chunks.append(chunk)
            return chunk.end
        is_skipped = end > at + RECORD_HEADER_SIZE and self._resync.starts_record(end)
        if is_skipped and self._resync.next_chunk(at + 1, end) is None:
            self._damaged("record", at, end - at, None, f"{got}; skipped")
            return end
        found = self._resync.next_chunk(at + 1, size)
        is_cut = found is None and Opcode.HEADER <= opcode <= Opcode.DATA_END
        until = size if found is None else found
        got += f"; {until - at} bytes from there on cannot be read"
        self._damaged("truncated" if is_cut else "record", at, until - at, None, got)
        return found

    def _swallowed(self, at: int) -> int | None:
        """A chunk within the record before, of which bytes are missing: its length then reaches beyond its end."""
        start = self._previous
        found = self._resync.next_chunk(start + 1, at) if start < at else None
        last = self.chunks[-1] if self.chunks else None
        if found is None or (last and last.offset == start and self._resync.is_sound(last)):
            return None
        self._damaged("record", start, found - start, None, f"a record of {at - start} bytes holds the chunk behind it")
        return found

    def _check_summary(self) -> None:
        """Compare with the data what the summary repeats of them."""
        if self._summary_crc_holds:
            self._check_channels()
        self._check_chunk_indexes()
        if any(damage.kind in ("summary", "truncated", "magic") for damage in self.damage):
            self.summary.chunks.clear()
            self.summary.is_whole = False

    def _check_channels(self) -> None:
        """No checksum protects what stands outside of chunks; what the summary's vouches for goes before."""
        for channel_id, channel in self.summary.channels.items():
            own = self.channels.get(channel_id, channel)
            if own != channel:
                detail = (
                    f"channel {channel_id}: {own.topic!r} in the data, {channel.topic!r} in the summary, which holds"
                )
                self._damaged("definition", 0, 0, 0, detail)
                self.channels[channel_id] = channel

    def _check_chunk_indexes(self) -> None:
        """Take the earlier of two start times; find chunks that only the summary knows."""
        for i, chunk in enumerate(self.chunks):  # no checksum protects a chunk's times; one of the two may be right
            said = self.summary.chunks.get(chunk.offset)
            if said and said.message_start_time < chunk.start_ns:
                self.chunks[i] = replace(chunk, start_ns=said.message_start_time)
        found = {chunk.offset for chunk in self.chunks}
        missing = [offset for offset in self.summary.chunks if offset not in found]
        if missing and not self.damage:
            detail = f"{len(missing)} of {len(self.summary.chunks)} chunk indexes point where no chunk is"
            self._damaged("summary", missing[0], 0, None, detail)

    def _damaged(self, kind: DamageKind, offset: int, length: int, messages: int | None, detail: str) -> None:
        self.damage.append(Damage(kind=kind, offset=offset, length=length, messages=messages, detail=detail))
