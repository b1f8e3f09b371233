"""A map: the outlines of its cells, and its roses in the colours of speed, as rerun and figures draw them."""

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from dirprim_filter.arrays import FloatArray
from dirprim_filter.drawing import shapes
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording.foxglove.entities import (
    HEIGHT,
    add_entity,
    add_line,
    add_triangles,
    encoded_colors,
    encoded_points,
    fresh_update,
    rounded,
)

CELL_COLOR = (0.45, 0.5, 0.6, 0.45)
ROSE_OPACITY = 0.65
"""What moves must stand out."""


def map_scene(primitive_map: PrimitiveMap, time_ns: int, origin: FloatArray) -> SceneUpdate:
    """The cells' outlines as one entity, and a petal for each mode as another."""
    update = fresh_update(time_ns)
    cells = add_line(
        add_entity(update, "cells", time_ns), LinePrimitive.LINE_LIST, pixels=1.0, color=CELL_COLOR,
        height=HEIGHT["cells"],
    )  # fmt: skip
    first = 0
    for polygon in primitive_map.tessellation.polygons():
        cells.MergeFromString(encoded_points(LinePrimitive, rounded(polygon - origin)).tobytes())
        corner = first + np.arange(len(polygon))
        cells.indices.extend(np.column_stack([corner, np.roll(corner, -1)]).ravel().tolist())
        first += len(polygon)
    petals = shapes.rose_petals(primitive_map)
    roses = add_triangles(
        add_entity(update, "roses", time_ns), rounded(petals.polygon - origin).reshape(-1, 2),
        shapes.fan_triangles(petals.polygon), height=HEIGHT["roses"],
    )  # fmt: skip
    color = shapes.petal_colors(petals, fastest=shapes.fastest_speed(petals)).reshape(-1, 4) / 255.0
    color[:, 3] = ROSE_OPACITY
    roses.MergeFromString(encoded_colors(color).tobytes())
    return update
