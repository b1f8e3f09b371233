"""The schemas and channels of a log, defined outside of chunks, within them, or in the summary."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from mmap import mmap

from mcap.opcode import Opcode

from dirprim_filter.recording.container.chunk import read_contents
from dirprim_filter.recording.container.outline import Layout
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

    Chunks are read in order of time, definitions stand in order of the file: one that is missing is looked
    for in all chunks, once.
    """

    def __init__(self, file: mmap, layout: Layout) -> None:
        self._file = file
        self._layout = layout
        self._schemas: dict[int, Schema] = dict(layout.schemas)
        self._channels: dict[int, Channel] = {**layout.summary_channels, **layout.channels}
        self._has_all = False

    def take(self, contents: bytes, at: int) -> bool:
        """Learn from the record at `at`; whether it changed the channels.

        Raises:
            MalformedRecordError: it is a schema or a channel that cannot be parsed.
        """
        if contents[at] == Opcode.SCHEMA:
            schema_id, schema = parse_schema(contents, at)
            if self._schemas.get(schema_id) != schema:
                self._schemas[schema_id] = schema
        elif contents[at] == Opcode.CHANNEL:
            try:
                channel_id, channel = parse_channel(contents, at, self._schemas)
            except UndefinedSchemaError:
                self._look_everywhere()
                channel_id, channel = parse_channel(contents, at, self._schemas)
            if self._channels.get(channel_id) != channel:
                self._channels[channel_id] = channel
                return True
        return False

    def channel(self, channel_id: int) -> Channel | None:
        """The channel of that id; None where no readable part of the file defines it."""
        if channel_id not in self._channels:
            self._look_everywhere()
        return self._channels.get(channel_id)

    @property
    def schemas(self) -> dict[int, Schema]:
        """Those known so far, by id."""
        return self._schemas

    def channel_id(self, channel: Channel) -> int | None:
        """An id under which that channel is defined."""
        return next((channel_id for channel_id, known in self._channels.items() if known == channel), None)

    def schema_id(self, schema: Schema) -> int:
        """An id under which that schema is defined; 0 for none."""
        return next((schema_id for schema_id, known in self._schemas.items() if known == schema), 0)

    def all_channels(self) -> list[Channel]:
        """Every channel; read from the summary alone where that is whole and repeats them."""
        layout = self._layout
        if not layout.summary_channels or not layout.is_summarised or layout.damage:
            self._look_everywhere()
        return list(dict.fromkeys(self._channels.values()))

    def _look_everywhere(self) -> None:
        if self._has_all:
            return
        self._has_all = True
        for chunk in self._layout.chunks:
            if chunk.data_offset > chunk.offset:  # else a run of bare messages
                contents, _ = read_contents(self._file, chunk)
                for at in definition_records(contents):
                    with suppress(MalformedRecordError):  # reported when its chunk's messages are read
                        self.take(contents, at)


def definition_records(contents: bytes) -> Iterator[int]:
    """First byte of each schema and channel record in a chunk's contents."""
    at = 0
    while at + RECORD_HEADER_SIZE <= len(contents):
        end = record_end(contents, at)
        if contents[at] in (Opcode.SCHEMA, Opcode.CHANNEL) and end <= len(contents):
            yield at
        at = end
