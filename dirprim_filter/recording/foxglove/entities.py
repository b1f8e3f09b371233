"""Entities of a `SceneUpdate`, and what they are made of: poses, colours, and points by the hundred thousand."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.recording.foxglove.frames import SCENE_FRAME
from dirprim_filter.recording.schemas.dirprim import set_time

Color = tuple[float, ...]
"""Red, green, blue and opacity, 0 to 1."""

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

_ENCODED_POINT = np.dtype(
    [("key", "u1"), ("length", "u1"), ("x_key", "u1"), ("x", "<f8"), ("y_key", "u1"), ("y", "<f8")]
)
_ENCODED_COLOR = np.dtype(
    [("key", "u1"), ("length", "u1")]
    + [(f"{channel}{of}", kind) for channel in "rgba" for of, kind in (("_key", "u1"), ("", "<f8"))]
)
FINEST_M = 1.0 / 1024.0
"""Of coordinates that are only drawn: a millimetre, a power of two, so that their last bits are zeros and compress."""


def fresh_update(time_ns: int) -> SceneUpdate:
    """An update that first deletes what earlier ones of its topic drew."""
    update = SceneUpdate()
    set_time(update.deletions.add(type=SceneEntityDeletion.ALL).timestamp, time_ns)
    return update


def add_entity(
    update: SceneUpdate, name: str, time_ns: int, *, frame: str = SCENE_FRAME, lifetime_ns: int = 0
) -> SceneEntity:
    """A new entity of the update; a lifetime of 0 lasts until it is replaced or deleted."""
    entity = update.entities.add(id=name, frame_id=frame)
    set_time(entity.timestamp, time_ns)
    set_time(entity.lifetime, lifetime_ns)
    return entity


def add_line(
    entity: SceneEntity, kind: LinePrimitive.Type.ValueType, *, pixels: float, color: Color, height: float
) -> LinePrimitive:
    """A line without points, so wide on the screen at every zoom."""
    line = entity.lines.add(type=kind, thickness=pixels, scale_invariant=True)
    place(line.pose, 0.0, 0.0, height, 0.0)
    paint(line.color, color)
    return line


def add_triangles(entity: SceneEntity, vertex: FloatArray, triangle: IntArray, *, height: float) -> Any:
    """Triangles, (m, 3) numbers of their vertices, (n, 2) metres."""
    area = entity.triangles.add()
    place(area.pose, 0.0, 0.0, height, 0.0)
    area.MergeFromString(encoded_points(TriangleListPrimitive, vertex).tobytes())
    area.indices.extend(triangle.ravel().tolist())
    return area


def encoded_points(primitive: type[LinePrimitive] | type[TriangleListPrimitive], points: FloatArray) -> AnyArray:
    """The primitive's field `points` as it stands in a message: bytes to be merged. (..., 2) metres -> (...).

    Each is a `foxglove.Point3` of 18 bytes, in which a double follows the key of its field. Adding points one by
    one costs ten times as much, and forecasts have them by the hundred thousand.
    """
    encoded: AnyArray = np.empty(points.shape[:-1], _ENCODED_POINT)
    encoded["key"] = primitive.DESCRIPTOR.fields_by_name["points"].number << 3 | 2  # a message, its length first
    encoded["length"] = 18
    encoded["x_key"], encoded["y_key"] = 1 << 3 | 1, 2 << 3 | 1  # eight bytes each
    encoded["x"], encoded["y"] = points[..., 0], points[..., 1]
    return encoded


def encoded_colors(rgba: FloatArray) -> AnyArray:
    """The field `colors` of triangles, likewise: a `foxglove.Color` of 36 bytes each. (n, 4) -> (n,)."""
    encoded: AnyArray = np.empty(len(rgba), _ENCODED_COLOR)
    encoded["key"] = TriangleListPrimitive.DESCRIPTOR.fields_by_name["colors"].number << 3 | 2
    encoded["length"] = 36
    for number, name in enumerate("rgba", start=1):
        encoded[f"{name}_key"] = number << 3 | 1
        encoded[name] = rgba[:, number - 1]
    return encoded


def rounded(position: FloatArray) -> FloatArray:
    """To `FINEST_M`."""
    return np.asarray(np.round(position / FINEST_M) * FINEST_M)


def place(pose: Any, x: float, y: float, z: float, yaw: float) -> None:
    """Set a pose on level ground."""
    turn(pose, x, y, math.sin(yaw / 2), math.cos(yaw / 2), z=z)


def turn(pose: Any, x: float, y: float, sine: float, cosine: float, *, z: float) -> None:
    """Set a pose by the sine and cosine of half its yaw."""
    pose.position.SetInParent()
    pose.position.x, pose.position.y, pose.position.z = x, y, z
    pose.orientation.z, pose.orientation.w = sine, cosine


def paint(color: Any, rgba: Color) -> None:
    """Set a colour."""
    color.r, color.g, color.b, color.a = rgba
