"""A map file: an MCAP log with `/dirprim/map`, a message for each tile of cells, and a drawing of them for Foxglove."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TypeVar

from google.protobuf.message import DecodeError

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording import topic_names
from dirprim_filter.recording.container.damage import Damage
from dirprim_filter.recording.container.log import scan
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.foxglove.frames import origin_of, scene_transform, view_of
from dirprim_filter.recording.foxglove.maps import map_scene
from dirprim_filter.recording.log_writer import LogWriter
from dirprim_filter.recording.schemas.map_tiles import encode_tiles
from dirprim_filter.recording.schemas.tiled_map import TiledMap

logger = logging.getLogger(__name__)

MAP_SCHEMA = "dirprim.PrimitiveMap"
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
        for tile in encode_tiles(primitive_map):
            log.write(topic_names.MAP, tile, 0)  # a map holds at no time of its own
            log.end_chunk()  # a tile can be read by itself
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
        RecordingError: the file is no map, or a part of it is missing or broken.
        OSError: the file cannot be read.
    """

    def __init__(self, path: str | Path) -> None:
        self._messages = _Messages(path)
        self._tiles = self._messages.read(lambda: TiledMap(self._messages))

    def __exit__(self, *_: object) -> None:
        self._messages.close()

    @property
    def is_large(self) -> bool:
        """Whether it pays to read some tiles alone."""
        return self._tiles.is_large

    @property
    def box(self) -> FloatArray:
        """(n_tiles, 4) see `TiledMap`."""
        return self._tiles.box

    @property
    def margin_m(self) -> float:
        """What is at a place depends on no cells farther from it than that."""
        return self._tiles.margin_m

    def tiles_with(self, cell: IntArray) -> IntArray:
        """The tiles that have some cells (n,), ascending."""
        return self._tiles.tiles_with(cell)

    def whole(self) -> PrimitiveMap:
        """The map.

        Raises:
            RecordingError: the file is broken.
        """
        primitive_map = self._messages.read(self._tiles.whole)
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
        return self._messages.read(lambda: self._tiles.part(tiles))


class _Messages:
    """The messages of a map file, which can be gone through more than once, one at a time.

    Attributes:
        path: the file.
        damage: what could not be read of it.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = path
        self.damage: list[Damage] = []
        # Of its topic alone: the drawing of a city is many times as large as what it is drawn from.
        self._scan = scan(path, topics=topic_names.MAP.__eq__)
        self._numbers: dict[int, range] = {}  # of the messages of each chunk
        self._any = False

    def close(self) -> None:
        """Let go of the file."""
        self._scan.close()

    def __iter__(self) -> Iterator[bytes]:
        for _, data in self._numbered(None):
            yield data

    def some(self, wanted: IntArray) -> Iterator[bytes]:
        """Those that are wanted, by their numbers; chunks that hold none of them are not opened."""
        numbers = set(wanted.tolist())
        return (data for number, data in self._numbered(numbers) if number in numbers)

    def _numbered(self, wanted: set[int] | None) -> Iterator[tuple[int, bytes]]:
        files, number = self._scan.by_file(), 0
        chunks = [(file, chunk) for file in files for chunk in file.outline.chunks if not file.is_beside(chunk)]
        for i, (file, chunk) in enumerate(chunks):
            if wanted is None or not wanted.isdisjoint(self._numbers[i]):
                first = number
                for message in file.messages(chunk).messages():
                    if message.schema_name == MAP_SCHEMA:
                        self._any = True
                        yield number, message.data
                        number += 1
                self._numbers[i] = range(first, number)
            number = self._numbers[i].stop
        self.damage = self.damage or list(self._scan.damage)

    def read(self, decode: Callable[[], Made]) -> Made:
        """What is made of them.

        Raises:
            RecordingError: they make no such thing.
        """
        try:
            return decode()
        except DecodeError as error:
            damage = self.damage or self._scan.damage
            if not self._any and not damage:
                raise RecordingError(
                    f"{self.path}: expected a map, with messages of {MAP_SCHEMA}, got none; make one with "
                    "`dirprim learn`"
                ) from error
            broken = f" (the file is damaged: {damage[0]})" if damage else ""
            raise RecordingError(
                f"{self.path}: cannot be read as a map: {error}{broken}; learn it again with `dirprim learn`"
            ) from error
