"""How each kind of thing is drawn in rerun: its shape, colour, size and height above the ground."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import rerun as rr

from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates, Particles
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer import shapes
from dirprim_filter.viewer.colors import direction_color, speed_color, track_color, with_alpha
from tessellation import Tessellation
from tessellation.arrays import AnyArray, FloatArray

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
FORECAST_OPACITY = 0.3
ID_OFFSET = np.array([0.0, 5.0])
"""Metres; a label on the vehicle would hide what it names."""

GREY = (70, 80, 100)
WHITE = (255, 255, 255)


def cells(tessellation: Tessellation) -> rr.LineStrips3D:
    """The borders of the cells."""
    outlines = [_raised(outline, HEIGHT["cells"]) for outline in shapes.cell_outlines(tessellation)]
    return rr.LineStrips3D(outlines, colors=GREY, radii=rr.Radius.ui_points(0.5))


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


def truth_style() -> rr.LineStrips3D:
    """The look that all instants of `truth_outlines` share."""
    return rr.LineStrips3D.from_fields(colors=WHITE, radii=rr.Radius.ui_points(0.75))


def truth_outlines(tracks: Tracks) -> npt.NDArray[np.float32]:
    """(n, k, 3) one closed line for each row."""
    return _raised(shapes.vehicle_outline(tracks.position, tracks.direction), HEIGHT["truth"])


def detections(reported: Detections) -> rr.Points3D:
    """White dots."""
    place = _raised(reported.position, HEIGHT["detections"])
    return rr.Points3D(place, colors=WHITE, radii=rr.Radius.ui_points(2.5))


def particles(samples: Particles, *, stride: int) -> rr.Points3D:
    """Small dots in the colour of their direction; every `stride`-th."""
    place = _raised(samples.position[::stride], HEIGHT["particles"])
    color = direction_color(samples.direction[::stride])
    return rr.Points3D(place, colors=color, radii=rr.Radius.ui_points(1.0))


def estimates(believed: Estimates) -> rr.Points3D:
    """Large dots in the vehicle's colour."""
    place = _raised(believed.position, HEIGHT["estimates"])
    return rr.Points3D(place, colors=track_color(believed.track_id), radii=rr.Radius.ui_points(4.5))


def ids(believed: Estimates) -> rr.Points3D:
    """The vehicles' names, beside them."""
    return rr.Points3D(
        _raised(believed.position + ID_OFFSET, HEIGHT["ids"]),
        colors=track_color(believed.track_id),
        radii=rr.Radius.ui_points(0.0),
        labels=[str(name) for name in believed.track_id],
        show_labels=True,
    )


def motion(believed: Estimates) -> rr.Arrows3D:
    """Arrows to where the vehicles will be in one second."""
    return rr.Arrows3D(
        origins=_raised(believed.position, HEIGHT["motion"]),
        vectors=_raised(shapes.motion_arrow(believed.direction, believed.speed), 0.0),
        colors=track_color(believed.track_id),
        radii=rr.Radius.ui_points(1.5),
    )


def covariance(believed: Estimates) -> rr.LineStrips3D:
    """Ellipses that hold `CONFIDENCE`."""
    ellipse = shapes.covariance_ellipse(
        believed.position, believed.covariance, probability=CONFIDENCE, n_vertices=ELLIPSE_VERTICES
    )
    color = track_color(believed.track_id)
    return rr.LineStrips3D(_raised(ellipse, HEIGHT["covariance"]), colors=color, radii=rr.Radius.ui_points(1.0))


def trails(track_id: AnyArray, start: FloatArray, end: FloatArray) -> rr.LineStrips3D:
    """The step of each vehicle from its last frame to this one."""
    step = _raised(np.stack([start, end], axis=1), HEIGHT["trails"])
    return rr.LineStrips3D(step, colors=track_color(track_id), radii=rr.Radius.ui_points(1.0))


def forecasts(paths: Mapping[str, FloatArray]) -> rr.LineStrips3D:
    """Sampled futures by vehicle, (n_samples, n_steps, 2) metres each, as thin lines."""
    names: AnyArray = np.repeat(np.array(list(paths), dtype=np.str_), [len(lines) for lines in paths.values()])
    lines = [_raised(line, HEIGHT["forecasts"]) for lines in paths.values() for line in lines]
    color = with_alpha(track_color(names), FORECAST_OPACITY)
    return rr.LineStrips3D(lines, colors=color, radii=rr.Radius.ui_points(0.5))


def _raised(points: FloatArray, height: FloatArray | float) -> npt.NDArray[np.float32]:
    """(..., 2) and a height (...) -> (..., 3), in the viewer's own precision."""
    raised = np.empty((*points.shape[:-1], 3), dtype=np.float32)
    raised[..., :2] = points
    raised[..., 2] = height
    return raised
