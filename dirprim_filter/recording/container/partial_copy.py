"""A remote log copied in parts: a chunk comes when it is first read.

The Summary section says where chunks stand. What stands between them is fetched at once; of each chunk and its message
indexes the copy holds the headers that the section implies, until the chunk is read and comes with its own. So a log
is read as if it were here, with two differences: damage in chunks that are not read is not seen, and where a chunk is
not what the section says reading ends with `NotInPartsError`, and the log is to be copied whole.

Source: the MCAP specification, version 0, records 0x06 to 0x08.
"""

from __future__ import annotations

import struct
import zlib
from bisect import bisect_right
from io import FileIO
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, Self

from mcap.opcode import Opcode
from mcap.records import ChunkIndex

from dirprim_filter.recording.container.errors import RecordingError
from dirprim_filter.recording.container.records import (
    CHUNK,
    MAGIC,
    MESSAGE_INDEX,
    RECORD_HEADER_SIZE,
    U32,
    U64,
    MalformedRecordError,
    parse,
    record_end,
    record_header,
)
from dirprim_filter.recording.container.summary_section import FOOTER_SIZE, Summary

SHORT_BYTES = 1 << 20
"""Logs of fewer bytes are copied whole: to ask several times takes longer."""
TAIL_BYTES = 1 << 13
"""Of the end of a log, in which the Summary section of a log of few chunks stands."""
AHEAD_BYTES = 1 << 23
"""So much is fetched at a time of chunks that stand together and are wanted alike."""
MOST_SUMMARY_BYTES, MOST_PART_BYTES = 1 << 28, 1 << 30
"""At once in memory: a log that claims more is copied whole, which takes none."""
CRC_AT = slice(RECORD_HEADER_SIZE + 3 * 8, RECORD_HEADER_SIZE + 3 * 8 + 4)
INDEX_HEAD_SIZE = RECORD_HEADER_SIZE + MESSAGE_INDEX.size


class NotInPartsError(RecordingError):
    """A log cannot be copied in parts."""


class Remote(NamedTuple):
    """A remote file."""

    files: Any  # fsspec's file system
    path: str
    size: int

    def between(self, start: int, stop: int) -> bytes:
        """Some of its bytes.

        Raises:
            NotInPartsError: other bytes come than those asked for: some servers send all.
            RecordingError: none come.
        """
        try:
            got = bytes(self.files.cat_file(self.path, start=start, end=stop))
        except Exception as error:  # of the kind of the file system's own package
            why = str(error) or type(error).__name__
            raise RecordingError(f"{self.path}: expected its bytes {start} to {stop}: {why}; try again") from error
        if len(got) != stop - start:
            raise NotInPartsError(f"{self.path}: expected {stop - start} bytes, got {len(got)}")
        return got


class Part(NamedTuple):
    """A chunk and its message indexes.

    Attributes:
        start: byte where the chunk starts.
        data: where its contents do.
        stop: byte after its message indexes.
        channels: that it has messages of.
        heads: bytes that the copy holds of it until it comes, and where in it they stand.
    """

    start: int
    data: int
    stop: int
    channels: frozenset[int]
    heads: tuple[tuple[int, bytes], ...]

    @classmethod
    def of(cls, index: ChunkIndex, size: int) -> Self:
        """By a chunk index of a file of `size` bytes.

        Raises:
            NotInPartsError: its numbers contradict each other.
        """
        start, name = index.chunk_start_offset, index.compression.encode()
        end = start + index.chunk_length
        data, stop = start + RECORD_HEADER_SIZE + CHUNK.size + len(name) + U64.size, end + index.message_index_length
        indexes = sorted((at, channel) for channel, at in index.message_index_offsets.items())
        places = [*(at for at, _ in indexes), stop]
        too_near = any(after - at < INDEX_HEAD_SIZE for at, after in pairwise(places))
        does_not_fit = stop > size or stop - start > MOST_PART_BYTES
        if data + index.compressed_size != end or places[0] != end or does_not_fit or too_near:
            raise NotInPartsError(f"chunk index of byte {start}: its numbers contradict each other")
        times = index.message_start_time, index.message_end_time
        chunk = CHUNK.pack(*times, index.uncompressed_size, 0, len(name)) + name + U64.pack(index.compressed_size)
        heads = [(0, record_header(Opcode.CHUNK, end - start - RECORD_HEADER_SIZE) + chunk)]
        for (at, channel), after in zip(indexes, places[1:], strict=True):
            head = record_header(Opcode.MESSAGE_INDEX, after - at - RECORD_HEADER_SIZE)
            heads.append((at - start, head + MESSAGE_INDEX.pack(channel, after - at - INDEX_HEAD_SIZE)))
        return cls(start, data, stop, frozenset(index.message_index_offsets), tuple(heads))

    def is_as_said(self, own: bytes) -> bool:
        """Whether its bytes are what its heads say, but for the checksum, which they cannot know."""
        return all(_but_crc(at, own[at : at + len(head)]) == _but_crc(at, head) for at, head in self.heads)


class _Tail(NamedTuple):
    """The end of a log, from its Summary section on or before."""

    at: int
    own: bytes
    summary: int  # byte where the section starts
    footer: int

    @classmethod
    def of(cls, remote: Remote) -> Self:
        """Fetched.

        Raises:
            NotInPartsError: it holds no whole Summary section.
        """
        at, footer = max(remote.size - TAIL_BYTES, 0), remote.size - len(MAGIC) - FOOTER_SIZE
        own = remote.between(at, remote.size)
        if footer < at or not own.endswith(MAGIC) or own[footer - at] != Opcode.FOOTER:
            raise NotInPartsError(f"{remote.path}: expected a footer at its end")
        try:
            said = parse(own, footer - at)
        except MalformedRecordError as error:
            raise NotInPartsError(f"{remote.path}: {error}") from error
        start = said.summary_start
        if not max(len(MAGIC), footer - MOST_SUMMARY_BYTES) <= start < footer:
            raise NotInPartsError(f"{remote.path}: expected a Summary section")
        if start < at:
            at, own = start, remote.between(start, at) + own
        if said.summary_crc not in (0, zlib.crc32(own[start - at : footer - at + FOOTER_SIZE - U32.size])):
            raise NotInPartsError(f"{remote.path}: expected a Summary section whose checksum holds")
        return cls(at, own, start, footer)

    def parts(self, size: int) -> list[Part]:
        """The chunks that the section names, in order of the file.

        Raises:
            NotInPartsError: none, or places that cannot be.
        """
        summary, at = Summary(), self.summary - self.at
        try:
            while at < self.footer - self.at:
                summary.take(self.own, at, {})
                at = record_end(self.own, at)
        except (MalformedRecordError, struct.error, IndexError) as error:
            raise NotInPartsError(f"the Summary section cannot be parsed: {error}") from error
        parts = sorted(Part.of(index, size) for index in summary.chunks.values())
        edges = [len(MAGIC), *(at for part in parts for at in (part.start, part.stop)), self.summary]
        if not parts or any(a > b for a, b in pairwise(edges)):
            raise NotInPartsError("expected chunks one after the other")
        return parts


class PartialCopy:
    """The copy of a remote log.

    Args:
        remote: the log.
        file: empty, and filled.

    Raises:
        NotInPartsError: the log has no whole Summary section with the places of its chunks.
    """

    def __init__(self, remote: Remote, file: FileIO) -> None:
        self._remote = remote
        tail = _Tail.of(remote)
        self._parts = parts = tail.parts(remote.size)
        self._starts = [part.start for part in parts]
        self._missing = set(self._starts)
        file.truncate(remote.size)
        _write(file, tail.at, tail.own)
        for start, stop in pairwise([0, *(at for part in parts for at in (part.start, part.stop)), tail.at]):
            for at in range(start, stop, AHEAD_BYTES) if start not in self._missing else ():
                _write(file, at, remote.between(at, min(at + AHEAD_BYTES, stop)))
        for part in parts:
            for at, head in part.heads:
                _write(file, part.start + at, head)

    def fetch(self, path: Path, start: int, stop: int) -> None:
        """Have the chunks whose contents lie between two bytes.

        Those that stand behind them and have messages of all their channels, too, come along: they are wanted alike.

        Raises:
            NotInPartsError: a chunk is not what the Summary section says.
        """
        for i in range(max(bisect_right(self._starts, start) - 1, 0), len(self._parts)):
            part = self._parts[i]
            if part.start >= stop:
                return
            if part.start in self._missing and start < part.stop and stop > part.data:
                self._fetch(path, self._run(i))

    def _run(self, i: int) -> list[Part]:
        run = [self._parts[i]]
        for part in self._parts[i + 1 :]:
            is_alike = part.start in self._missing and part.start == run[-1].stop and part.channels >= run[0].channels
            if not is_alike or part.stop - run[0].start > AHEAD_BYTES:
                break
            run.append(part)
        return run

    def _fetch(self, path: Path, run: list[Part]) -> None:
        first = run[0].start
        own = self._remote.between(first, run[-1].stop)
        for part in run:
            if not part.is_as_said(own[part.start - first : part.stop - first]):
                raise NotInPartsError(f"{self._remote.path}: the chunk at byte {part.start} is not as its index says")
        with path.open("r+b", buffering=0) as file:
            _write(file, first, own)
        self._missing.difference_update(part.start for part in run)


def _but_crc(at: int, head: bytes) -> bytes:
    return head if at else head[: CRC_AT.start] + head[CRC_AT.stop :]


def _write(file: FileIO, at: int, data: bytes) -> None:
    file.seek(at)
    left = memoryview(data)
    while left:
        left = left[file.write(left) :]
