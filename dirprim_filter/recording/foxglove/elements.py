"""What scenes are made of: the frame they are drawn in, times, poses, colours, heights, lines and areas.

The frame `scene` is in the middle of what is drawn, without rotation in `map`. The camera of the layout stands on it,
wherever in the map that is. Viewers compute in single precision, which at coordinates of a whole country is half a
metre: from the middle of the scene it is a fraction of a millimetre.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from foxglove import messages as fg

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.drawing import shapes
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording.decoding.field_columns import NANOSECONDS
from dirprim_filter.recording.log_writer import LATEST_NS
from dirprim_filter.recording.schemas.dirprim import MAP_FRAME

SCENE_FRAME = "scene"
ON_THE_GROUND = ("cells", "roses", "region_90", "region_50", "paths", "trails")
ON_THE_ROOF = ("region", "particles", "arrow", "detections", "label")
ROOF = 1.6
"""Metres; most bodies end below."""
HEIGHT: Mapping[str, float] = {
    name: lowest + 0.1 * place
    for lowest, names in ((0.0, ON_THE_GROUND), (ROOF, ON_THE_ROOF))
    for place, name in enumerate(names)
}
"""Metres above the ground. Viewers draw what is seen through from the lowest up, by the height of its pose."""
FINEST_M = 1.0 / 1024.0
"""Of a map's coordinates: a millimetre, a power of two, so that their last bits are zeros and compress."""
LEVEL = fg.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
STRIP, SEGMENTS = fg.LinePrimitiveLineType.LineStrip, fg.LinePrimitiveLineType.LineList


def view_of(primitive_map: PrimitiveMap) -> FloatArray:
    """The part of a map to look at: its south-west and north-east corner, (2, 2) metres."""
    return shapes.map_extent(primitive_map, share=shapes.BUSY_SHARE)


def origin_of(points: FloatArray) -> FloatArray:
    """The middle of the box around points, (n, 2), in whole metres; of no point (0, 0). -> (2,)."""
    if not len(points):
        return np.zeros(2)
    return np.asarray(np.round(0.5 * (points.min(axis=0) + points.max(axis=0))))


def scene_transform(time_ns: int, origin: FloatArray) -> fg.FrameTransform:
    """Where `scene` is in `map`: (2,) metres. Viewers draw no frame that no transform names."""
    x, y = origin.tolist()
    return fg.FrameTransform(
        timestamp=stamp(time_ns), parent_frame_id=MAP_FRAME, child_frame_id=SCENE_FRAME,
        translation=fg.Vector3(x=x, y=y, z=0.0), rotation=LEVEL,
    )  # fmt: skip


@lru_cache(maxsize=1)  # one for all that is drawn of an instant
def stamp(time_ns: int) -> fg.Timestamp:
    """The time of a message; one that such a message cannot hold is refused where it is written."""
    return fg.Timestamp(*divmod(min(max(time_ns, 0), LATEST_NS), NANOSECONDS))


def fresh_update(entities: list[fg.SceneEntity], time_ns: int) -> fg.SceneUpdate:
    """An update that first deletes what earlier ones of its topic drew."""
    everything = fg.SceneEntityDeletion(timestamp=stamp(time_ns), type=fg.SceneEntityDeletionType.All)
    return fg.SceneUpdate(deletions=[everything], entities=entities)


def entity(name: str, time_ns: int, **parts: Any) -> fg.SceneEntity:
    """An entity of primitives, which lasts until it is replaced or deleted."""
    return fg.SceneEntity(
        id=name, timestamp=stamp(time_ns), frame_id=SCENE_FRAME, lifetime=fg.Duration(0, 0), frame_locked=False, **parts
    )


def pose(x: float, y: float, z: float, turn: fg.Quaternion = LEVEL) -> fg.Pose:
    """A pose on level ground."""
    return fg.Pose(position=fg.Vector3(x=x, y=y, z=z), orientation=turn)


def painted(rgb: Sequence[float], opacity: float) -> fg.Color:
    """A colour of red, green and blue, 0 to 1."""
    return fg.Color(r=rgb[0], g=rgb[1], b=rgb[2], a=opacity)


def points(position: FloatArray) -> list[fg.Point3]:
    """(..., 2) metres."""
    return [fg.Point3(x=x, y=y, z=0.0) for x, y in position.reshape(-1, 2).tolist()]


def rounded(position: FloatArray) -> FloatArray:
    """To `FINEST_M`."""
    return np.asarray(np.round(position / FINEST_M) * FINEST_M)


def line(
    kind: fg.LinePrimitiveLineType, along: list[fg.Point3], *, pixels: float, color: fg.Color, height: float,
    indices: Sequence[int] = (),
) -> fg.LinePrimitive:  # fmt: skip
    """A line along points, so wide on the screen at every zoom."""
    return fg.LinePrimitive(
        type=kind, pose=pose(0.0, 0.0, height), thickness=pixels, scale_invariant=True, points=along,
        color=color, indices=list(indices),
    )  # fmt: skip


def area(vertex: FloatArray, triangle: IntArray, *, height: float, **color: Any) -> fg.TriangleListPrimitive:
    """Triangles, (m, 3) numbers of their vertices, (n, 2) metres, of one color or of `colors` at the vertices."""
    return fg.TriangleListPrimitive(
        pose=pose(0.0, 0.0, height), points=points(vertex), indices=triangle.ravel().tolist(), **color
    )


class Template:
    """The bytes of a message in which numbers stand at known places: an object for each takes twice as long.

    Args:
        make: the message of some numbers, each of which may stand in it more than once.
        n: how many.
    """

    def __init__(self, make: Callable[..., Any], n: int) -> None:
        marks = np.pi * np.arange(1.0, n + 1.0)
        data = make(*marks.tolist()).encode()
        self._row = np.frombuffer(data, np.uint8)
        self._at = [[found.start() for found in re.finditer(re.escape(mark.tobytes()), data)] for mark in marks]

    def encoded(self, columns: Sequence[FloatArray]) -> list[bytes]:
        """The message of each row of numbers, (n,) each."""
        numbers, n = np.column_stack(columns).astype("<f8").view(np.uint8), self._row.size
        rows = np.tile(self._row, (len(numbers), 1))
        for i, places in enumerate(self._at):
            for at in places:
                rows[:, at : at + 8] = numbers[:, 8 * i : 8 * i + 8]
        data = rows.tobytes()
        return [data[i : i + n] for i in range(0, len(data), n)]


def nested(number: int, *parts: bytes) -> bytes:
    """A field of protobuf that is a message or a text: its key, how long it is, and its bytes."""
    data = b"".join(parts)
    head, left = bytearray([number << 3 | 2]), len(data)
    while left > 127:
        head.append(left & 127 | 128)
        left >>= 7
    head.append(left)
    return bytes(head) + data
