"""A map file: an MCAP log with `/dirprim/map`, a message of its cells, and a drawing of them."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path

from dirprim_filter.arrays import require
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording import topic_names
from dirprim_filter.recording.container.log import Log, Scan
from dirprim_filter.recording.container.records import Message, Schema
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.foxglove.elements import origin_of, scene_transform, view_of
from dirprim_filter.recording.foxglove.scenes import map_scene
from dirprim_filter.recording.log_writer import LogWriter
from dirprim_filter.recording.schemas.map_message import ENCODING, encoded, map_of

logger = logging.getLogger(__name__)

MAP = Schema(name="dirprim.PrimitiveMap", encoding=ENCODING, data=b"an Arrow IPC stream of one row")


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
        TypeError: it is no map.
    """
    require("primitive_map", primitive_map, PrimitiveMap)
    with LogWriter(path, metadata=metadata or {}, force=force) as log:
        log.write_encoded(topic_names.MAP, MAP, encoded(primitive_map), 0)  # a map holds at no time of its own
        log.end_chunk()  # damage to the drawing costs no cell
        origin = origin_of(view_of(primitive_map))
        log.write(topic_names.TRANSFORM, scene_transform(0, origin), 0)
        log.write(topic_names.MAP_SCENE, map_scene(primitive_map, 0, origin), 0)


def load_map(path: str | Path) -> PrimitiveMap:
    """Read a map that `save_map` wrote.

    A damaged file gives its map if its message can be read; that is logged.

    Args:
        path: the MCAP file.

    Raises:
        RecordingError: the file is no map, or a part of it is missing or broken.
        OSError: the file cannot be read.
    """
    # Of its topic alone: the drawing of a city is many times as large as what it is drawn from.
    found, scan = [], Scan(Log(path), topic_names.MAP.__eq__)
    try:
        found = [message for message in scan if message.schema_name == MAP.name]
        primitive_map = map_of(_data(found))
    except ValueError as error:
        if not found and not scan.damage:
            raise RecordingError(
                f"{path}: expected a map, with messages of {MAP.name}, got none; make one with `dirprim learn`"
            ) from error
        broken = f" (the file is damaged: {scan.damage[0]})" if scan.damage else ""
        raise RecordingError(
            f"{path}: cannot be read as a map: {error}{broken}; learn it again with `dirprim learn`"
        ) from error
    finally:
        scan.close()
    if scan.damage:
        logger.warning("%s: the map is whole, but the file is damaged: %s", path, scan.damage[0])
    return primitive_map


def _data(found: list[Message]) -> bytes:
    """The bytes of the only message.

    Raises:
        ValueError: there is none, or it is of another form, as maps were before version 5, or before 7 in several.
    """
    if len(found) != 1:
        raise ValueError(f"expected one message, got {len(found)}{', as of an older version' * bool(found)}")
    if found[0].message_encoding != ENCODING:
        raise ValueError(f"it is of an older version, in {found[0].message_encoding}, not {ENCODING}")
    return found[0].data
