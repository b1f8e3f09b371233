"""The schemas and channels of a log, defined outside of chunks, within them, or in the summary."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Iterator
from contextlib import suppress

from mcap.opcode import Opcode

from dirprim_filter.recording.container.chunk import read_contents
from dirprim_filter.recording.container.outline import LogFile
from dirprim_filter.recording.container.records import (
    RECORD_HEADER_SIZE,
    Channel,
    MalformedRecordError,
    Schema,
    UndefinedSchemaError,
    parse_channel,
    parse_schema,
    record_end,
)


class Definitions:
    """What is known of schemas and channels; what a chunk says itself goes before what the summary repeats.

    Of a summary that is not whole no checksum says that its names are right: chunks are asked first, all of them.

    Chunks are read in order of time, definitions stand in order of the file: one that is missing is looked
    for in all chunks, once.

    Attributes:
        schemas: those known so far, by id.
        channels: likewise.
    """

    def __init__(self, file: LogFile) -> None:
        self._file = file.bytes_of
        self._outline = outline = file.outline
        self._summary = summary = outline.summary
        is_whole = summary.is_whole
        self.schemas: ChainMap[int, Schema] = ChainMap({}, summary.schemas if is_whole else {}, outline.schemas)
        self.channels: ChainMap[int, Channel] = ChainMap({}, outline.channels, summary.channels if is_whole else {})
        self._has_all = False

    def take(self, contents: bytes, at: int) -> bool:
        """Learn from the record at `at`; whether it changed the channels.

        Raises:
            MalformedRecordError: it is a schema or a channel that cannot be parsed.
        """
        if contents[at] == Opcode.SCHEMA:
            schema_id, self.schemas[schema_id] = parse_schema(contents, at)
        elif contents[at] == Opcode.CHANNEL:
            try:
                channel_id, channel = parse_channel(contents, at, self.schemas)
            except UndefinedSchemaError:
                self._look_everywhere()
                channel_id, channel = parse_channel(contents, at, self.schemas)
            if self.channels.get(channel_id) != channel:
                self.channels[channel_id] = channel
                return True
        return False

    def channel(self, channel_id: int) -> Channel | None:
        """The channel of that id; None where no readable part of the file defines it."""
        if channel_id not in self.channels:
            self._look_everywhere()
        return self.channels.get(channel_id)

    def all_channels(self) -> list[Channel]:
        """Every channel; read from the summary alone where that is whole and repeats them."""
        if not self._summary.channels or not self._summary.is_whole or self._outline.damage:
            self._look_everywhere()
        return list(dict.fromkeys(dict(self.channels).values()))

    def _look_everywhere(self) -> None:
        if self._has_all:
            return
        self._has_all = not self._file.is_live
        for chunk in self._outline.chunks:
            if chunk.data_offset > chunk.offset:  # else a run of bare messages
                contents, _ = read_contents(self._file, chunk)
                for at in definition_records(contents):
                    with suppress(MalformedRecordError):  # reported when its chunk's messages are read
                        self.take(contents, at)
        self.schemas.maps.append(self._summary.schemas)
        self.channels.maps.append(self._summary.channels)


def definition_records(contents: bytes) -> Iterator[int]:
    """First byte of each schema and channel record in a chunk's contents."""
    at = 0
    while at + RECORD_HEADER_SIZE <= len(contents):
        end = record_end(contents, at)
        if contents[at] in (Opcode.SCHEMA, Opcode.CHANNEL) and end <= len(contents):
            yield at
        at = end
