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
from collections.abc import Iterator
from dataclasses import replace

from mcap.opcode import Opcode

from dirprim_filter.recording.container.chunk import FIXED_SIZE, Chunk, chunk_at, chunk_end, read_contents
from dirprim_filter.recording.container.file_bytes import FileBytes
from dirprim_filter.recording.container.records import PRIVATE, RECORD_HEADER_SIZE, RECORDS, fields_end, record_end

MAX_CHECKS = 8
"""At most so many times the bytes of the file are checked to distinguish chunks from noise."""
CHUNK_HEADER = re.compile(
    rb"\x06(?=.{6}\0\0.{16}.{6}\0\0.{4}(?:\x04\0\0\0zstd|\x03\0\0\0lz4|\0\0\0\0).{6}\0\0)", re.DOTALL
)
"""The start of what may be a chunk: lengths below 2^48, a known compression. `chunk_at` then checks the lengths."""


def is_record(chunks: ChunkFinder, at: int, end: int) -> bool:
    """Whether a record other than a message or a chunk can be what its header says."""
    file = chunks.file
    opcode, body = file[at], at + RECORD_HEADER_SIZE
    if end > len(file) or (opcode not in RECORDS and opcode < PRIVATE):
        return False
    if end - body >= FIXED_SIZE and chunk_end(file, at) == end:
        return False
    if opcode >= PRIVATE:
        return starts_record(file, end)
    stop = fields_end(file, at, end)
    if stop is None or stop == end:
        return stop is not None
    return (opcode == Opcode.FOOTER or starts_record(file, end)) and chunks.next_chunk(stop, end) is None


def starts_record(file: FileBytes, at: int) -> bool:
    """Whether a known record that fits in the file starts at `at`, or the file ends there."""
    if at + RECORD_HEADER_SIZE > len(file):
        return at == len(file)
    return (Opcode.HEADER <= file[at] <= Opcode.DATA_END or file[at] >= PRIVATE) and record_end(file, at) <= len(file)


class ChunkFinder:
    """Finds the next chunk in a file, and checks what may be one, in time that grows as the file does.

    No part is looked through twice, wherever it is asked to begin: a file of headers that all claim to reach beyond
    its end would be looked through once for each. Nor are checksums tried without end: chunks may claim each other's
    bytes.

    Args:
        file: the log.
    """

    def __init__(self, file: FileBytes) -> None:
        self.file = file
        self._start = self._stop = 0  # what was looked through, and what was found there
        self._whole = array("q")
        self._cut = array("q")
        self._checkable = MAX_CHECKS * len(file)

    def next_chunk(self, at: int, until: int) -> int | None:
        """The first chunk between `at` and `until` whose two lengths agree and that is whole; else one that is cut."""
        cut = None
        if at < self._start:  # a short way back: into the record before
            for place, is_cut in self._chunks(at, min(until, self._start)):
                if not is_cut:
                    return place
                cut = place if cut is None else cut
            at = self._start
        elif at > self._stop:
            self._start = self._stop = at
            del self._whole[:], self._cut[:]
        found = _first(self._whole, at, until)
        if found is None and until > self._stop:
            found = self._look_on(until)
        if found is not None:
            return found
        return _first(self._cut, at, until) if cut is None else cut

    def is_sound(self, chunk: Chunk) -> bool:
        """Whether a checksum vouches for a chunk's contents; of too many that claim the same bytes it is not asked."""
        if not chunk.crc or chunk.data_length > self._checkable:
            return False
        self._checkable -= chunk.data_length
        return read_contents(self.file, chunk)[1] is None

    def _look_on(self, until: int) -> int | None:
        """The first whole chunk between what was looked through and `until`."""
        for place, is_cut in self._chunks(self._stop, until):
            (self._cut if is_cut else self._whole).append(place)
            if not is_cut:
                self._stop = place + 1
                return place
        self._stop = until
        return None

    def _chunks(self, at: int, until: int) -> Iterator[tuple[int, bool]]:
        """What may be a chunk between two places, and whether the end of the file cuts it."""
        file = self.file
        while match := CHUNK_HEADER.search(file, at, min(until + 64, len(file))):
            at = match.start()
            if at >= until:
                return
            chunk = chunk_at(file, at)
            if chunk and record_end(file, at) == chunk.claimed_end:
                yield at, chunk.is_cut
            at += 1


def _first(places: array[int], at: int, until: int) -> int | None:
    """The first of ascending places that lies between two."""
    i = bisect_left(places, at)
    return places[i] if i < len(places) and places[i] < until else None


def salvageable(chunks: ChunkFinder, at: int) -> Chunk | None:
    """The chunk that a contradictory record may still be; None if it cannot be one."""
    file = chunks.file
    chunk = chunk_at(file, at)
    if chunk is None or not chunk.size:
        return None
    if not chunk.is_cut and starts_record(file, chunk.end):
        return chunk if chunks.is_sound(chunk) or chunks.next_chunk(at + 1, chunk.end) is None else None
    end = record_end(file, at)
    if chunk.crc and chunk.data_offset < end < len(file) and starts_record(file, end):
        by_record = replace(chunk, data_length=end - chunk.data_offset, is_cut=False)
        return by_record if chunks.is_sound(by_record) else None
    return None
