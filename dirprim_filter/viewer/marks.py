"""How each kind of thing is drawn in rerun: its shape, colour, size and height above the ground.

What moves comes as columns, one row for each thing, of any number of instants one after the other; what all of a
kind share is in `STYLES`, said once for the whole log.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
import rerun as rr

from dirprim_filter.estimates import Estimates
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer import shapes
from dirprim_filter.viewer.colors import direction_color, speed_color, track_color, with_alpha
from tessellation import Tessellation
from tessellation.arrays import FloatArray

CONFIDENCE = 0.9
"""Ellipses hold this probability."""
ELLIPSE_VERTICES = 24

FROM_BELOW = (
    "cells", "roses", "forecasts", "trails", "truth",
    "particles", "covariance", "motion", "estimates", "detections", "ids",
)  # fmt: skip
HEIGHT: Mapping[str, float] = {name: 0.1 * place for place, name in enumerate(FROM_BELOW)}
"""Metres above the ground: what lies in one plane would flicker."""
ROSE_THICKNESS = 0.05
"""Metres from the lowest petal to the highest."""
ROOT_SHADE = 4
"""A petal's root is darker by this factor, so that one sees which way it points; a disc points nowhere."""
FORECAST_OPACITY = 0.25
ID_OFFSET = np.array([0.0, 5.0])
"""Metres; a label on the vehicle would hide what it names."""

GREY = (70, 80, 100)
WHITE = (255, 255, 255)


def _points(radius: float) -> npt.ArrayLike:
    """A size on the screen, the same at every zoom."""
    return rr.Radius.ui_points(radius)


STYLES: Mapping[str, rr.AsComponents] = {
    "/truth": rr.LineStrips3D.from_fields(colors=WHITE, radii=_points(0.75)),
    "/detections": rr.Points3D.from_fields(colors=WHITE, radii=_points(2.5)),
    "/forecasts": rr.LineStrips3D.from_fields(radii=_points(0.5)),
    "/tracks/trails": rr.LineStrips3D.from_fields(radii=_points(1.0)),
    "/tracks/particles": rr.Points3D.from_fields(radii=_points(1.0)),
    "/tracks/covariance": rr.LineStrips3D.from_fields(radii=_points(1.0)),
    "/tracks/motion": rr.Arrows3D.from_fields(radii=_points(1.5)),
    "/tracks/estimates": rr.Points3D.from_fields(radii=_points(3.0)),
    "/tracks/ids": rr.Points3D.from_fields(radii=_points(0.0), show_labels=True),
}
"""By entity."""


def cells(tessellation: Tessellation) -> rr.LineStrips3D:
    """The borders of the cells."""
    outlines = [_raised(outline, HEIGHT["cells"]) for outline in shapes.cell_outlines(tessellation)]
    return rr.LineStrips3D(outlines, colors=GREY, radii=_points(0.5))


def roses(petals: shapes.Petals, *, fastest: float) -> rr.Mesh3D:
    """Filled petals in the colour of their mean speed; the heaviest lies lowest."""
    n, k = petals.polygon.shape[:2]
    height = HEIGHT["roses"] + np.linspace(0.0, ROSE_THICKNESS, n)
    color = np.repeat(speed_color(petals.mean_speed, fastest=fastest)[:, None], k, axis=1)
    is_disc = np.isclose(petals.polygon[:, 1], petals.polygon[:, -1]).all(axis=-1)
    color[~is_disc, 0, :3] //= ROOT_SHADE
    return rr.Mesh3D(
        vertex_positions=_raised(petals.polygon, height[:, None]).reshape(-1, 3),
        triangle_indices=shapes.fan_triangles(petals.polygon),
        vertex_colors=color.reshape(-1, 4),
    )


def truth(tracks: Tracks) -> rr.ComponentColumnList:
    """The outline of the vehicle of each row."""
    outline = shapes.vehicle_outline(tracks.position, tracks.direction)
    return rr.LineStrips3D.columns(strips=_raised(outline, HEIGHT["truth"]))


def detections(position: FloatArray) -> rr.ComponentColumnList:
    """White dots."""
    return rr.Points3D.columns(positions=_raised(position, HEIGHT["detections"]))


def particles(position: FloatArray, direction: FloatArray) -> rr.ComponentColumnList:
    """Small dots in the colour of their direction."""
    place = _raised(position, HEIGHT["particles"])
    return rr.Points3D.columns(positions=place, colors=direction_color(direction))


def estimates(believed: Estimates) -> rr.ComponentColumnList:
    """Large dots in the vehicle's colour."""
    place = _raised(believed.position, HEIGHT["estimates"])
    return rr.Points3D.columns(positions=place, colors=track_color(believed.track_id))


def ids(believed: Estimates) -> rr.ComponentColumnList:
    """The vehicles' names, beside them."""
    return rr.Points3D.columns(
        positions=_raised(believed.position + ID_OFFSET, HEIGHT["ids"]),
        colors=track_color(believed.track_id),
        labels=[str(name) for name in believed.track_id],
    )


def motion(believed: Estimates) -> rr.ComponentColumnList:
    """Arrows to where the vehicles will be in one second."""
    return rr.Arrows3D.columns(
        origins=_raised(believed.position, HEIGHT["motion"]),
        vectors=_raised(shapes.motion_arrow(believed.direction, believed.speed), 0.0),
        colors=track_color(believed.track_id),
    )


def covariance(believed: Estimates) -> rr.ComponentColumnList:
    """Ellipses that hold `CONFIDENCE`."""
    ellipse = shapes.covariance_ellipse(
        believed.position, believed.covariance, probability=CONFIDENCE, n_vertices=ELLIPSE_VERTICES
    )
    color = track_color(believed.track_id)
    return rr.LineStrips3D.columns(strips=_raised(ellipse, HEIGHT["covariance"]), colors=color)


def trails(track_id: Sequence[str], step: FloatArray) -> rr.ComponentColumnList:
    """The step of each vehicle from where it was last seen to where it is. (n, 2, 2) metres."""
    color = track_color(track_id)
    return rr.LineStrips3D.columns(strips=_raised(step, HEIGHT["trails"]), colors=color)


def forecasts(track_id: Sequence[str], paths: FloatArray) -> rr.ComponentColumnList:
    """The sampled futures of each vehicle as thin lines. (n, n_samples, n_steps, 2) metres."""
    n, n_samples, n_steps, _ = paths.shape
    color = np.repeat(with_alpha(track_color(track_id), FORECAST_OPACITY), n_samples, axis=0)
    lines = _raised(paths.reshape(n * n_samples, n_steps, 2), HEIGHT["forecasts"])
    return rr.LineStrips3D.columns(strips=lines, colors=color)


def _raised(points: FloatArray, height: FloatArray | float) -> npt.NDArray[np.float32]:
    """(..., 2) and a height (...) -> (..., 3), in the viewer's own precision."""
    raised = np.empty((*points.shape[:-1], 3), dtype=np.float32)
    raised[..., :2] = points
    raised[..., 2] = height
    return raised
