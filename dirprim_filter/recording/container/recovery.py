"""A whole log out of a damaged one: all that can be read, with its summary and indexes written anew.

Chunks that are intact are taken over byte for byte; of the others, and of messages outside of chunks, new chunks are
made. Attachments whose checksum holds, metadata and private records stay.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from itertools import count
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from mcap.opcode import Opcode

from dirprim_filter.arrays import AnyArray
from dirprim_filter.partial_file import PartialFile
from dirprim_filter.recording.container.chunk import Chunk, chunk_at
from dirprim_filter.recording.container.damage import Damage
from dirprim_filter.recording.container.definitions import definition_records
from dirprim_filter.recording.container.errors import DamagedRecordingError
from dirprim_filter.recording.container.log import FilePass, Log, Scan
from dirprim_filter.recording.container.mcap_writer import McapWriter
from dirprim_filter.recording.container.message_columns import MessageColumns
from dirprim_filter.recording.container.records import (
    MESSAGE_HEADER,
    RECORD_HEADER_SIZE,
    U16,
    Channel,
    Schema,
    parse_channel,
    parse_schema,
    record_end,
)

CHANNEL_ID_BEHIND = MESSAGE_HEADER.size - RECORD_HEADER_SIZE
"""A message's channel id stands so many bytes before its data."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recovery:
    """What became of a log.

    Attributes:
        saved: messages that the new log holds.
        chunks_copied: chunks taken over byte for byte.
        chunks_rewritten: chunks, and runs of messages outside of chunks, that were written anew.
        attachments: that the new log holds.
        metadata: metadata records that the new log holds.
        damage: what is broken in the old one.
    """

    saved: int
    chunks_copied: int
    chunks_rewritten: int
    attachments: int
    metadata: int
    damage: tuple[Damage, ...]

    @property
    def is_lossless(self) -> bool:
        """Nothing but what is written anew was damaged."""
        return all(damage.messages == 0 and damage.kind != "attachment" for damage in self.damage)

    @property
    def lost(self) -> int:
        """Messages known to be lost; there may be more where the damage hides their number."""
        return sum(damage.messages or 0 for damage in self.damage)

    def as_json(self) -> dict[str, Any]:
        """The same in types that json writes."""
        return {
            **asdict(self),
            "damage": [asdict(damage) for damage in self.damage],
            "lost": self.lost,
            "is_lossless": self.is_lossless,
        }


def recover(
    path: str | PathLike[str],
    output: str | Path,
    *,
    strict: bool = False,
    force: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Recovery:
    """Write all that can be read of a log as a whole one.

    Args:
        path: the log; a `.partial` file that a killed process left, for example, or a split recording's folder.
        output: the log to write.
        strict: raise where something is damaged, instead of going on.
        force: overwrite an existing file.
        progress: called with how many of how many chunks are done.

    Raises:
        NotMcapError: the file is no MCAP log.
        DamagedRecordingError: strict, and the log is damaged.
        OutputExistsError: the output exists, and `force` is not set.
        OSError: a file cannot be read or written.
    """
    with Log(path) as opened, PartialFile(output, force=force) as file:
        log, first = Scan(opened), opened.files[0].outline
        writer = McapWriter(file, profile=first.profile, library=first.library)
        for name, entries in log.metadata:
            writer.add_metadata(name, entries)
        copier, done, n_chunks = _Copier(log, writer), count(1), len(opened.chunks)
        for part in log.by_file():
            for chunk, columns in part.parts():
                if strict and log.damage:
                    raise DamagedRecordingError(log.path, log.damage)
                copier.take(part, chunk, columns)
                if progress is not None:
                    progress(next(done), n_chunks)
        if strict and log.damage:
            raise DamagedRecordingError(log.path, log.damage)
        n_attachments = 0
        for one in opened.files:
            for attachment in one.outline.attachments:
                writer.add_attachment(attachment, one.bytes_of[attachment.offset : attachment.end])
                n_attachments += 1
            for start, end in one.outline.private:
                writer.add_private(one.bytes_of[start:end])
        writer.finish()
        return Recovery(
            saved=copier.saved, chunks_copied=copier.copied, chunks_rewritten=copier.rewritten,
            attachments=n_attachments, metadata=len(log.metadata), damage=tuple(log.damage),
        )  # fmt: skip


class _Copier:
    """Takes over chunk after chunk, and counts."""

    def __init__(self, scan: Scan, writer: McapWriter) -> None:
        self.scan = scan
        self.writer = writer
        self.saved = self.copied = self.rewritten = 0
        self._seen_damage = 0

    def take(self, part: FilePass, chunk: Chunk, columns: MessageColumns) -> None:
        self.file, self.definitions = part.bytes_of, part.definitions
        self.saved += len(columns)
        is_clean = len(self.scan.damage) == self._seen_damage or not self._is_hit(chunk)
        self._seen_damage = len(self.scan.damage)
        if is_clean and self._is_whole(chunk) and self._copy(chunk, columns):
            self.copied += 1
        elif len(columns):
            self._rewrite(columns)
            self.rewritten += 1

    def _is_hit(self, chunk: Chunk) -> bool:
        return any(damage.offset == chunk.offset for damage in self.scan.damage[self._seen_damage :])

    def _is_whole(self, chunk: Chunk) -> bool:
        """Whether it stands in the file as one record whose two lengths agree."""
        file = self.file
        is_record = chunk.data_offset > chunk.offset and file[chunk.offset] == Opcode.CHUNK and not chunk.is_cut
        return is_record and chunk.end == chunk.claimed_end == record_end(file, chunk.offset)

    def _copy(self, chunk: Chunk, columns: MessageColumns) -> bool:
        """Take it over as it stands; False where its times, or an id in it, say something else than they should.

        The times of its own header: those of `chunk` are the Summary section's where these begin sooner.
        """
        times, own = columns.log_time_ns, chunk_at(self.file, chunk.offset)
        if own is None or (len(columns) and (int(times[0]), int(times[-1])) != (own.start_ns, own.end_ns)):
            return False
        ids = _channel_ids(columns)
        pairs = np.unique(np.column_stack([ids, columns.channel]), axis=0).tolist()
        used = {channel_id: columns.channels[index] for channel_id, index in pairs}
        schemas, channels = _definitions(bytes(columns.contents), self.definitions.schemas)
        if len(used) < len(pairs) or not self._fits(used, schemas, channels):
            return False
        for schema_id, channel in channels.values():
            is_missing = schema_id and schema_id not in schemas and schema_id not in self.writer.schemas
            if is_missing and self.writer.define_schema(channel.schema, schema_id) != schema_id:
                return False
        for one in used.keys() - channels.keys() - self.writer.channels.keys():
            self.writer.define(used[one], one, _key_of(self.definitions.schemas, used[one].schema))
        self.writer.close_chunk()
        self.writer.schemas.update(schemas)
        for schema_id, channel in channels.values():
            if schema_id:
                self.writer.schemas[schema_id] = channel.schema
        self.writer.channels.update(channels)
        offsets = (columns.start - MESSAGE_HEADER.size).astype(np.uint64)
        self.writer.put_chunk(self.file[chunk.offset : chunk.end], ids, np.column_stack([times, offsets]))
        return True

    def _fits(
        self, used: dict[int, Channel], own_schemas: dict[int, Schema], own_channels: dict[int, tuple[int, Channel]]
    ) -> bool:
        """Whether no id of the chunk means something else in what was written so far, or in the chunk itself."""
        known = self.writer.channels
        schemas = {**own_schemas, **self.writer.schemas}
        defined = {**own_channels, **known}
        return (
            all(schemas[one] == schema for one, schema in own_schemas.items())
            and all(defined[one] == channel for one, channel in own_channels.items())
            and all(defined[one][1] == channel for one, channel in used.items() if one in defined)
        )

    def _rewrite(self, columns: MessageColumns) -> None:
        writer, ids = self.writer, {}
        for index in np.unique(columns.channel).tolist():
            ids[columns.channels[index]] = self._id_of(columns.channels[index])
        for message in columns.messages():
            writer.add(
                ids[message.channel], message.sequence, message.log_time_ns, message.publish_time_ns, message.data
            )
        writer.close_chunk()

    def _id_of(self, channel: Channel) -> int:
        written = {known: known_id for known_id, (_, known) in self.writer.channels.items()}
        if channel in written:
            return written[channel]
        wanted = _key_of(self.definitions.channels, channel)
        return self.writer.define(channel, wanted, _key_of(self.definitions.schemas, channel.schema))


def _key_of(known: Mapping[int, Schema] | Mapping[int, Channel], value: Schema | Channel) -> int | None:
    """An id under which it is defined."""
    return next((number for number, one in known.items() if one == value), None)


def _channel_ids(columns: MessageColumns) -> AnyArray:
    """(n) the ids as they stand in the contents, before each message's data."""
    contents = np.frombuffer(columns.contents, np.uint8)
    low = columns.start - CHANNEL_ID_BEHIND
    ids: AnyArray = contents[low].astype(np.int64) | contents[low + 1].astype(np.int64) << 8
    return ids


def _definitions(contents: bytes, known: dict[int, Schema]) -> tuple[dict[int, Schema], dict[int, tuple[int, Channel]]]:
    """The schemas and channels that a chunk defines itself; its scan has found them sound."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, tuple[int, Channel]] = {}
    for at in definition_records(contents):
        if contents[at] == Opcode.CHANNEL:
            channel_id, channel = parse_channel(contents, at, {**known, **schemas})
            channels[channel_id] = (int(U16.unpack_from(contents, at + RECORD_HEADER_SIZE + 2)[0]), channel)
        else:
            schema_id, schema = parse_schema(contents, at)
            schemas[schema_id] = schema
    return schemas, channels
