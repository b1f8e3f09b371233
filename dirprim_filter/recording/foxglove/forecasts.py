"""Forecasts: rollouts as thin lines, and the regions that hold them as areas, in the vehicle's colour."""

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from dirprim_filter.arrays import FloatArray
from dirprim_filter.drawing.colors import fan_opacity, track_color
from dirprim_filter.forecasting import REGION_SHARES, Forecasts
from dirprim_filter.recording.foxglove.entities import (
    HEIGHT,
    add_entity,
    add_line,
    add_triangles,
    encoded_points,
    fresh_update,
    paint,
)

PATHS_OPACITY = 3.0
"""Of all the paths of a vehicle together, where they lie over each other; the more there are, the fainter is each."""
LEAST_OPACITY, MOST_OPACITY = 0.03, 0.4


def forecast_scene(forecasts: Forecasts, origin: FloatArray, *, hidden: frozenset[str] = frozenset()) -> SceneUpdate:
    """The paths of each vehicle as one list of lines, and its regions. Earlier forecasts are deleted.

    Args:
        forecasts: of one time.
        origin: (2,) of the scene's frame, metres.
        hidden: vehicles whose forecast says nothing.
    """
    update = fresh_update(forecasts.time_ns)
    n_paths, n_steps = forecasts.paths.shape[1:3]
    step = (n_steps * np.arange(n_paths)[:, None] + np.arange(n_steps - 1)).ravel()
    segments = np.column_stack([step, step + 1]).ravel().tolist()
    opacity = float(np.clip(PATHS_OPACITY / max(n_paths, 1), LEAST_OPACITY, MOST_OPACITY))
    fan = fan_opacity(len(forecasts.track_id) - len(hidden.intersection(forecasts.track_id)))
    encoded = encoded_points(LinePrimitive, forecasts.paths - origin)
    colors = track_color(forecasts.track_id)[:, :3] / 255.0
    for name, rgb, points, regions in zip(forecasts.track_id, colors.tolist(), encoded, forecasts.regions, strict=True):
        if name in hidden:
            continue
        entity = add_entity(update, name, forecasts.time_ns)
        line = add_line(entity, LinePrimitive.LINE_LIST, pixels=1.0, color=(*rgb, opacity), height=HEIGHT["paths"])
        line.MergeFromString(points.tobytes())
        line.indices.extend(segments)
        for k, (share, region) in enumerate(zip(REGION_SHARES, regions, strict=True)):
            height = HEIGHT[f"region_{round(100 * share)}"]
            area = add_triangles(entity, region.vertex - origin, region.triangle, height=height)
            paint(area.color, (*rgb, fan))
            entity.metadata.add(key=f"triangles_{k}_share", value=repr(share))
    return update
