"""A map file: an MCAP log with `/dirprim/map`, a message for each tile of cells, and a drawing of them for Foxglove."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path

from google.protobuf.message import DecodeError

from dirprim_filter.primitives.part import Ground
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording import topic_names
from dirprim_filter.recording.container.damage import Damage
from dirprim_filter.recording.container.log import scan
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.foxglove.frames import origin_of, scene_transform, view_of
from dirprim_filter.recording.foxglove.maps import map_scene
from dirprim_filter.recording.log_writer import LogWriter
from dirprim_filter.recording.schemas.map_tiles import encode_tiles
from dirprim_filter.recording.schemas.tiled_map import decode_tiles

logger = logging.getLogger(__name__)

MAP_SCHEMA = "dirprim.PrimitiveMap"


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
        origin = origin_of(view_of(primitive_map))
        log.write(topic_names.TRANSFORM, scene_transform(0, origin), 0)
        log.write(topic_names.MAP_SCENE, map_scene(primitive_map, 0, origin), 0)


def load_map(path: str | Path, *, near: Callable[[], Ground] | None = None) -> PrimitiveMap:
    """Read a map that `save_map` wrote.

    A damaged file gives its map if every tile can be read; that is logged.

    Args:
        path: the MCAP file.
        near: of a map of more than 20,000 cells only those with their centres on this ground are loaded; what is of no
            place, and how many vehicles are expected where, stays that of the whole. Not asked for a smaller map. What
            was loaded so cannot be saved or updated.

    Raises:
        RecordingError: the file is no map, or a part of it is missing or broken.
        OSError: the file cannot be read.
    """
    return _Tiles(path).read(partial(decode_tiles, near=near))


class _Tiles:
    """The messages of a map file, which can be gone through more than once, one at a time."""

    def __init__(self, path: str | Path) -> None:
        self._path = path
        self._n = 0
        self._damage: list[Damage] = []

    def __iter__(self) -> Iterator[bytes]:
        # Of its topic alone: the drawing of a city is many times as large as what it is drawn from.
        with scan(self._path, topics=topic_names.MAP.__eq__) as messages:
            try:
                for message in messages:
                    if message.schema_name == MAP_SCHEMA:
                        self._n += 1
                        yield message.data
            finally:
                self._damage = messages.damage

    def read(self, decode: Callable[[Iterable[bytes]], PrimitiveMap]) -> PrimitiveMap:
        """What is made of them; damage that does no harm is logged."""
        broken = ""
        try:
            primitive_map = decode(self)
        except DecodeError as error:
            if not self._n and not self._damage:
                raise RecordingError(
                    f"{self._path}: expected a map, with messages of {MAP_SCHEMA}, got none; make one with "
                    "`dirprim learn`"
                ) from error
            if self._damage:
                broken = f" (the file is damaged: {self._damage[0]})"
            raise RecordingError(
                f"{self._path}: cannot be read as a map: {error}{broken}; learn it again with `dirprim learn`"
            ) from error
        if self._damage:
            logger.warning("%s: the map is whole, but the file is damaged: %s", self._path, self._damage[0])
        return primitive_map
