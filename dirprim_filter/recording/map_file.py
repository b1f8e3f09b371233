"""A map file: an MCAP log with `/dirprim/map`, a message for each tile of cells, and a drawing of them for Foxglove."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path

from google.protobuf.message import DecodeError

from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording import topic_names
from dirprim_filter.recording.container.log import scan
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.foxglove.frames import origin_of, scene_transform, view_of
from dirprim_filter.recording.foxglove.maps import map_scene
from dirprim_filter.recording.log_writer import LogWriter
from dirprim_filter.recording.schemas.map_tiles import decode_tiles, encode_tiles

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


def load_map(path: str | Path) -> PrimitiveMap:
    """Read a map that `save_map` wrote.

    A damaged file gives its map if every tile can be read; that is logged.

    Raises:
        RecordingError: the file is no map, or a part of it is missing or broken.
        OSError: the file cannot be read.
    """
    with scan(path) as messages:
        tiles = [message.data for message in messages if message.schema_name == MAP_SCHEMA]
        damage = messages.damage
    if not tiles and not damage:
        raise RecordingError(
            f"{path}: expected a map, with messages of {MAP_SCHEMA}, got none; make one with `dirprim learn`"
        )
    try:
        primitive_map = decode_tiles(tiles)
    except DecodeError as error:
        broken = f" (the file is damaged: {damage[0]})" if damage else ""
        raise RecordingError(
            f"{path}: cannot be read as a map: {error}{broken}; learn it again with `dirprim learn`"
        ) from error
    if damage:
        logger.warning("%s: the map is whole, but the file is damaged: %s", path, damage[0])
    return primitive_map
