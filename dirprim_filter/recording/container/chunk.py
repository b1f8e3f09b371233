"""Chunks of an MCAP file: their contents, checked and bounded, and the next one behind what makes no sense.

A run of messages that stand outside of chunks is treated as a chunk without compression and checksum, so the scan knows
one thing only. A length that is wrong but fits in the file would swallow what follows. So a record's length must agree
with its fields; where it has bytes more, as the specification allows for later versions, no chunk may hide in them.

Source: the MCAP specification, version 0, record 0x06. Opcodes 0x10 to 0x7F are reserved, so a file of this version
holds none; 0x80 and above are private and skipped.
"""

from __future__ import annotations

import re
import zlib
from array import array
from bisect import bisect_left
from dataclasses import dataclass, replace

import lz4.frame
import zstandard
from mcap.opcode import Opcode

from dirprim_filter.recording.container.budget import decompressed, most_bytes
from dirprim_filter.recording.container.errors import Damage, DamageKind
from dirprim_filter.recording.container.file_bytes import BLOCK_BYTES, FileBytes
from dirprim_filter.recording.container.records import (
    CHUNK,
    KINDS,
    MESSAGE_INDEX,
    PRIVATE,
    RECORD_HEADER_SIZE,
    U32,
    U64,
    BadTextError,
    MalformedRecordError,
    parse_known,
    record_end,
)

MAX_CHUNK_BYTES = 1 << 30
"""No chunk is decompressed beyond this, nor beyond the budget of the file up to its end: writers close chunks after
some MiB."""
COMPRESSIONS = {b"": "", b"zstd": "zstd", b"lz4": "lz4"}
FIXED_SIZE = CHUNK.size + U64.size
"""Bytes of a chunk record besides the compression's name and the data."""
NAME_AT = RECORD_HEADER_SIZE + CHUNK.size
ENTRY_SIZE = 16
"""Of a message index: log time and place."""
HEAD_SIZE = NAME_AT + max(map(len, COMPRESSIONS)) + U64.size
"""A chunk's record has at most so many bytes before its data."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Chunk:
    """Where a chunk's data stand in the file, and what its header says about them.

    Attributes:
        offset: byte where its record starts.
        data_offset: byte where its (compressed) data start.
        data_length: bytes of them that the file has.
        start_ns: log time of its first message.
        end_ns: log time of its last message.
        size: bytes of its contents.
        crc: CRC-32 of its contents; 0 where the writer gave none.
        compression: "", "zstd" or "lz4".
        is_cut: the file ends inside of it.
    """

    offset: int
    data_offset: int
    data_length: int
    start_ns: int
    end_ns: int
    size: int
    crc: int = 0
    compression: str = ""
    is_cut: bool = False

    @property
    def end(self) -> int:
        """Byte after its record."""
        return self.data_offset + self.data_length

    def damaged(self, kind: DamageKind, messages: int | None, detail: str) -> Damage:
        """Damage of all of it."""
        return Damage(kind=kind, offset=self.offset, length=self.end - self.offset, messages=messages, detail=detail)


def chunk_at(file: FileBytes, offset: int, end: int | None = None) -> Chunk | None:
    """The chunk record that starts at `offset`, by its own fields alone; None where these make no sense.

    Nor is it one where they do not lead to a given `end`.
    """
    head = file.peek(offset, HEAD_SIZE)
    if len(head) < NAME_AT + U64.size:
        return None
    start_ns, end_ns, size, crc, name_length = CHUNK.unpack_from(head, RECORD_HEADER_SIZE)
    data_at = NAME_AT + name_length + U64.size
    if data_at > len(head) or (compression := COMPRESSIONS.get(head[NAME_AT : NAME_AT + name_length])) is None:
        return None
    data_offset, claimed = offset + data_at, U64.unpack_from(head, data_at - U64.size)[0]
    if end is not None and data_offset + claimed != end:
        return None
    is_cut = not file.has(data_offset + claimed)
    return Chunk(
        offset=offset, data_offset=data_offset, data_length=len(file) - data_offset if is_cut else claimed,
        start_ns=start_ns, end_ns=end_ns, size=size, crc=crc, compression=compression, is_cut=is_cut,
    )  # fmt: skip


def indexes_after(file: FileBytes, at: int) -> tuple[int, int]:
    """The byte after the message indexes that stand one after the other from `at` on, and their entries.

    Only those whose two lengths agree; of others one is wrong.
    """
    n_entries, smallest = 0, RECORD_HEADER_SIZE + MESSAGE_INDEX.size
    while len(head := file.peek(at, smallest)) == smallest and head[0] == Opcode.MESSAGE_INDEX:
        n_bytes = MESSAGE_INDEX.unpack_from(head, RECORD_HEADER_SIZE)[1]
        if record_end(head, 0) != smallest + n_bytes or n_bytes % ENTRY_SIZE or not file.has(at + smallest + n_bytes):
            break
        at, n_entries = at + smallest + n_bytes, n_entries + n_bytes // ENTRY_SIZE
    return at, n_entries


def read_contents(file: FileBytes, chunk: Chunk) -> tuple[bytes, Damage | None]:
    """A chunk's contents, and what is wrong with them; none where they cannot be trusted.

    Contents of a chunk that the end of the file cuts are given as far as they go: they come without a
    checksum, and with damage that says so. A wrong size field is forgiven where the checksum vouches for the
    contents.
    """
    data = file.read(chunk.data_offset, chunk.end)
    if len(data) < chunk.data_length:
        return b"", chunk.damaged("truncated", None, "the file was cut short while it was read")
    try:
        contents = _decompress(data, chunk)
    except (zstandard.ZstdError, RuntimeError, ValueError) as error:  # lz4 raises bare RuntimeErrors
        return b"", _lost(file, chunk, "chunk_data", f"its data cannot be decompressed: {error}")
    if chunk.is_cut:
        detail = f"the file ends inside a chunk; {len(contents)} of {chunk.size} bytes are read unchecked"
        return contents, chunk.damaged("truncated", None, detail)
    found, crc = zlib.crc32(contents), chunk.crc
    if not crc and chunk.data_offset > chunk.offset:  # of one that came only as it was read the outline knows none
        crc = int(CHUNK.unpack(file.peek(chunk.offset + RECORD_HEADER_SIZE, CHUNK.size))[3])
    if crc not in (0, found):
        return b"", _lost(file, chunk, "chunk_crc", f"expected CRC {crc:#010x}, got {found:#010x}")
    if len(contents) == chunk.size:
        return contents, None
    wrong = f"expected {chunk.size} bytes of contents, got {len(contents)}"
    forgiven = chunk.damaged("chunk_header", 0, f"{wrong}; the checksum confirms the contents")
    return (contents, forgiven) if crc else (b"", _lost(file, chunk, "chunk_header", wrong))


def _decompress(data: bytes, chunk: Chunk) -> bytes:
    """A chunk's contents, as far as its data go."""
    if not chunk.compression:
        return data
    limit = min(MAX_CHUNK_BYTES, most_bytes(chunk.end))
    contents: bytes | None
    if chunk.compression == "zstd":
        contents = zstandard.ZstdDecompressor().stream_reader(data).read(limit + 1)
    else:
        contents = decompressed(lz4.frame.LZ4FrameDecompressor(), data, limit)
    if contents is None or len(contents) > limit:
        raise ValueError(f"expected {limit} bytes at most, got more; write the log with smaller chunks")
    return contents


def _lost(file: FileBytes, chunk: Chunk, kind: DamageKind, detail: str) -> Damage:
    """All of a chunk, with as many messages as the indexes behind it count; None where there is no index."""
    end, n_messages = indexes_after(file, chunk.end)
    return chunk.damaged(kind, n_messages if end > chunk.end else None, detail)


MAX_CHECKS = 8
"""At most so many times the bytes of the file are checked to distinguish chunks and records from noise."""
CHUNK_HEADER = re.compile(
    rb"\x06(?=.{6}\0\0.{16}.{6}\0\0.{4}(?:\x04\0\0\0zstd|\x03\0\0\0lz4|\0\0\0\0).{6}\0\0)", re.DOTALL
)
"""The start of what may be a chunk: lengths below 2^48, a known compression. `chunk_at` then checks the lengths."""


class Resync:
    """Checks what may be a record or a chunk of a file, and finds the next chunk, in time that grows as the file does.

    No part is looked through twice, wherever it is asked to begin: a file of headers that all claim to reach beyond
    its end would be looked through once for each. Nor are fields and checksums checked without end: records may claim
    each other's bytes.

    Args:
        file: the log.
    """

    def __init__(self, file: FileBytes) -> None:
        self._file = file
        self._start = self._stop = 0  # what was looked through, and what was found there
        self._whole = array("q")
        self._cut = array("q")
        self._checked = 0

    def next_chunk(self, at: int, until: int) -> int | None:
        """The first chunk between `at` and `until` whose two lengths agree and that is whole; else one that is cut."""
        if at > self._stop:
            self._start = self._stop = at
            del self._whole[:], self._cut[:]
        if at < self._start:
            whole, cut = self._look(at, self._start)
            self._whole, self._cut, self._start = whole + self._whole, cut + self._cut, at
        while (found := _first(self._whole, at, until)) is None and self._stop < until:
            stop = min(self._stop + BLOCK_BYTES, until)
            whole, cut = self._look(self._stop, stop)
            self._whole += whole
            self._cut += cut
            self._stop = stop
        return _first(self._cut, at, until) if found is None else found

    def is_record(self, at: int, end: int) -> bool:
        """Whether a record other than a message or a chunk can be what its header says."""
        file = self._file
        opcode = file.peek(at, 1)[0]
        if not file.has(end):
            return False
        if end - at - RECORD_HEADER_SIZE >= FIXED_SIZE and chunk_at(file, at, end):
            return False
        if opcode >= PRIVATE:
            return self.starts_record(end)
        stop = self.fields_end(opcode, at, end)
        if stop is None or stop == end:
            return stop is not None
        return (opcode == Opcode.FOOTER or self.starts_record(end)) and self.next_chunk(stop, end) is None

    def fields_end(self, opcode: int, at: int, end: int) -> int | None:
        """The byte after the fields of a record that this version knows; None where they end past it."""
        stop = None
        try:
            if opcode == Opcode.MESSAGE_INDEX and end - at >= RECORD_HEADER_SIZE + 6 and self._file.has(end):
                stop = at + RECORD_HEADER_SIZE + 6 + U32.unpack_from(self._file.peek(at, RECORD_HEADER_SIZE + 6), 11)[0]
            elif opcode in KINDS and self._may_check(0):
                stop = parse_known(self._file, at)[1]
                self._may_check(stop - at)
        except BadTextError:
            return end
        except MalformedRecordError:
            self._may_check(end - at)
        return stop if stop is not None and stop <= end else None

    def _may_check(self, n_bytes: int) -> bool:
        self._checked += n_bytes
        return self._checked <= MAX_CHECKS * len(self._file) if not self._file.is_live else True

    def starts_record(self, at: int) -> bool:
        """Whether a known record that fits in the file starts at a place, or the file ends there."""
        head = self._file.peek(at, RECORD_HEADER_SIZE)
        if len(head) < RECORD_HEADER_SIZE:
            return not head and at == len(self._file)
        return (Opcode.HEADER <= head[0] <= Opcode.DATA_END or head[0] >= PRIVATE) and self._file.has(
            at + record_end(head, 0)
        )

    def is_sound(self, chunk: Chunk) -> bool:
        """Whether a checksum vouches for a chunk's contents; of too many that claim the same bytes it is not asked."""
        return bool(chunk.crc) and self._may_check(chunk.data_length) and read_contents(self._file, chunk)[1] is None

    def salvageable(self, at: int) -> Chunk | None:
        """The chunk that a contradictory record may still be; None if it cannot be one."""
        chunk = chunk_at(self._file, at)
        if chunk is None or not chunk.size:
            return None
        if not chunk.is_cut and self.starts_record(chunk.end):
            return chunk if self.is_sound(chunk) or self.next_chunk(at + 1, chunk.end) is None else None
        end = at + record_end(self._file.peek(at, RECORD_HEADER_SIZE), 0)
        if chunk.crc and chunk.data_offset < end and self._file.has(end + 1) and self.starts_record(end):
            by_record = replace(chunk, data_length=end - chunk.data_offset, is_cut=False)
            return by_record if self.is_sound(by_record) else None
        return None

    def _look(self, start: int, stop: int) -> tuple[array[int], array[int]]:
        """What may be chunks between two places: those that are whole, and those that the end of the file cuts."""
        whole, cut = array("q"), array("q")
        for at in range(start, stop, BLOCK_BYTES):
            until = min(at + BLOCK_BYTES, stop)
            for match in CHUNK_HEADER.finditer(self._file.read(at, until + HEAD_SIZE)):
                place = at + match.start()
                if place >= until:
                    break
                end = place + record_end(self._file.peek(place, RECORD_HEADER_SIZE), 0)
                if chunk := chunk_at(self._file, place, end):
                    (cut if chunk.is_cut else whole).append(place)
        return whole, cut


def _first(places: array[int], at: int, until: int) -> int | None:
    """The first of ascending places that lies between two."""
    i = bisect_left(places, at)
    return places[i] if i < len(places) and places[i] < until else None
