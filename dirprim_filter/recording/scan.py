"""Every readable message of an MCAP file in order of log time, and a list of what could not be read.

The file is mapped into memory and read chunk by chunk, so memory is bounded by the chunks that overlap in
time. Every chunk's checksum is checked and every length bounded; what is damaged is skipped and reported, the
rest delivered.

Source: the MCAP specification, version 0 (https://mcap.dev/spec).
"""

from __future__ import annotations

import mmap
from bisect import bisect_left, insort
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from operator import attrgetter, itemgetter
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Self

from dirprim_filter.recording.chunk import Chunk, read_contents
from dirprim_filter.recording.damage import Damage, DamageKind
from dirprim_filter.recording.definitions import Definitions
from dirprim_filter.recording.errors import NotMcapError
from dirprim_filter.recording.layout import read_layout
from dirprim_filter.recording.records import (
    MAGIC,
    MESSAGE,
    MESSAGE_HEADER,
    RECORD_HEADER_SIZE,
    U64,
    Channel,
    MalformedRecordError,
    Message,
)

VERSION_FREE_MAGIC = MAGIC[:5]
"""A log whose opening magic differs only behind this is read, and reported as damaged."""


def scan(path: str | PathLike[str], *, topics: Callable[[str], bool] | None = None) -> Scan:
    """Open an MCAP log for reading.

    Args:
        path: a file that can be mapped into memory.
        topics: says whether a topic's messages are wanted; left out: all are.

    Raises:
        NotMcapError: the file is empty, or no MCAP log.
        OSError: it cannot be opened.
    """
    return Scan(Path(path), topics)


@dataclass(slots=True)
class _Held:
    """Messages of one opened chunk, sorted by time, that are not yet delivered."""

    position: int  # of the chunk in the file
    messages: list[Message]
    start: int = 0


class Scan:
    """The messages of one log; iterate it, as often as needed, then look at `damage`.

    Messages of one log time come in the order of the file. Beyond the chunks that overlap in time nothing is
    held.

    Attributes:
        path: the file.
        metadata: name and entries of each metadata record.
        damage: what could not be read so far; complete once the iteration has ended; empty when all was read.
    """

    def __init__(self, path: Path, topics: Callable[[str], bool] | None = None) -> None:
        self.path = path
        self._topics = topics
        self._file = _map(path)
        self._layout = read_layout(self._file)
        self.metadata = self._layout.metadata
        self._reset()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the file; no more messages come."""
        self._file.close()

    def channels(self) -> list[Channel]:
        """All channels of the log, from the summary where it repeats them, else from within the chunks."""
        return self._definitions.all_channels()

    def __iter__(self) -> Iterator[Message]:
        self._reset()
        chunks = self._layout.chunks
        held: list[_Held] = []
        for position in sorted(range(len(chunks)), key=lambda i: chunks[i].start_ns):
            chunk = chunks[position]
            yield from _release(held, chunk.start_ns)
            messages = self._messages(chunk)
            if messages:
                insort(held, _Held(position, messages), key=attrgetter("position"))
        yield from _release(held, None)

    def _reset(self) -> None:
        self.damage: list[Damage] = list(self._layout.damage)
        self._definitions = Definitions(self._file, self._layout)
        self._wanted: dict[int, Channel | None] = {}

    def _messages(self, chunk: Chunk) -> list[Message]:
        """The wanted messages of a chunk, sorted by log time, stably."""
        contents, damage = read_contents(self._file, chunk)
        if damage:
            self.damage.append(damage)
        messages: list[Message] = []
        unknown: Counter[int] = Counter()
        wanted, unpack, new = self._wanted, MESSAGE_HEADER.unpack_from, tuple.__new__
        at, size = 0, len(contents)
        while at + RECORD_HEADER_SIZE <= size:
            if contents[at] != MESSAGE:
                end = self._take_definition(chunk, contents, at)
                if end > size:
                    break
                at = end
                continue
            if at + MESSAGE_HEADER.size > size:
                break
            _, length, channel_id, sequence, log_time_ns, publish_time_ns = unpack(contents, at)
            end = at + RECORD_HEADER_SIZE + length
            if end > size or end < at + MESSAGE_HEADER.size:
                break
            try:
                channel = wanted[channel_id]
            except KeyError:
                channel = self._resolve(channel_id)
                unknown[channel_id] += channel_id not in wanted
            if channel is not None:
                data = contents[at + MESSAGE_HEADER.size : end]
                messages.append(new(Message, (log_time_ns, publish_time_ns, sequence, channel, data)))
            at = end
        if at != size and not chunk.is_cut:
            detail = f"byte {at} of its contents starts no record that fits; {size - at} bytes are lost"
            self._damaged("message", chunk, None, detail)
        for channel_id, n in (+unknown).items():
            self._damaged(
                "unknown_channel", chunk, n, f"{n} messages of channel {channel_id}, which is defined nowhere"
            )
        messages.sort(key=itemgetter(0))
        if messages and messages[0].log_time_ns < chunk.start_ns:
            detail = f"expected no message before {chunk.start_ns} ns, got one at {messages[0].log_time_ns} ns"
            self._damaged("chunk_times", chunk, 0, f"{detail}; it may come late")
        return messages

    def _take_definition(self, chunk: Chunk, contents: bytes, at: int) -> int:
        """Learn from a record that is no message; the byte after it."""
        end = at + RECORD_HEADER_SIZE + int(U64.unpack_from(contents, at + 1)[0])
        if end <= len(contents):
            try:
                if self._definitions.take(contents, at, end):
                    self._wanted.clear()
            except MalformedRecordError as error:
                self._damaged("definition", chunk, None, str(error))
        return end

    def _resolve(self, channel_id: int) -> Channel | None:
        """The channel of a message, None where it is not wanted or not known; kept where known."""
        channel = self._definitions.channel(channel_id)
        if channel is None:
            return None
        if self._topics is not None and not self._topics(channel.topic):
            channel = None
        self._wanted[channel_id] = channel
        return channel

    def _damaged(self, kind: DamageKind, chunk: Chunk, messages: int | None, detail: str) -> None:
        self.damage.append(
            Damage(
                kind=kind,
                offset=chunk.offset,
                length=chunk.end - chunk.offset,
                messages=messages,
                detail=detail,
            )
        )


def _release(held: list[_Held], before_ns: int | None) -> Iterator[Message]:
    """The held messages of an earlier log time, all for None; in order of time, then of the file."""
    batch: list[Message] = []
    parts = 0
    for part in held:
        stop = len(part.messages)
        if before_ns is not None:
            stop = bisect_left(part.messages, before_ns, part.start, key=itemgetter(0))
        if stop > part.start:
            batch += part.messages[part.start : stop]
            part.start = stop
            parts += 1
    if parts > 1:
        batch.sort(key=itemgetter(0))  # stable, and linear in time for runs that are sorted already
    held[:] = [part for part in held if part.start < len(part.messages)]
    yield from batch


def _map(path: Path) -> mmap.mmap:
    with path.open("rb") as file:
        size = path.stat().st_size
        if size == 0:
            raise NotMcapError(path, "an empty file")
        mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    opening = mapped[: len(MAGIC)]
    if not opening.startswith(VERSION_FREE_MAGIC) and mapped[-len(MAGIC) :] != MAGIC:
        mapped.close()
        raise NotMcapError(path, f"a file that starts with {opening!r}")
    return mapped
