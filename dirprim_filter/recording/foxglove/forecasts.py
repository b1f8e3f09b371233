"""Forecasts: rollouts as thin lines, and the regions that hold them as areas, in the vehicle's colour."""

from __future__ import annotations

import numpy as np
from foxglove.messages import KeyValuePair, SceneUpdate

from dirprim_filter.arrays import FloatArray
from dirprim_filter.drawing.colors import fan_opacity, track_color
from dirprim_filter.forecasting import REGION_SHARES, Forecasts
from dirprim_filter.recording.foxglove.scene import HEIGHT, SEGMENTS, area, entity, fresh_update, line, painted

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
    n_paths, n_steps = forecasts.paths.shape[1:3]
    step = (n_steps * np.arange(n_paths)[:, None] + np.arange(n_steps - 1)).ravel()
    segments = np.column_stack([step, step + 1]).ravel().tolist()
    opacity = float(np.clip(PATHS_OPACITY / max(n_paths, 1), LEAST_OPACITY, MOST_OPACITY))
    fan = fan_opacity(len(forecasts.track_id) - len(hidden.intersection(forecasts.track_id)))
    colors = track_color(forecasts.track_id)[:, :3] / 255.0
    entities = []
    for name, rgb, paths, regions in zip(
        forecasts.track_id, colors.tolist(), forecasts.paths - origin, forecasts.regions, strict=True
    ):
        if name in hidden:
            continue
        lines = line(SEGMENTS, paths, pixels=1.0, color=painted(rgb, opacity), height=HEIGHT["paths"], indices=segments)
        areas = [
            area(region.vertex - origin, region.triangle, height=HEIGHT[f"region_{round(100 * share)}"],
                 color=painted(rgb, fan))
            for share, region in zip(REGION_SHARES, regions, strict=True)
        ]  # fmt: skip
        notes = [KeyValuePair(key=f"triangles_{k}_share", value=repr(share)) for k, share in enumerate(REGION_SHARES)]
        entities.append(entity(name, forecasts.time_ns, lines=[lines], triangles=areas, metadata=notes))
    return fresh_update(entities, forecasts.time_ns)
