"""Observed motion: a cube for each vehicle, a small sphere for each report; `schemas.scene_update` reads them back."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.KeyValuePair_pb2 import KeyValuePair
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from dirprim_filter.arrays import AnyArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.recording.foxglove.entities import add_entity, paint, place, turn
from dirprim_filter.recording.foxglove.templates import MessageTemplates, delimited, number_of
from dirprim_filter.recording.schemas.dirprim import MAP_FRAME, set_time
from dirprim_filter.recording.schemas.scene_update import HEADING_NOTE, SIZE_NOTES
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks

VEHICLE_SIZE = (4.5, 1.9, 1.5)
"""Length, width and height of the cube that stands for a vehicle of unknown size, metres: a middling car."""
DETECTION_DIAMETER = 0.6
VEHICLE_COLOR = (0.35, 0.6, 0.95, 0.6)
DETECTION_COLOR = (1.0, 0.85, 0.2, 0.9)
_ENTITIES = number_of(SceneUpdate, "entities")
_ID, _METADATA, _CUBES = (number_of(SceneEntity, name) for name in ("id", "metadata", "cubes"))
_KEY, _VALUE = (number_of(KeyValuePair, name) for name in ("key", "value"))


class TracksScene:
    """A cube for each vehicle of one instant after the other, as an encoded `SceneUpdate`.

    Metadata hold direction, speed, group, and where known size and heading, to the last bit. Only numbers and texts
    differ from cube to cube: drawn one by one, they would take nine tenths of the time of writing a log.

    Args:
        lifetime_ns: how long a cube lasts; 0: for ever.
    """

    def __init__(self, lifetime_ns: int) -> None:
        self._lifetime_ns = lifetime_ns
        self._cubes = MessageTemplates(_drawn_cube, 8, field=_CUBES)

    def encode(self, tracks: Tracks, rows: IntArray, time_ns: int) -> bytes:
        """The update of the rows of one instant."""
        n = len(rows)
        direction, size, heading = tracks.direction[rows], tracks.size[rows], tracks.heading[rows]
        drawn = np.where(np.isnan(size), VEHICLE_SIZE, size)
        half = 0.5 * np.where(np.isnan(heading), direction, heading)
        numbers = np.column_stack([tracks.position[rows], 0.5 * drawn[:, 2], np.sin(half), np.cos(half), drawn])
        cubes = self._cubes.encode([""] * n, numbers, shared=b"")
        names = [delimited(_ID, name.encode()) for name in as_texts(tracks.track_id[rows]).tolist()]
        notes = [
            _notes(key, values)
            for key, values in (
                ("direction_rad", direction), ("speed_mps", tracks.speed[rows]), ("group", tracks.group[rows]),
                *zip(SIZE_NOTES, size.T, strict=True), (HEADING_NOTE, heading),
            )
        ]  # fmt: skip
        entity = SceneEntity(frame_id=MAP_FRAME, frame_locked=True)
        set_time(entity.timestamp, time_ns)
        set_time(entity.lifetime, self._lifetime_ns)
        shared = entity.SerializeToString()
        size_of_cube = len(cubes) // max(n, 1)
        return b"".join(
            delimited(_ENTITIES, b"".join((shared, *own, cubes[i * size_of_cube : (i + 1) * size_of_cube])))
            for i, own in enumerate(zip(names, *notes, strict=True))
        )


def _drawn_cube(_: str, numbers: Sequence[float]) -> CubePrimitive:
    """A vehicle's body: x, y, z, sine and cosine of half its yaw, length, width and height."""
    x, y, z, sine, cosine, *size = numbers
    cube = CubePrimitive()
    turn(cube.pose, x, y, sine, cosine, z=z)
    cube.size.x, cube.size.y, cube.size.z = size
    paint(cube.color, VEHICLE_COLOR)
    return cube


def _notes(key: str, values: AnyArray) -> list[bytes]:
    """(n) the values of a column as entries of an entity's metadata; none for a size or a heading that is unknown."""
    may_lack = key in (*SIZE_NOTES, HEADING_NOTE)
    if may_lack and np.isnan(values).all():
        return [b""] * len(values)
    texts = [b"" if may_lack and math.isnan(value) else b"%r" % value for value in values.tolist()]
    return [text and _before_value(key, len(text)) + text for text in texts]


@lru_cache
def _before_value(key: str, n: int) -> bytes:
    """An entry of metadata up to its value, of n bytes."""
    return delimited(_METADATA, delimited(_KEY, key.encode()) + delimited(_VALUE, bytes(n)))[:-n]


def detections_scene(detections: Detections, rows: IntArray, time_ns: int, *, lifetime_ns: int) -> SceneUpdate:
    """A small sphere for each report of one instant."""
    update = SceneUpdate()
    columns = (detections.track_id[rows], detections.position[rows])
    for name, (x, y) in zip(*(c.tolist() for c in columns), strict=True):
        sphere = add_entity(update, name, time_ns, frame=MAP_FRAME, lifetime_ns=lifetime_ns).spheres.add()
        place(sphere.pose, x, y, DETECTION_DIAMETER / 2, 0.0)
        sphere.size.x = sphere.size.y = sphere.size.z = DETECTION_DIAMETER
        paint(sphere.color, DETECTION_COLOR)
    return update
