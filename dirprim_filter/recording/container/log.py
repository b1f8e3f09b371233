"""Every readable message of an MCAP file in order of log time, and a list of what could not be read.

The file is read chunk by chunk, so memory is bounded, whatever the chunks' overlap in time.
Every chunk's checksum is checked and every length bounded; what is damaged is skipped and reported, the rest
delivered.

Source: the MCAP specification, version 0 (https://mcap.dev/spec).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from itertools import chain
from os import PathLike
from pathlib import Path

import numpy as np
from mcap.records import Attachment

from dirprim_filter.recording.container.chunk import Chunk
from dirprim_filter.recording.container.errors import Damage
from dirprim_filter.recording.container.mcap_file import McapFile
from dirprim_filter.recording.container.message_columns import MessageColumns, TimeMerge
from dirprim_filter.recording.container.records import Channel, Message, parse
from dirprim_filter.recording.container.source import Files, log_files

NO_TIMES = (0, 1 << 64)


class Log(AbstractContextManager["Log"]):
    """An MCAP log that is opened once, however often it is then read; a context manager.

    Args:
        path: a file; the folder of a rosbag2 recording, split or not; "-" for standard input, another pipe, or a bag:
            these are copied to a temporary file first; or a URL that fsspec can read.
        live: a pipe is read as it comes, and its chunks in its own order; else all of it is waited for.
        files: what `log_files` has opened of it; left out, it is opened.

    Attributes:
        path: the log, as it was named.
        files: those that it consists of: one, or of a split recording several.
        is_live: it is such a pipe.

    Raises:
        NotMcapError: a file is empty, or no MCAP log.
        RecordingError: a URL or a recording that cannot be read here.
        OSError: it cannot be opened.
    """

    def __init__(self, path: str | PathLike[str], *, live: bool = False, files: Files | None = None) -> None:
        self.path = Path(path)
        channels: list[Channel] = []
        numbers: dict[Channel, int] = {}
        files = files or log_files(path, live=live)
        self.files = [
            McapFile(file.name if len(files) > 1 else "", bytes_of, channels, numbers) for file, bytes_of in files
        ]
        self.is_live = any(file.bytes_of.is_live for file in self.files)
        if self.is_live:
            next(self.files[0].chunks(), None)  # until messages come, nothing is known of channels

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the files; no more messages come."""
        for file in self.files:
            file.bytes_of.close()

    def channels(self) -> list[Channel]:
        """All channels, from the summary where it repeats them, else from within the chunks."""
        return list(dict.fromkeys(channel for file in self.files for channel in file.channels()))

    @property
    def n_bytes(self) -> int:
        """Of all its files."""
        return sum(len(file.bytes_of) for file in self.files)

    @property
    def start_ns(self) -> int | None:
        """The first log time, as the chunks say; None of an empty log."""
        return min((chunk.start_ns for chunk in self.chunks if chunk.end_ns), default=None)

    @property
    def chunks(self) -> list[Chunk]:
        """Of all files, in their order."""
        return [chunk for file in self.files for chunk in file.outline.chunks]


LogSource = str | PathLike[str] | Log
"""A log by its name, or one that is open."""


def opened(source: LogSource) -> AbstractContextManager[Log]:
    """A log that stays open if it was, and else is closed at the end."""
    return nullcontext(source) if isinstance(source, Log) else Log(source)


class Scan(AbstractContextManager["Scan"]):
    """The messages of one log; iterate it, as often as needed, also at once, then look at `damage`.

    Messages of one log time come in the order of the file. Beyond the chunks that overlap in time nothing is
    held, and of these little more than `merge.HELD_BYTES` in memory. As a context manager it closes the log.

    Args:
        source: what is read: a log, or what `Log` opens.
        topics: says whether a topic's messages are wanted; left out: all are. Chunks that hold none of them by the
            log's index are not opened, so damage in them is not seen.
        start_ns: the first log time wanted. Chunks outside of the time are not opened, as above.
        end_ns: the first log time no longer wanted.
        waits: of a live pipe all is read, as it comes; else what came before.

    Attributes:
        log: what is read.
        damage: what the iteration that was begun last could not read so far; empty when all was read.

    Raises:
        NotMcapError: as `Log`, and the others.
    """

    def __init__(
        self, source: LogSource, topics: Callable[[str], bool] | None = None, *, start_ns: int | None = None,
        end_ns: int | None = None, waits: bool = True,
    ) -> None:  # fmt: skip
        self.log = source if isinstance(source, Log) else Log(source)
        self._topics = topics
        self._waits = waits and self.log.is_live
        self._times = (start_ns or NO_TIMES[0], NO_TIMES[1] if end_ns is None else end_ns)
        self._is_wanted = np.empty(0, np.bool_)  # by number of the channel
        self._begin()

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the log; no more messages come."""
        self.log.close()

    @property
    def end_ns(self) -> int | None:
        """The last log time to come, as the chunks say; None of an empty log, and of a live pipe."""
        if self._waits:
            return None
        last = max((chunk.end_ns for chunk in self.log.chunks), default=None)
        return last if last is None else min(last, self._times[1])

    @property
    def metadata(self) -> list[tuple[str, dict[str, str]]]:
        """Name and entries of each metadata record."""
        return [record for file in self.log.files for record in file.outline.metadata]

    def attachments(self) -> Iterator[Attachment]:
        """The files attached to the log whose checksum holds."""
        return (parse(file.bytes_of, at) for file in self.log.files for at, _ in file.outline.attachments)

    def is_wanted(self, topic: str) -> bool:
        """Whether messages of a topic are delivered."""
        return self._topics is None or self._topics(topic)

    def channels(self) -> list[Channel]:
        """All channels of the log, wanted or not."""
        return self.log.channels()

    def __iter__(self) -> Iterator[Message]:
        return chain.from_iterable(map(MessageColumns.messages, self.columns()))

    def columns(self) -> Iterator[MessageColumns]:
        """The messages in order of log time, some at a time, as columns; of a live pipe chunk by chunk."""
        if self._waits:
            return self.parts()
        return self._merged(self._begin())

    def parts(self) -> Iterator[MessageColumns]:
        """The messages of each chunk, in the order of the files; `damage` grows as they come."""
        return self._in_file_order(self._begin())

    def _begin(self) -> list[Damage]:
        self.damage = [file.named(damage) for file in self.log.files for damage in file.outline.damage]
        return self.damage

    def _in_file_order(self, damage: list[Damage]) -> Iterator[MessageColumns]:
        for file in self.log.files:
            n_known = len(file.outline.damage)
            for chunk in file.chunks():
                yield self._messages(file, chunk, damage)
            damage += map(file.named, file.outline.damage[n_known:])  # of a live pipe

    def _merged(self, damage: list[Damage]) -> Iterator[MessageColumns]:
        """The messages of all chunks in order of log time, some at a time."""
        chunks = [(file, chunk) for file in self.log.files for chunk in file.outline.chunks]
        merge = TimeMerge()
        for position in sorted(range(len(chunks)), key=lambda i: chunks[i][1].start_ns):
            file, chunk = chunks[position]
            if not self._is_beside(file, chunk):
                yield from merge.release((chunk.start_ns, position))
                merge.hold(self._messages(file, chunk, damage, position))
        yield from merge.release(None)

    def _messages(self, file: McapFile, chunk: Chunk, damage: list[Damage], position: int = 0) -> MessageColumns:
        """Those of wanted topics and times."""
        columns, broken = file.messages(chunk, position)
        damage += map(file.named, broken)
        if more := columns.channels[self._is_wanted.size :]:
            self._is_wanted = np.append(self._is_wanted, [self.is_wanted(channel.topic) for channel in more])
        wanted = self._is_wanted[columns.channel]
        if self._times != NO_TIMES:
            wanted &= (columns.log_time_ns >= self._times[0]) & (columns.log_time_ns < self._times[1])
        return columns if wanted.all() else columns[wanted]

    def _is_beside(self, file: McapFile, chunk: Chunk) -> bool:
        """Whether nothing in a chunk is wanted, by what both it and the log's index say of it."""
        summary = file.outline.summary
        said = summary.chunks.get(chunk.offset)
        if said is None or (said.message_start_time, said.message_end_time) != (chunk.start_ns, chunk.end_ns):
            return False
        if not said.message_index_offsets:
            return False  # a chunk without messages may state any times, and define channels
        if chunk.end_ns < self._times[0] or chunk.start_ns >= self._times[1]:
            return True
        channels = map(summary.channels.get, said.message_index_offsets)
        return all(channel is not None and not self.is_wanted(channel.topic) for channel in channels)
