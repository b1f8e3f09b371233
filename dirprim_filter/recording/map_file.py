"""A map file: an MCAP log with `/dirprim/map`, a message for each tile of cells, a summary and a drawing of them."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording import topic_names
from dirprim_filter.recording.container.chunk import Chunk
from dirprim_filter.recording.container.damage import Damage
from dirprim_filter.recording.container.log import FilePass, Log, Scan
from dirprim_filter.recording.container.records import Message, Schema
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.foxglove.maps import map_scene
from dirprim_filter.recording.foxglove.scene import origin_of, scene_transform, view_of
from dirprim_filter.recording.log_writer import LogWriter
from dirprim_filter.recording.schemas.arrow_message import ENCODING
from dirprim_filter.recording.schemas.map_summary import MapSummary, encode_summary
from dirprim_filter.recording.schemas.map_tiles import encoded_tiles, tiles_in
from dirprim_filter.recording.schemas.tiled_map import TiledMap, places_in, whole_map

logger = logging.getLogger(__name__)

MAP_SCHEMA = "dirprim.PrimitiveMap"
MAP = Schema(name=MAP_SCHEMA, encoding=ENCODING, data=b"an Arrow IPC stream of one row")
SUMMARY = Schema(name="dirprim.MapSummary", encoding=ENCODING, data=MAP.data)
Made = TypeVar("Made")


def save_map(
    primitive_map: PrimitiveMap,
    path: str | Path,
    *,
    metadata: Mapping[str, str] | None = None,
    force: bool = False,
) -> None:
    """Write a map; `load_map` gives it back bit for bit. The same map gives the same bytes.

    Args:
        primitive_map: what to write.
        path: the MCAP file.
        metadata: goes into the `dirprim` metadata record: configuration, seed, the inputs' checksums.
        force: overwrite an existing file.

    Raises:
        OutputExistsError: the file exists, and `force` is not set.
        OSError: the file cannot be written.
    """
    with LogWriter(path, metadata=metadata or {}, force=force) as log:
        tiles = tiles_in(primitive_map)
        for tile in encoded_tiles(primitive_map, tiles):
            log.write_encoded(topic_names.MAP, MAP, tile, 0)  # a map holds at no time of its own
            log.end_chunk()  # a tile can be read by itself
        log.write_encoded(topic_names.MAP_SUMMARY, SUMMARY, encode_summary(primitive_map, tiles), 0)
        log.end_chunk()
        origin = origin_of(view_of(primitive_map))
        log.write(topic_names.TRANSFORM, scene_transform(0, origin), 0)
        log.write(topic_names.MAP_SCENE, map_scene(primitive_map, 0, origin), 0)


def load_map(path: str | Path) -> PrimitiveMap:
    """Read a map that `save_map` wrote.

    A damaged file gives its map if every tile can be read; that is logged.

    Args:
        path: the MCAP file.

    Raises:
        RecordingError: the file is no map, or a part of it is missing or broken.
        OSError: the file cannot be read.
    """
    with MapFile(path) as opened:
        return opened.whole()


def open_map(path: str | Path) -> PrimitiveMap | MapFile:
    """The map that `save_map` wrote; of one of more than 20,000 cells its file, whose tiles can be read by themselves.

    Raises:
        RecordingError: the file is no map, or a part of it is missing or broken.
        OSError: the file cannot be read.
    """
    opened = MapFile(path)
    if opened.is_large:
        return opened
    with opened:
        return opened.whole()


class MapFile(AbstractContextManager["MapFile"]):
    """A map file of which tiles can be read by themselves; a context manager.

    Args:
        path: the MCAP file.

    Raises:
        RecordingError: the file is no MCAP log.
        OSError: it cannot be read.
    """

    def __init__(self, path: str | Path) -> None:
        self._messages = _Messages(path)

    def __exit__(self, *_: object) -> None:
        self._messages.close()

    @property
    def is_large(self) -> bool:
        """Whether it pays to read some tiles alone."""
        return self._tiles is not None and self._tiles.is_large

    @property
    def box(self) -> FloatArray:
        """(n_tiles, 4) see `MapSummary`."""
        return self._in_tiles.summary.box

    @property
    def margin_m(self) -> float:
        """What is at a place depends on no cells farther from it than that."""
        return self._in_tiles.margin_m

    def tiles_with(self, cell: IntArray) -> IntArray:
        """The tiles of the last part that have some cells (n,), ascending."""
        return self._in_tiles.tiles_with(cell)

    def whole(self) -> PrimitiveMap:
        """The map.

        Raises:
            RecordingError: the file is broken.
        """
        primitive_map = self._messages.read(lambda: whole_map(self._messages))
        if self._messages.damage:
            logger.warning(
                "%s: the map is whole, but the file is damaged: %s", self._messages.path, self._messages.damage[0]
            )
        return primitive_map

    def part(self, tiles: IntArray) -> PrimitiveMap:
        """The map of some tiles (n,) alone, which cannot be saved or updated; see `TiledMap`.

        Raises:
            RecordingError: the file is broken.
        """
        return self._messages.read(lambda: self._in_tiles.part(tiles))

    @cached_property
    def _tiles(self) -> TiledMap | None:
        """By the map's summary; None without one, as in a file that is damaged there."""
        return self._messages.read(self._by_summary)

    def _by_summary(self) -> TiledMap | None:
        messages = self._messages
        if (data := messages.summary()) is None:
            return None
        summary = MapSummary.decoded(data)
        n = len(summary.box)
        return TiledMap(messages, summary, np.arange(n) if messages.are_one_each(n) else places_in(messages, n))

    @property
    def _in_tiles(self) -> TiledMap:
        if self._tiles is None:
            raise RecordingError(f"{self._messages.path}: has no summary of its tiles: it can only be read whole")
        return self._tiles


class _Messages:
    """The messages of a map file, which can be gone through more than once, one at a time.

    Attributes:
        path: the file.
        damage: what could not be read of it.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = path
        self.damage: list[Damage] = []
        # Of its topics alone: the drawing of a city is many times as large as what it is drawn from.
        log = Log(path)
        self._scan, self._summaries = (Scan(log, of.__eq__) for of in (topic_names.MAP, topic_names.MAP_SUMMARY))
        self._numbers: dict[int, range] = {}  # of the messages of each chunk
        self._any = False

    def close(self) -> None:
        """Let go of the file."""
        self._scan.close()

    def summary(self) -> bytes | None:
        """The message that says what is in the others, if there is one that is whole."""
        found = [_data(message) for message in self._summaries if message.schema_name == SUMMARY.name]
        self._any = self._any or bool(found)
        return found[0] if found and not self._summaries.damage else None

    def are_one_each(self, n: int) -> bool:
        """Whether there are as many chunks, as `save_map` writes them; each is then taken for one message."""
        if len(self._chunks()) != n:
            return False
        self._numbers = {i: range(i, i + 1) for i in range(n)}
        return True

    def __iter__(self) -> Iterator[bytes]:
        for _, data in self._numbered(None):
            yield data

    def some(self, wanted: IntArray) -> Iterator[bytes]:
        """Those that are wanted, by their numbers; chunks that hold none of them are not opened."""
        numbers = set(wanted.tolist())
        return (data for number, data in self._numbered(numbers) if number in numbers)

    def _numbered(self, wanted: set[int] | None) -> Iterator[tuple[int, bytes]]:
        number = 0
        for i, (file, chunk) in enumerate(self._chunks()):
            if wanted is None or not wanted.isdisjoint(self._numbers[i]):
                first = number
                for message in file.messages(chunk).messages():
                    if message.schema_name == MAP.name:
                        self._any = True
                        yield number, _data(message)
                        number += 1
                self._numbers[i] = range(first, number)
            number = self._numbers[i].stop
        self.damage = self.damage or list(self._scan.damage)

    def _chunks(self) -> list[tuple[FilePass, Chunk]]:
        files = self._scan.by_file()
        return [(file, chunk) for file in files for chunk in file.outline.chunks if not file.is_beside(chunk)]

    def read(self, decode: Callable[[], Made]) -> Made:
        """What is made of them.

        Raises:
            RecordingError: they make no such thing.
        """
        try:
            return decode()
        except ValueError as error:
            damage = self.damage or self._scan.damage
            if not self._any and not damage:
                raise RecordingError(
                    f"{self.path}: expected a map, with messages of {MAP.name}, got none; make one with `dirprim learn`"
                ) from error
            broken = f" (the file is damaged: {damage[0]})" if damage else ""
            raise RecordingError(
                f"{self.path}: cannot be read as a map: {error}{broken}; learn it again with `dirprim learn`"
            ) from error


def _data(message: Message) -> bytes:
    """The bytes of a message of this form.

    Raises:
        ValueError: it is of another, as maps were before version 5.
    """
    if message.message_encoding != ENCODING:
        raise ValueError(f"it is of an older version, in {message.message_encoding}, not {ENCODING}")
    return message.data
