"""One file of a log: where its chunks stand, what they hold, and what their schemas and channels are."""

from __future__ import annotations

from collections import ChainMap, Counter
from collections.abc import Iterator, Mapping, MutableMapping
from dataclasses import replace

import numpy as np
from mcap.opcode import Opcode

from dirprim_filter.arrays import AnyArray
from dirprim_filter.recording.container._kernels import read_records
from dirprim_filter.recording.container.chunk import Chunk, read_contents
from dirprim_filter.recording.container.errors import Damage
from dirprim_filter.recording.container.file_bytes import FileBytes
from dirprim_filter.recording.container.message_columns import MessageColumns
from dirprim_filter.recording.container.outline import Outline
from dirprim_filter.recording.container.records import (
    DEFINITIONS,
    Channel,
    MalformedRecordError,
    Schema,
    UndefinedSchemaError,
    define,
)

KEPT_BYTES = 1 << 24
"""Of a file's contents, while it is open: its topics, transforms and objects are passes of their own."""
OUTSIDE = {*Opcode} - {*DEFINITIONS}
"""Records that stand outside of chunks alone, beside messages; those of private opcodes and of later versions may."""
UNKNOWN = -1
"""The number of a channel that is defined nowhere."""


class McapFile:
    """An open file.

    Args:
        name: of the file, where the log has several; else empty.
        bytes_of: what it holds.
        channels: of all the log's files; grows as chunks are read.
        numbers: of each, its place among them.

    Attributes:
        outline: where everything stands in it, and what of that is broken; of a live pipe as far as it has come.
    """

    def __init__(self, name: str, bytes_of: FileBytes, channels: list[Channel], numbers: dict[Channel, int]) -> None:
        self.bytes_of = bytes_of
        self._name, self._all, self._all_numbers = name, channels, numbers
        self.outline = Outline(bytes_of)
        self._kept: dict[int, tuple[bytes, Damage | None]] = {}
        self._kept_bytes = 0
        summary = self.outline.summary
        said = (summary.schemas, summary.channels) if summary.is_whole else ({}, {})
        self._schemas: ChainMap[int, Schema] = ChainMap({}, said[0], self.outline.schemas)
        self._channels: ChainMap[int, Channel] = ChainMap({}, self.outline.channels, said[1])
        self._has_all = False

    def chunks(self) -> Iterator[Chunk]:
        """Those of the outline, and those that come meanwhile."""
        i = 0
        while i < len(self.outline.chunks) or self.outline.advance():
            yield self.outline.chunks[i]
            i += 1

    def channels(self) -> list[Channel]:
        """Every channel; read from the summary alone where that is whole and repeats them."""
        summary = self.outline.summary
        if not summary.channels or not summary.is_whole or self.outline.damage:
            self._look_everywhere()
        return list(self._channels.values())

    def named(self, damage: Damage) -> Damage:
        """The same, said of which file."""
        return replace(damage, detail=f"{self._name}: {damage.detail}") if self._name else damage

    def messages(self, chunk: Chunk, position: int = 0) -> tuple[MessageColumns, list[Damage]]:
        """The messages of the log's `position`-th chunk, sorted by log time, stably, and what is wrong with them."""
        contents, broken = self._contents(chunk)
        damage = [broken] if broken else []
        channel_id, sequence, log_time, publish_time, start, stop, others, end = read_records(
            np.frombuffer(contents, np.uint8)
        )
        if end != len(contents) and not chunk.is_cut:
            detail = f"byte {end} of its contents starts no record that fits; {len(contents) - end} bytes are lost"
            damage.append(chunk.damaged("message", None, detail))
        schemas, channels = self._schemas.new_child(), self._channels.new_child()  # what a chunk says itself goes first
        damage += [chunk.damaged("definition", None, why) for why in self._learn(contents, others, schemas, channels)]
        channel = self._numbers(channel_id, channels)
        self._keep(schemas.maps[0], channels.maps[0])
        unknown = channel_id[channel == UNKNOWN]
        for one, n in Counter(unknown.tolist()).items():
            why = f"{n} messages of channel {one}, which is defined nowhere"
            damage.append(chunk.damaged("unknown_channel", n, why))
        for opcode, n in Counter(map(contents.__getitem__, others.tolist())).items():
            if opcode in OUTSIDE:
                why = f"{n} records of {Opcode(opcode).name} within a chunk, which may hold none, are not read"
                damage.append(chunk.damaged("record", None, why))
        columns = MessageColumns(
            log_time_ns=log_time, publish_time_ns=publish_time, sequence=sequence, channel=channel, start=start,
            stop=stop, position=np.full(len(start), position, np.int32), contents=contents, channels=self._all,
        )  # fmt: skip
        columns = (columns[channel >= 0] if unknown.size else columns).sorted()
        if len(columns) and (first_ns := int(columns.log_time_ns[0])) < chunk.start_ns:
            detail = f"expected no message before {chunk.start_ns} ns, got one at {first_ns} ns; it may come late"
            damage.append(chunk.damaged("chunk_times", 0, detail))
        return columns, damage

    def _contents(self, chunk: Chunk) -> tuple[bytes, Damage | None]:
        """See `read_contents`; the first ones are kept for passes to come."""
        if chunk.offset in self._kept:
            return self._kept[chunk.offset]
        contents, damage = read_contents(self.bytes_of, chunk)
        if self._kept_bytes + len(contents) <= KEPT_BYTES:
            self._kept[chunk.offset] = contents, damage
            self._kept_bytes += len(contents)
        return contents, damage

    def _keep(self, schemas: Mapping[int, Schema], channels: Mapping[int, Channel]) -> None:
        """For what does not say it itself, and is not known otherwise."""
        for schema_id, schema in schemas.items():
            self._schemas.setdefault(schema_id, schema)
        for channel_id, channel in channels.items():
            self._channels.setdefault(channel_id, channel)

    def _numbers(self, channel_id: AnyArray, channels: MutableMapping[int, Channel]) -> AnyArray:
        lookup = np.bincount(channel_id)
        for one in np.flatnonzero(lookup).tolist():
            if one not in channels:
                self._look_everywhere()
            found = channels.get(one)
            if found is not None and found not in self._all_numbers:
                self._all_numbers[found] = len(self._all)
                self._all.append(found)
            lookup[one] = UNKNOWN if found is None else self._all_numbers[found]
        return np.asarray(lookup[channel_id], np.int32)

    def _learn(
        self, contents: bytes, others: AnyArray, schemas: MutableMapping[int, Schema],
        channels: MutableMapping[int, Channel],
    ) -> list[str]:  # fmt: skip
        """Take the definitions among a chunk's records that are no messages; why some cannot be parsed."""
        bad, places = [], others.tolist()
        for i, at in enumerate(places):
            try:
                if contents[at] in DEFINITIONS:
                    define(contents, at, schemas, channels)
            except MalformedRecordError as error:
                if not isinstance(error, UndefinedSchemaError) or i >= others.size:
                    bad.append(str(error))
                    continue
                self._look_everywhere()
                places.append(at)  # its schema may stand behind it
        return bad

    def _look_everywhere(self) -> None:
        """Chunks are read in order of time, definitions stand in order of the file: look for all of them, once.

        What is broken of them is reported when its chunk's messages are read.
        """
        if self._has_all:
            return
        self._has_all = not self.bytes_of.is_live
        for chunk in self.outline.chunks:
            if chunk.data_offset > chunk.offset:  # else a run of bare messages
                contents, _ = self._contents(chunk)
                others = read_records(np.frombuffer(contents, np.uint8))[6]
                self._learn(contents, others, self._schemas, self._channels)
        self._keep(self.outline.summary.schemas, self.outline.summary.channels)
