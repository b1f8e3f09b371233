"""How each kind of thing is drawn in rerun: its shape, colour, size and height above the ground.

What moves comes as columns, one row for each thing, of any number of instants one after the other; what all of a
kind share is in `STYLES`, said once for the whole log.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt
import rerun as rr

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.distributions.highest_density import Region
from dirprim_filter.drawing import shapes
from dirprim_filter.drawing.colors import (
    ByteArray,
    direction_color,
    fan_opacity,
    track_color,
    with_alpha,
)
from dirprim_filter.drawing.names import short_name
from dirprim_filter.estimates import Estimates, Particles
from dirprim_filter.forecasting import REGION_SHARES
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer.focus import CROWD
from tessellation import Tessellation

CONFIDENCE = 0.9
"""Ellipses hold this probability."""
FANS = tuple(f"/forecasts/region_{100 * share:.0f}" for share in REGION_SHARES)
"""Entities of the fans of forecasts."""

FROM_BELOW = (
    "cells", "roses", "region_90", "region_50", "forecasts", "trails", "truth",
    "particles", "covariance", "motion", "ring", "estimates", "detections", "ids",
)  # fmt: skip
HEIGHT: Mapping[str, float] = {name: 0.1 * place for place, name in enumerate(FROM_BELOW)}
"""Metres above the ground: what lies in one plane would flicker."""
ROSE_THICKNESS = 0.05
"""Metres from the lowest petal to the highest."""
ROSES_UNDER_TRAFFIC = rr.Mesh3D.from_fields(albedo_factor=(255, 255, 255, 165))
"""What moves must stand out."""
FORECAST_OPACITY = 0.25
STEP_STRIDE = 2
"""Every second instant is enough for a line."""
FADING = 0.35
"""Power of their number by which marks of a crowd shrink, and darken: what they cover grows more slowly than they."""
ESTIMATE_RADIUS, MOTION_RADIUS, TRAIL_RADIUS, DETECTION_RADIUS, TRUTH_RADIUS = 3.0, 1.5, 1.0, 2.5, 0.75
"""Points on the screen."""
PATHS_DRAWN = 6
"""Of each vehicle at most; their fans hold them all."""
UNSEEN_SHADE = 0.5
"""Vehicles out of sight are darker by this factor."""
RING_RADIUS = 0.045
"""Of the depth of ground in view, around the vehicle to look at."""
ID_OFFSET = 0.035
"""Of the depth of ground in view, northwards; a label on the vehicle would hide what it names."""

GREY = (70, 80, 100)
WHITE = (255, 255, 255)


def _points(radius: float | FloatArray) -> npt.ArrayLike:
    """Sizes on the screen, the same at every zoom."""
    return rr.Radius.ui_points(radius)


STYLES: Mapping[str, rr.AsComponents] = {
    "/truth/trails": rr.LineStrips3D.from_fields(colors=(150, 155, 165), radii=_points(0.5)),
    "/forecasts/paths": rr.LineStrips3D.from_fields(radii=_points(0.5)),
    "/focus/ring": rr.LineStrips3D.from_fields(colors=WHITE, radii=_points(1.0)),
    "/tracks/particles": rr.Points3D.from_fields(radii=_points(1.0)),
    "/tracks/covariance": rr.Ellipsoids3D.from_fields(line_radii=_points(0.75)),
    "/tracks/unseen": rr.Ellipsoids3D.from_fields(line_radii=_points(0.5), fill_mode="majorwireframe"),
    "/smoothed/covariance": rr.Ellipsoids3D.from_fields(line_radii=_points(0.5)),
    "/tracks/ids": rr.Points3D.from_fields(radii=_points(0.0), show_labels=True),
}
"""By entity."""


def in_crowd(n: IntArray) -> FloatArray:
    """Size and lightness of n vehicles that are not drawn in full, 1 unless they are many."""
    return np.asarray(np.minimum(1.0, (CROWD / np.maximum(n, 1)) ** FADING))


def cells(tessellation: Tessellation) -> rr.LineStrips3D:
    """The borders of the cells."""
    outlines = [_raised(outline, HEIGHT["cells"]) for outline in shapes.cell_outlines(tessellation)]
    return rr.LineStrips3D(outlines, colors=GREY, radii=_points(0.5))


def roses(petals: shapes.Petals, *, fastest: float) -> rr.Mesh3D:
    """Filled petals in the colour of their mean speed; the heaviest lies lowest."""
    height = HEIGHT["roses"] + np.linspace(0.0, ROSE_THICKNESS, len(petals.polygon))
    return rr.Mesh3D(
        vertex_positions=_raised(petals.polygon, height[:, None]).reshape(-1, 3),
        triangle_indices=shapes.fan_triangles(petals.polygon),
        vertex_colors=shapes.petal_colors(petals, fastest=fastest).reshape(-1, 4),
    )


def truth(tracks: Tracks) -> rr.ComponentColumnList:
    """The outline of the vehicle of each row."""
    outline = shapes.vehicle_outline(tracks.position, tracks.body_direction, tracks.size)
    return rr.LineStrips3D.columns(strips=_raised(outline, HEIGHT["truth"]))


def truth_style(n: int) -> rr.LineStrips3D:
    """White outlines of n vehicles at most; of a crowd, of which they would hide all else, thin and grey ones."""
    share = float(in_crowd(np.array(n)))
    return rr.LineStrips3D.from_fields(colors=[round(255 * share)] * 3, radii=_points(TRUTH_RADIUS * share))


def detections(position: FloatArray, n_each: Sequence[int]) -> rr.ComponentColumnList:
    """White dots, so many at each instant; those of a crowd smaller and grey."""
    places = rr.Points3D.columns(positions=_raised(position, HEIGHT["detections"])).partition(n_each)
    share = in_crowd(np.array(n_each))
    color = np.rint(255 * share)[:, None].repeat(3, axis=1).astype(np.uint8)
    of_all = rr.Points3D.columns(radii=_points(DETECTION_RADIUS * share), colors=color)
    return rr.ComponentColumnList([*places, *of_all])


def particles(parts: Sequence[Particles]) -> rr.ComponentColumnList:
    """Small dots in the colours of their directions, of one instant after the other."""
    place = np.concatenate([_raised(part.position, HEIGHT["particles"]) for part in parts])
    color = [np.ascontiguousarray(direction_color(part.direction)).view(">u4")[:, 0] for part in parts]
    return rr.Points3D.columns(positions=place, colors=np.concatenate(color).astype(np.uint32))


def estimates(believed: Estimates, prominence: FloatArray) -> rr.ComponentColumnList:
    """Large dots in the vehicle's colour."""
    place = _raised(believed.position, HEIGHT["estimates"])
    return rr.Points3D.columns(positions=place, colors=_shade(believed), radii=_points(ESTIMATE_RADIUS * prominence))


def ids(believed: Estimates, *, depth: float) -> rr.ComponentColumnList:
    """The vehicles' names, beside them; `depth` metres of ground are in view."""
    return rr.Points3D.columns(
        positions=_raised(believed.position + np.array([0.0, ID_OFFSET * depth]), HEIGHT["ids"]),
        colors=_shade(believed),
        labels=[short_name(str(name)) for name in believed.track_id],
    )


def motion(believed: Estimates, prominence: FloatArray) -> rr.ComponentColumnList:
    """Arrows to where the vehicles will be in one second."""
    return rr.Arrows3D.columns(
        origins=_raised(believed.position, HEIGHT["motion"]),
        vectors=_raised(shapes.motion_arrow(believed.direction, believed.speed), 0.0),
        colors=_shade(believed),
        radii=_points(MOTION_RADIUS * prominence),
    )


def covariance(believed: Estimates) -> rr.ComponentColumnList:
    """Ellipses that hold `CONFIDENCE`."""
    half_axes, angle = shapes.covariance_axes(believed.covariance, probability=CONFIDENCE)
    turn = np.zeros((len(believed), 4), dtype=np.float32)
    turn[:, 2], turn[:, 3] = np.sin(0.5 * angle), np.cos(0.5 * angle)
    return rr.Ellipsoids3D.columns(
        centers=_raised(believed.position, HEIGHT["covariance"]),
        half_sizes=_raised(half_axes, 0.0),
        quaternions=turn,
        colors=_shade(believed),
    )


def trails(
    track_id: AnyArray, step: FloatArray, prominence: FloatArray, *, width: float = 1.0
) -> rr.ComponentColumnList:
    """The step of each vehicle from where it was last seen to where it is. (n, 2, 2) metres."""
    color = track_color(track_id)
    color[:, :3] = np.rint(prominence[:, None] * color[:, :3])
    strips = _raised(step, HEIGHT["trails"])
    return rr.LineStrips3D.columns(strips=strips, colors=color, radii=_points(width * TRAIL_RADIUS * prominence))


def true_trails(step: FloatArray) -> rr.ComponentColumnList:
    """The step of each true vehicle. (n, 2, 2) metres."""
    return rr.LineStrips3D.columns(strips=_raised(step, HEIGHT["truth"]))


def ring(position: FloatArray, *, depth: float) -> rr.ComponentColumnList:
    """A circle around the vehicle to look at, (n, 2) metres; `depth` metres of ground are in view."""
    angle = np.linspace(0.0, 2.0 * np.pi, 37)
    circle = position[:, None] + RING_RADIUS * depth * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return rr.LineStrips3D.columns(strips=_raised(circle, HEIGHT["ring"]))


def forecasts(
    track_id: Sequence[str], paths: FloatArray, regions: Sequence[Sequence[Region]]
) -> Iterator[tuple[str, rr.ComponentColumnList]]:
    """Rollouts of vehicles at one instant, by entity: thin lines, and the fans that hold them all.

    Args:
        track_id: n ids.
        paths: (n, n_samples, n_instants, 2) metres, from where the vehicles are.
        regions: n vehicles', for each of `FANS`.
    """
    color = track_color(track_id)
    last = max(paths.shape[2] - 1, 0)
    kept = np.unique(np.append(np.arange(last, -1, -STEP_STRIDE), 0))  # the first and the last are among them
    lines = paths[:, :PATHS_DRAWN, kept] if len(track_id) else np.empty((0, 1, 1, 2))
    shade = np.repeat(with_alpha(color, FORECAST_OPACITY), lines.shape[1], axis=0)
    strips = _raised(lines.reshape(-1, *lines.shape[2:]), HEIGHT["forecasts"])
    yield "/forecasts/paths", rr.LineStrips3D.columns(strips=strips, colors=shade).partition([len(shade)])
    for k, entity in enumerate(FANS):
        parts = [of_vehicle[k] for of_vehicle in regions]
        n_before = np.cumsum([0, *(len(part.vertex) for part in parts)])
        vertex = np.concatenate([np.empty((0, 2)), *(part.vertex for part in parts)])
        triangle = np.concatenate(
            [np.empty((0, 3), np.int64), *(n + part.triangle for n, part in zip(n_before, parts, strict=False))]
        )
        corners = rr.Mesh3D.columns(
            vertex_positions=_raised(vertex, HEIGHT[entity.rsplit("/", 1)[-1]]),
            vertex_colors=np.repeat(color, np.diff(n_before), axis=0),
        ).partition([len(vertex)])
        faces = rr.Mesh3D.columns(triangle_indices=triangle.astype(np.uint32)).partition([len(triangle)])
        seen_through = rr.Mesh3D.columns(albedo_factor=[(255, 255, 255, round(255 * fan_opacity(len(parts))))])
        yield entity, rr.ComponentColumnList([*corners, *faces, *seen_through])


def _shade(believed: Estimates) -> ByteArray:
    """The colours of vehicles; of those out of sight darker."""
    color = track_color(believed.track_id)
    unseen = believed.is_coasting
    color[unseen, :3] = np.rint(UNSEEN_SHADE * color[unseen, :3])
    return color


def _raised(points: FloatArray, height: FloatArray | float) -> npt.NDArray[np.float32]:
    """(..., 2) and a height (...) -> (..., 3), in the viewer's own precision."""
    raised = np.empty((*points.shape[:-1], 3), dtype=np.float32)
    raised[..., :2] = points
    raised[..., 2] = height
    return raised
