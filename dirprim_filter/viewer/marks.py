"""How each kind of thing is drawn in rerun: its shape, colour, size and height above the ground.

What moves comes as columns, one row for each thing, of any number of instants one after the other: a message costs more
than what one frame puts in it. What all of a kind share is in `STYLES`, said once for the whole log.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt
import rerun as rr

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions.highest_density import Region
from dirprim_filter.drawing import shapes
from dirprim_filter.drawing.colors import ByteArray, direction_color, fan_opacity, track_color
from dirprim_filter.drawing.vehicles import may_be_anywhere, short_name
from dirprim_filter.estimates import Estimates, Particles, TrackedFrame
from dirprim_filter.forecasting import REGION_SHARES
from dirprim_filter.tracks import Tracks
from tessellation import Tessellation

Columns = tuple[str, rr.ComponentColumnList]
"""An entity, and what it shows at each of some instants."""
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
FORECAST_OPACITY = 64
STEP_STRIDE = 2
"""Every second instant is enough for a line."""
PATHS_DRAWN = 6
"""Of each vehicle at most; their fans hold them all."""
UNSEEN_SHADE = 0.5
"""Vehicles out of sight are darker by this factor."""
RING_RADIUS = 0.045
"""Of the depth of ground in view, around the vehicle to look at."""
ID_OFFSET = 0.035
"""Of the depth of ground in view, northwards; a label on the vehicle would hide what it names."""

GREY, TRUTH_GREY = (70, 80, 100), (150, 155, 165)
WHITE = (255, 255, 255)


def _points(radius: float) -> npt.ArrayLike:
    """A size on the screen, the same at every zoom."""
    return rr.Radius.ui_points(radius)


STYLES: Mapping[str, rr.AsComponents] = {
    "/truth": rr.LineStrips3D.from_fields(colors=WHITE, radii=_points(0.75)),
    "/truth/trails": rr.Points3D.from_fields(colors=TRUTH_GREY, radii=_points(0.5)),
    "/detections": rr.Points3D.from_fields(colors=WHITE, radii=_points(2.5)),
    "/forecasts/paths": rr.LineStrips3D.from_fields(radii=_points(0.5)),
    "/focus/ring": rr.LineStrips3D.from_fields(colors=WHITE, radii=_points(1.0)),
    "/tracks/particles": rr.Points3D.from_fields(radii=_points(1.0)),
    "/tracks/estimates": rr.Points3D.from_fields(radii=_points(3.0)),
    "/tracks/trails": rr.Points3D.from_fields(radii=_points(1.5)),
    "/tracks/motion": rr.Arrows3D.from_fields(radii=_points(1.5)),
    "/tracks/covariance": rr.Ellipsoids3D.from_fields(line_radii=_points(0.75)),
    "/tracks/unseen": rr.Ellipsoids3D.from_fields(line_radii=_points(0.5), fill_mode="majorwireframe"),
    "/tracks/ids": rr.Points3D.from_fields(radii=_points(0.0)),
    "/smoothed/trails": rr.Points3D.from_fields(radii=_points(3.0)),
    "/smoothed/covariance": rr.Ellipsoids3D.from_fields(line_radii=_points(0.5)),
}
"""By entity."""


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


def truth(tracks: Tracks, n_each: Sequence[int]) -> Iterator[Columns]:
    """Outlines of the vehicles, and dots where they come by; rows in order of time."""
    outline = shapes.vehicle_outline(tracks.position, tracks.body_direction, tracks.size)
    yield "/truth", rr.LineStrips3D.columns(strips=_raised(outline, HEIGHT["truth"])).partition(n_each)
    yield "/truth/trails", rr.Points3D.columns(positions=_raised(tracks.position, HEIGHT["truth"])).partition(n_each)


def detections(position: FloatArray, n_each: Sequence[int]) -> Columns:
    """Dots, so many at each instant."""
    return "/detections", rr.Points3D.columns(positions=_raised(position, HEIGHT["detections"])).partition(n_each)


def frames(shown: Sequence[TrackedFrame], *, depth: float) -> Iterator[Columns]:
    """What frames show, at least one; a vehicle that a frame does not name vanishes in it.

    Args:
        shown: the frames, with those particles that are drawn.
        depth: metres of ground in view: labels keep their distance on the screen.
    """
    estimates = Estimates.concatenate([frame.estimates for frame in shown])
    n_each = [len(frame.estimates) for frame in shown]
    shade, unseen = _shade(estimates), estimates.is_coasting
    place = _raised(estimates.position, HEIGHT["estimates"])
    yield "/tracks/estimates", rr.Points3D.columns(positions=place, colors=shade).partition(n_each)
    yield _trails("/tracks", estimates, shade, n_each)
    beside = _raised(estimates.position + np.array([0.0, ID_OFFSET * depth]), HEIGHT["ids"])
    names = [short_name(str(name)) for name in estimates.track_id]
    yield "/tracks/ids", rr.Points3D.columns(positions=beside, colors=shade, labels=names).partition(n_each)
    arrow = _raised(shapes.motion_arrow(estimates.direction, estimates.speed), 0.0)
    start = _raised(estimates.position, HEIGHT["motion"])
    yield "/tracks/motion", rr.Arrows3D.columns(origins=start, vectors=arrow, colors=shade).partition(n_each)
    frame = np.repeat(np.arange(len(shown)), n_each)
    for entity, drawn in (("covariance", ~unseen), ("unseen", unseen & ~may_be_anywhere(estimates))):
        of_each = np.bincount(frame[drawn], minlength=len(shown))
        yield f"/tracks/{entity}", _covariance(estimates[drawn], shade[drawn]).partition(of_each)
    seen = [frame.detections.position for frame in shown]
    yield detections(np.concatenate(seen), [len(part) for part in seen])
    clouds = [frame.particles.thinned(1) for frame in shown]
    yield "/tracks/particles", _particles(clouds).partition([len(cloud) for cloud in clouds])


def smoothed(shown: Sequence[TrackedFrame]) -> Iterator[Columns]:
    """What smoothed frames show beside those of the filter: bold paths and thin ellipses."""
    estimates = Estimates.concatenate([frame.estimates for frame in shown])
    n_each, shade = [len(frame.estimates) for frame in shown], _shade(estimates)
    yield _trails("/smoothed", estimates, shade, n_each)
    yield "/smoothed/covariance", _covariance(estimates, shade).partition(n_each)


def ring(position: FloatArray, *, depth: float) -> rr.ComponentColumnList:
    """A circle around the vehicle to look at, (n, 2) metres; `depth` metres of ground are in view."""
    angle = np.linspace(0.0, 2.0 * np.pi, 37)
    circle = position[:, None] + RING_RADIUS * depth * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return rr.LineStrips3D.columns(strips=_raised(circle, HEIGHT["ring"]))


def forecasts(track_id: Sequence[str], paths: FloatArray, regions: Sequence[Sequence[Region]]) -> Iterator[Columns]:
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
    shade = np.repeat(color, lines.shape[1], axis=0)
    shade[:, 3] = FORECAST_OPACITY
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


def _trails(root: str, estimates: Estimates, shade: ByteArray, n_each: list[int]) -> Columns:
    """Dots where vehicles came by: the view keeps those of the last seconds."""
    place = _raised(estimates.position, HEIGHT["trails"])
    return f"{root}/trails", rr.Points3D.columns(positions=place, colors=shade).partition(n_each)


def _covariance(estimates: Estimates, shade: ByteArray) -> rr.ComponentColumnList:
    """Ellipses that hold `CONFIDENCE`."""
    half_axes, angle = shapes.covariance_axes(estimates.covariance, probability=CONFIDENCE)
    turn = np.zeros((len(estimates), 4), dtype=np.float32)
    turn[:, 2], turn[:, 3] = np.sin(0.5 * angle), np.cos(0.5 * angle)
    center, half = _raised(estimates.position, HEIGHT["covariance"]), _raised(half_axes, 0.0)
    return rr.Ellipsoids3D.columns(centers=center, half_sizes=half, quaternions=turn, colors=shade)


def _particles(parts: Sequence[Particles]) -> rr.ComponentColumnList:
    """Small dots in the colours of their directions, of one instant after the other."""
    place = np.concatenate([_raised(part.position, HEIGHT["particles"]) for part in parts])
    color = [np.ascontiguousarray(direction_color(part.direction)).view(">u4")[:, 0] for part in parts]
    return rr.Points3D.columns(positions=place, colors=np.concatenate(color).astype(np.uint32))


def _shade(estimates: Estimates) -> ByteArray:
    """The colours of vehicles; of those out of sight darker."""
    color = track_color(estimates.track_id)
    unseen = estimates.is_coasting
    color[unseen, :3] = np.rint(UNSEEN_SHADE * color[unseen, :3])
    return color


def _raised(points: FloatArray, height: FloatArray | float) -> npt.NDArray[np.float32]:
    """(..., 2) and a height (...) -> (..., 3), in the viewer's own precision."""
    raised = np.empty((*points.shape[:-1], 3), dtype=np.float32)
    raised[..., :2] = points
    raised[..., 2] = height
    return raised
