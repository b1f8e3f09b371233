"""Chunks of an MCAP file: where they stand, and their contents, checked and bounded.

Source: the MCAP specification, version 0, record 0x06. A run of messages that stand outside of chunks is
treated as a chunk without compression and checksum, so the scan knows one thing only.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import lz4.frame
import zstandard
from mcap.opcode import Opcode

from dirprim_filter.recording.container.damage import Damage, DamageKind
from dirprim_filter.recording.container.file_bytes import FileBytes
from dirprim_filter.recording.container.records import (
    CHUNK,
    MESSAGE_INDEX,
    RECORD_HEADER_SIZE,
    U64,
    record_end,
)

MAX_CHUNK_BYTES, SMALL_BYTES, MOST_TIMES = 1 << 30, 1 << 26, 1000
"""No chunk is decompressed beyond the first, nor beyond the second and so many times its data: writers close chunks
after some MiB; a larger claim is damage, or an attack."""
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
    crc: int
    compression: str
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
    except (zstandard.ZstdError, RuntimeError, _TooLargeError) as error:  # lz4 raises bare RuntimeErrors
        return b"", _lost(file, chunk, "chunk_data", f"its data cannot be decompressed: {error}")
    if chunk.is_cut:
        detail = f"the file ends inside a chunk; {len(contents)} of {chunk.size} bytes are read unchecked"
        return contents, chunk.damaged("truncated", None, detail)
    found, crc = zlib.crc32(contents), chunk.crc or _crc_of(file, chunk)
    if crc not in (0, found):
        return b"", _lost(file, chunk, "chunk_crc", f"expected CRC {crc:#010x}, got {found:#010x}")
    if len(contents) == chunk.size:
        return contents, None
    wrong = f"expected {chunk.size} bytes of contents, got {len(contents)}"
    forgiven = chunk.damaged("chunk_header", 0, f"{wrong}; the checksum confirms the contents")
    return (contents, forgiven) if crc else (b"", _lost(file, chunk, "chunk_header", wrong))


def _crc_of(file: FileBytes, chunk: Chunk) -> int:
    """Its checksum by what the file says now: of a chunk that came only as it was read, the outline knows none."""
    at = chunk.offset + RECORD_HEADER_SIZE
    return int(CHUNK.unpack(file.peek(at, CHUNK.size))[3]) if chunk.data_offset > chunk.offset else 0


class _TooLargeError(ValueError):
    pass


def _decompress(data: bytes, chunk: Chunk) -> bytes:
    """A chunk's contents, as far as its data go."""
    if not chunk.compression:
        return data
    limit = min(chunk.size, MAX_CHUNK_BYTES, max(SMALL_BYTES, MOST_TIMES * len(data)))
    if chunk.compression == "zstd":
        contents = zstandard.ZstdDecompressor().stream_reader(data).read(limit + 1)
    else:
        contents = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=limit + 1)
    if len(contents) > limit:
        raise _TooLargeError(f"expected {limit} bytes at most, got more")
    return bytes(contents)


def _lost(file: FileBytes, chunk: Chunk, kind: DamageKind, detail: str) -> Damage:
    """All of a chunk, with as many messages as the indexes behind it count; None where there is no index."""
    end, n_messages = indexes_after(file, chunk.end)
    return chunk.damaged(kind, n_messages if end > chunk.end else None, detail)
