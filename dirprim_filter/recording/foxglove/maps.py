"""A map: the outlines of its cells, and its roses in the colours of speed, as rerun and figures draw them."""

from __future__ import annotations

import numpy as np
from foxglove.messages import SceneUpdate

from dirprim_filter.arrays import FloatArray
from dirprim_filter.drawing import shapes
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording.foxglove.scene import (
    HEIGHT,
    SEGMENTS,
    area,
    entity,
    fresh_update,
    line,
    painted,
    rounded,
)

CELL_COLOR = painted((0.45, 0.5, 0.6), 0.45)
ROSE_OPACITY = 0.65
"""What moves must stand out."""


def map_scene(primitive_map: PrimitiveMap, time_ns: int, origin: FloatArray) -> SceneUpdate:
    """The cells' outlines as one entity, and a petal for each mode as another."""
    polygons = [*primitive_map.tessellation.polygons()]
    sides = [np.stack([polygon, np.roll(polygon, -1, axis=0)], axis=1) for polygon in polygons]
    outlines = np.concatenate([np.empty((0, 2)), *(side.reshape(-1, 2) for side in sides)])
    cells = line(SEGMENTS, rounded(outlines - origin), pixels=1.0, color=CELL_COLOR, height=HEIGHT["cells"])
    petals = shapes.rose_petals(primitive_map)
    colors = shapes.petal_colors(petals, fastest=shapes.fastest_speed(petals)).reshape(-1, 4)[:, :3] / 255.0
    roses = area(
        rounded(petals.polygon - origin), shapes.fan_triangles(petals.polygon), height=HEIGHT["roses"],
        colors=[painted(rgb, ROSE_OPACITY) for rgb in colors.tolist()],
    )  # fmt: skip
    return fresh_update([entity("cells", time_ns, lines=[cells]), entity("roses", time_ns, triangles=[roses])], time_ns)
