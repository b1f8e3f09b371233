"""Telling a record from noise, and finding the next one that can be trusted after one that cannot.

A length that is wrong but fits in the file would swallow what follows. So a record's length must agree with its
fields; where it has bytes more, as the specification allows for later versions, no chunk may hide in them.

Source: the MCAP specification, version 0. Opcodes 0x10 to 0x7F are reserved, so a file of this version holds none;
0x80 and above are private and skipped.
"""

from __future__ import annotations

import re
from array import array
from bisect import bisect_left
from dataclasses import replace

from mcap.opcode import Opcode

from dirprim_filter.recording.container.chunk import FIXED_SIZE, HEAD_SIZE, Chunk, chunk_at, read_contents
from dirprim_filter.recording.container.file_bytes import BLOCK_BYTES, FileBytes
from dirprim_filter.recording.container.records import (
    KINDS,
    PRIVATE,
    RECORD_HEADER_SIZE,
    U32,
    BadTextError,
    MalformedRecordError,
    parse_attachment,
    parse_known,
    record_end,
)

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
        stop = self._fields_end(opcode, at, end)
        if stop is None or stop == end:
            return stop is not None
        return (opcode == Opcode.FOOTER or self.starts_record(end)) and self.next_chunk(stop, end) is None

    def _fields_end(self, opcode: int, at: int, end: int) -> int | None:
        """The byte after the fields of a record that this version knows; None where they end past it."""
        stop = None
        try:
            if opcode == Opcode.MESSAGE_INDEX and end - at >= RECORD_HEADER_SIZE + 6:
                stop = at + RECORD_HEADER_SIZE + 6 + U32.unpack_from(self._file.peek(at, RECORD_HEADER_SIZE + 6), 11)[0]
            elif opcode == Opcode.ATTACHMENT:
                attachment = parse_attachment(self._file, at)
                stop = attachment.data_offset + attachment.size + U32.size
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
