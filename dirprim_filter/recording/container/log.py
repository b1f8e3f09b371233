"""Every readable message of an MCAP file in order of log time, and a list of what could not be read.

The file is read chunk by chunk, so memory is bounded, whatever the chunks' overlap in time.
Every chunk's checksum is checked and every length bounded; what is damaged is skipped and reported, the rest
delivered.

Source: the MCAP specification, version 0 (https://mcap.dev/spec).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from itertools import chain
from os import PathLike
from pathlib import Path

import numpy as np

from dirprim_filter.arrays import AnyArray
from dirprim_filter.recording.container._kernels import count_records, read_records
from dirprim_filter.recording.container.chunk import Chunk, read_contents
from dirprim_filter.recording.container.damage import Damage, DamageKind
from dirprim_filter.recording.container.definitions import Definitions
from dirprim_filter.recording.container.merge import TimeMerge
from dirprim_filter.recording.container.message_columns import MessageColumns
from dirprim_filter.recording.container.outline import LogFile
from dirprim_filter.recording.container.records import Attachment, Channel, MalformedRecordError, Message
from dirprim_filter.recording.container.source import log_files

UNSEEN, UNKNOWN, UNWANTED = -3, -2, -1
"""What stands for a channel id in place of an index into the list of channels."""
N_CHANNEL_IDS = 1 << 16
NO_TIMES = (0, 1 << 64)
KEPT_BYTES = 1 << 24
"""Of a log's contents, while it is open: its topics, transforms and objects are passes of their own."""


def scan(
    path: str | PathLike[str],
    *,
    topics: Callable[[str], bool] | None = None,
    start_ns: int | None = None,
    end_ns: int | None = None,
) -> Scan:
    """Open an MCAP log for reading.

    Args:
        path: a file; the folder of a rosbag2 recording, split or not; "-" for standard input, another pipe, or a bag:
            these are copied to a temporary file first; or a URL that fsspec can read.
        topics: says whether a topic's messages are wanted; left out: all are. Chunks that hold none of them by the
            log's index are not opened, so damage in them is not seen.
        start_ns: the first log time wanted. Chunks outside of the time are not opened, as above.
        end_ns: the first log time no longer wanted.

    Raises:
        NotMcapError: the file is empty, or no MCAP log.
        RecordingError: a URL that cannot be read here.
        OSError: it cannot be opened.
    """
    return Scan(Log(path), topics, start_ns=start_ns, end_ns=end_ns)


class Log(AbstractContextManager["Log"]):
    """An MCAP log that is opened once, however often it is then read; a context manager.

    Args:
        path: see `scan`.
        live: a pipe is read as it comes, and its chunks in its own order; else all of it is waited for.

    Attributes:
        path: the log, as it was named.
        files: those that it consists of: one, or of a split recording several.
        is_live: it is such a pipe.

    Raises:
        NotMcapError: a file is empty, or no MCAP log.
        RecordingError: a URL or a recording that cannot be read here.
        OSError: it cannot be opened.
    """

    def __init__(self, path: str | PathLike[str], *, live: bool = False) -> None:
        self.path = Path(path)
        files = log_files(path, live=live)
        self.files = [LogFile(file.name if len(files) > 1 else "", bytes_of) for file, bytes_of in files]
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
        return list(dict.fromkeys(channel for file in self.files for channel in Definitions(file).all_channels()))

    def message_counts(self) -> Counter[str] | None:
        """Messages by topic, as the Summary sections of all files say; None where one is missing or damaged.

        Of a live pipe none are known.
        """
        counts: Counter[str] = Counter()
        if self.is_live:
            return counts
        for file in self.files:
            summary, damage = file.outline.summary, file.outline.damage
            if damage or not summary.is_whole or summary.statistics is None:
                return None
            for channel_id, n in summary.statistics.channel_message_counts.items():
                if channel_id in summary.channels:
                    counts[summary.channels[channel_id].topic] += n
        return counts

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
        log: what is read.
        topics: see `scan`, as the times.
        waits: of a live pipe all is read, as it comes; else what came before.

    Attributes:
        log: what is read.
    """

    def __init__(
        self,
        log: Log,
        topics: Callable[[str], bool] | None = None,
        *,
        start_ns: int | None = None,
        end_ns: int | None = None,
        waits: bool = True,
    ) -> None:
        self.log = log
        self._topics = topics
        self._waits = waits and log.is_live
        self._times = (
            NO_TIMES[0] if start_ns is None else max(start_ns, NO_TIMES[0]),
            NO_TIMES[1] if end_ns is None else max(min(end_ns, NO_TIMES[1]), NO_TIMES[0]),
        )
        self.by_file()

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the log; no more messages come."""
        self.log.close()

    @property
    def path(self) -> Path:
        """The log, as it was named."""
        return self.log.path

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

    def attachments(self) -> list[tuple[Attachment, bytes]]:
        """The files attached to the log whose checksum holds, and their contents."""
        return [
            (attachment, file.bytes_of.read(attachment.data_offset, attachment.data_offset + attachment.size))
            for file in self.log.files
            for attachment in file.outline.attachments
        ]

    def is_wanted(self, topic: str) -> bool:
        """Whether messages of a topic are delivered."""
        return self._topics is None or self._topics(topic)

    def channels(self) -> list[Channel]:
        """All channels of the log, wanted or not."""
        return self.log.channels()

    @property
    def damage(self) -> list[Damage]:
        """What the iteration that was begun last could not read so far; empty when all was read."""
        return self._seen.damage

    def __iter__(self) -> Iterator[Message]:
        return chain.from_iterable(map(MessageColumns.messages, self.columns()))

    def columns(self) -> Iterator[MessageColumns]:
        """The messages in order of log time, some at a time, as columns; of a live pipe chunk by chunk."""
        if self._waits:
            return (columns for _, columns in self.parts())
        return _merged([(file, chunk) for file in self.by_file() for chunk in file.outline.chunks])

    def parts(self) -> Iterator[tuple[Chunk, MessageColumns]]:
        """Each chunk and its messages, in the order of the files; `damage` grows as they come."""
        return chain.from_iterable(map(FilePass.parts, self.by_file()))

    def by_file(self) -> list[FilePass]:
        """An iteration that gives each file's chunks apart."""
        self._seen = _Seen()
        return [FilePass(self, self._seen, file) for file in self.log.files]

    def is_outside(self, chunk: Chunk) -> bool:
        """Whether no time of a chunk is wanted."""
        return chunk.end_ns < self._times[0] or chunk.start_ns >= self._times[1]

    def wanted(self, columns: MessageColumns) -> MessageColumns:
        """Those of wanted topics and times."""
        wanted = columns.channel >= 0
        if self._times != NO_TIMES:
            times = columns.log_time_ns
            wanted &= times >= self._times[0]
            if self._times[1] < NO_TIMES[1]:
                wanted &= times < self._times[1]
        return columns if wanted.all() else columns[wanted]


def _merged(chunks: list[tuple[FilePass, Chunk]]) -> Iterator[MessageColumns]:
    """The messages of all chunks in order of log time, some at a time."""
    merge = TimeMerge()
    for position in sorted(range(len(chunks)), key=lambda i: chunks[i][1].start_ns):
        file, chunk = chunks[position]
        if not file.is_beside(chunk):
            yield from merge.release((chunk.start_ns, position))
            merge.hold(file.messages(chunk, position))
    yield from merge.release(None)


class _Seen:
    """What an iteration could not read so far, and the channels that it has met."""

    def __init__(self) -> None:
        self.damage: list[Damage] = []
        self.channels: list[Channel] = []
        self._index_of: dict[Channel, int] = {}

    def index_of(self, channel: Channel) -> int:
        """Where a channel stands in the list."""
        if channel not in self._index_of:
            self._index_of[channel] = len(self.channels)
            self.channels.append(channel)
        return self._index_of[channel]


class FilePass:
    """One iteration through one file.

    Attributes:
        outline: where everything stands in it.
        definitions: schemas and channels by their ids, as far as the iteration knows them.
    """

    def __init__(self, scan: Scan, seen: _Seen, file: LogFile) -> None:
        self.outline, self._file = file.outline, file
        self.definitions = Definitions(file)
        self._scan = scan
        self._seen = seen
        self._lookup = np.full(N_CHANNEL_IDS, UNSEEN, np.int32)
        self._n_reported = 0
        self._report_outline()

    def parts(self) -> Iterator[tuple[Chunk, MessageColumns]]:
        """Each chunk and its messages, in the order of the file."""
        for chunk in self._file.chunks():
            self._report_outline()
            yield chunk, self.messages(chunk)
        self._report_outline()

    def _report_outline(self) -> None:
        """What the pass over the file has found broken since."""
        for damage in self.outline.damage[self._n_reported :]:
            self._report(damage)
        self._n_reported = len(self.outline.damage)

    def is_beside(self, chunk: Chunk) -> bool:
        """Whether nothing in a chunk is wanted, by what both it and the log's index say of it."""
        said = self.outline.summary.chunks.get(chunk.offset)
        if said is None or (said.message_start_time, said.message_end_time) != (chunk.start_ns, chunk.end_ns):
            return False
        if not said.message_index_offsets:
            return False  # a chunk without messages may state any times, and define channels
        if self._scan.is_outside(chunk):
            return True
        channels = map(self.outline.summary.channels.get, said.message_index_offsets)
        return all(channel is not None and not self._scan.is_wanted(channel.topic) for channel in channels)

    def messages(self, chunk: Chunk, position: int = 0) -> MessageColumns:
        """The wanted messages of a chunk, the `position`-th of the log, sorted by log time, stably."""
        contents, damage = self._contents(chunk)
        if damage:
            self._report(damage)
        buffer = np.frombuffer(contents, np.uint8)
        n_messages, n_others, end = count_records(buffer)
        channel_id, sequence, log_time, publish_time, start, stop, others = read_records(buffer, n_messages, n_others)
        if end != len(contents) and not chunk.is_cut:
            detail = f"byte {end} of its contents starts no record that fits; {len(contents) - end} bytes are lost"
            self._damaged("message", chunk, None, detail)
        columns = MessageColumns(
            log_time_ns=log_time, publish_time_ns=publish_time, sequence=sequence,
            channel=self._resolved(chunk, contents, channel_id, start, others),
            start=start, stop=stop, position=np.full(n_messages, position, np.int32),
            contents=contents, channels=self._seen.channels,
        )  # fmt: skip
        columns = self._scan.wanted(columns).sorted()
        if len(columns) and columns.log_time_ns[0] < chunk.start_ns:
            first_ns = int(columns.log_time_ns[0])
            detail = f"expected no message before {chunk.start_ns} ns, got one at {first_ns} ns; it may come late"
            self._damaged("chunk_times", chunk, 0, detail)
        return columns

    def _contents(self, chunk: Chunk) -> tuple[bytes, Damage | None]:
        """See `read_contents`; the first ones are kept for passes to come."""
        kept = self._file.kept
        if chunk.offset in kept:
            return kept[chunk.offset]
        contents, damage = read_contents(self._file.bytes_of, chunk)
        if len(contents) + sum(len(other) for other, _ in kept.values()) <= KEPT_BYTES:
            kept[chunk.offset] = contents, damage
        return contents, damage

    def _resolved(
        self, chunk: Chunk, contents: bytes, channel_id: AnyArray, start: AnyArray, others: AnyArray
    ) -> AnyArray:
        """(n) int32, the index of each message's channel, by the definitions that stand before it."""
        index = np.empty(len(channel_id), np.int32)
        done = 0
        for at in others.tolist():
            upto = int(np.searchsorted(start, at))  # the messages before it are of the channel as it was
            index[done:upto] = self._indices(channel_id[done:upto])
            done = upto
            try:
                if self.definitions.take(contents, at):
                    self._lookup[:] = UNSEEN
            except MalformedRecordError as error:
                self._damaged("definition", chunk, None, str(error))
        index[done:] = self._indices(channel_id[done:])
        unknown = channel_id[index == UNKNOWN]
        for one, n in zip(*(part.tolist() for part in np.unique(unknown, return_counts=True)), strict=True):
            detail = f"{n} messages of channel {one}, which is defined nowhere"
            self._damaged("unknown_channel", chunk, n, detail)
        return index

    def _indices(self, channel_id: AnyArray) -> AnyArray:
        for one in np.unique(channel_id[self._lookup[channel_id] == UNSEEN]).tolist():
            self._lookup[one] = self._index(one)
        return np.asarray(self._lookup[channel_id])

    def _index(self, channel_id: int) -> int:
        channel = self.definitions.channel(channel_id)
        if channel is None:
            return UNKNOWN
        return self._seen.index_of(channel) if self._scan.is_wanted(channel.topic) else UNWANTED

    def _damaged(self, kind: DamageKind, chunk: Chunk, messages: int | None, detail: str) -> None:
        self._report(chunk.damaged(kind, messages, detail))

    def _report(self, damage: Damage) -> None:
        name = self._file.name
        detail = f"{name}: {damage.detail}" if name else damage.detail
        self._seen.damage.append(replace(damage, detail=detail))
