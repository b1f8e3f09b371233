"""How each kind of thing is drawn in rerun: its shape, colour, size and height above the ground.

What moves comes as columns of any number of instants one after the other: a message costs more than what one frame puts
in it. A vehicle is one entity, of a dot, an arrow, an ellipse and a trail: to be hidden, picked and found at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import rerun as rr

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.distributions.highest_density import Region
from dirprim_filter.drawing import shapes
from dirprim_filter.drawing.colors import ByteArray, direction_color, fan_opacity, track_color
from dirprim_filter.drawing.vehicles import may_be_anywhere, short_name
from dirprim_filter.estimates import Estimates, Particles, TrackedFrame
from dirprim_filter.forecasting import REGION_SHARES
from dirprim_filter.origin import Origin, drawable
from dirprim_filter.tracks import Tracks
from tessellation import Tessellation

Columns = tuple[str, rr.ComponentColumnList]
"""An entity, and what it shows at each of some instants."""
FANS = tuple(f"/forecasts/region_{100 * share:.0f}" for share in REGION_SHARES)
"""Entities of the fans of forecasts."""

HEIGHT: Mapping[str, float] = {name: 0.1 * place for place, name in enumerate((
    "cells", "roses", "region_90", "region_50", "forecasts", "trails", "truth", "particles", "covariance", "motion",
    "estimates", "assigned", "detections", "ids",
))}  # fmt: skip
"""Metres above the ground: what lies in one plane would flicker."""

FAINT_ROSES = rr.Mesh3D.from_fields(albedo_factor=(255, 255, 255, 165))
"""Under traffic: what moves must stand out."""
GREY, TRUTH_GREY, RED = (70, 80, 100), (150, 155, 165), (255, 80, 60)
WHITE = (255, 255, 255)
SENSORS = ((255, 255, 255), (255, 200, 80), (120, 230, 160), (150, 190, 255), (255, 150, 200), (200, 160, 255))
"""Colours of detections, by sensor."""


def _points(*radius: float) -> npt.ArrayLike:
    """Sizes on the screen, the same at every zoom."""
    return rr.Radius.ui_points(radius)


STYLES: Mapping[str, rr.AsComponents] = {
    "/assigned": rr.Arrows3D.from_fields(radii=_points(1.0)),
    "/forecasts/paths": rr.LineStrips3D.from_fields(radii=_points(0.5)),
    "/particles": rr.Points3D.from_fields(radii=_points(1.0)),
    "/events/marks": rr.Points3D.from_fields(colors=RED, radii=_points(5.0)),
}
"""By entity."""
OF_VEHICLES: Mapping[str, Sequence[rr.AsComponents]] = {
    "/tracks": (
        rr.Points3D.from_fields(radii=_points(3.0, 0.0)), rr.Arrows3D.from_fields(radii=_points(1.5)),
        rr.Ellipsoids3D.from_fields(line_radii=_points(0.75)), rr.LineStrips3D.from_fields(radii=_points(1.0)),
        rr.GeoPoints.from_fields(radii=_points(4.0)),
    ),
    "/smoothed": (rr.LineStrips3D.from_fields(radii=_points(2)), rr.Ellipsoids3D.from_fields(line_radii=_points(0.5))),
    "/truth": (
        rr.LineStrips3D.from_fields(colors=[WHITE, TRUTH_GREY], radii=_points(0.75, 0.5)),
        rr.GeoPoints.from_fields(colors=WHITE, radii=_points(2.0)),
    ),
}  # fmt: skip
"""By what comes before the vehicle's name in its entity."""


class Part(NamedTuple):
    """An archetype of many rows: fields by name, arrays over the rows; of `each` instances, over these next."""

    archetype: Any
    fields: Mapping[str, AnyArray]
    each: int = 1

    def columns(self, rows: IntArray, counts: IntArray) -> rr.ComponentColumnList:
        """Some rows, so many at each of some instants."""
        chosen = {name: field[rows] for name, field in self.fields.items()}
        flat = {name: of.reshape(-1, *of.shape[2:]) if self.each > 1 else of for name, of in chosen.items()}
        plain = {name: of.tolist() if of.dtype.kind in "OU" else of for name, of in flat.items()}
        columns: rr.ComponentColumnList = self.archetype.columns(**plain).partition(self.each * counts)
        return columns


def cells(tessellation: Tessellation) -> rr.LineStrips3D:
    """The borders of the cells."""
    outlines = [_raised(outline, HEIGHT["cells"]) for outline in shapes.cell_outlines(tessellation)]
    return rr.LineStrips3D(outlines, colors=GREY, radii=_points(0.5))


def roses(petals: shapes.Petals, *, fastest: float) -> rr.Mesh3D:
    """Filled petals in the colour of their mean speed; the heaviest lies lowest, 5 cm below the last."""
    height = HEIGHT["roses"] + np.linspace(0.0, 0.05, len(petals.polygon))
    return rr.Mesh3D(
        vertex_positions=_raised(petals.polygon, height[:, None]).reshape(-1, 3),
        triangle_indices=shapes.fan_triangles(petals.polygon),
        vertex_colors=shapes.petal_colors(petals, fastest=fastest).reshape(-1, 4),
    )


def petals_on_earth(petals: shapes.Petals, origin: Origin, *, fastest: float) -> rr.GeoLineStrings:
    """The outlines of the petals, on a map of the Earth."""
    places = origin.to_globe(petals.polygon.reshape(-1, 2)).reshape(petals.polygon.shape)
    color = shapes.petal_colors(petals, fastest=fastest)[:, 1]
    return rr.GeoLineStrings(lat_lon=list(np.concatenate([places, places[:, :1]], axis=1)), colors=color)


def truth(tracks: Tracks, trails: AnyArray) -> Iterator[Part]:
    """Outlines of the vehicles, and (n,) the trails to where they are."""
    outline = _raised(shapes.vehicle_outline(tracks.position, tracks.body_direction, tracks.size), HEIGHT["truth"])
    yield Part(rr.LineStrips3D, {"strips": np.column_stack([_apart(outline), trails])}, 2)
    yield from _on_earth(tracks, {})


def vehicles(estimates: Estimates, trails: AnyArray, *, depth: float) -> Iterator[Part]:
    """A dot with a name, where they will be in a second, the ellipse, and (n,) the trails to where they are.

    Args:
        estimates: of any instants.
        trails: of lines.
        depth: metres of ground in view: labels keep their distance on the screen, not to hide what they name.
    """
    shade = _shade(estimates)
    place, beside = estimates.position, estimates.position + np.array([0.0, 0.035 * depth])
    points = np.stack([_raised(place, HEIGHT["estimates"]), _raised(beside, HEIGHT["ids"])], axis=1)
    colors = np.repeat(shade[:, None], 2, axis=1)
    labels = np.array([["", short_name(name)] for name in estimates.track_id.astype(np.str_).tolist()], object)
    yield Part(rr.Points3D, {"positions": points, "colors": colors, "labels": labels}, 2)
    arrow = _raised(shapes.motion_arrow(estimates.direction, estimates.speed), 0.0)
    yield Part(rr.Arrows3D, {"origins": _raised(place, HEIGHT["motion"]), "vectors": arrow, "colors": shade})
    yield _covariance(estimates, shade)
    yield Part(rr.LineStrips3D, {"strips": trails, "colors": shade})
    yield from _on_earth(estimates, {"colors": shade})


def smoothed(estimates: Estimates, trails: AnyArray) -> Iterator[Part]:
    """What smoothed estimates show beside those of the filter: bold trails and thin ellipses."""
    shade = _shade(estimates)
    yield Part(rr.LineStrips3D, {"strips": trails, "colors": shade})
    yield _covariance(estimates, shade)


def detections(position: FloatArray, counts: IntArray | Sequence[int]) -> rr.ComponentColumnList:
    """Dots, so many at each of some instants."""
    return rr.Points3D.columns(positions=_raised(position, HEIGHT["detections"])).partition(counts)


def detection_style(number: int) -> rr.AsComponents:
    """Of the so many-th sensor."""
    return rr.Points3D.from_fields(colors=SENSORS[number % len(SENSORS)], radii=_points(2.5))


def assigned(shown: Sequence[TrackedFrame]) -> Columns:
    """Innovations: arrows from where vehicles were expected to the detections assigned to them, in their colours.

    Where it is not known what was expected, as of tracks that were read from a file, they begin at the estimates.
    """
    ends, names, n_each = [np.empty((0, 2, 2))], list[str](), []
    for frame in shown:
        row = {name: i for i, name in enumerate(frame.names)}
        own = np.array([row.get(name, -1) for name in frame.assigned.tolist()], np.int64)
        known = own >= 0
        begin = frame.estimates.position if frame.expected is None else frame.expected
        ends.append(np.stack([begin[own[known]], frame.detections.position[known]], axis=1))
        names += [frame.names[i] for i in own[known].tolist()]
        n_each.append(int(known.sum()))
    begin, end = np.concatenate(ends).swapaxes(0, 1)
    arrows = rr.Arrows3D.columns(
        origins=_raised(begin, HEIGHT["assigned"]), vectors=_raised(end - begin, 0.0), colors=track_color(names)
    )
    return "/assigned", arrows.partition(n_each)


def particles(parts: Sequence[Particles]) -> Columns:
    """Small dots in the colours of their directions, of one instant after the other."""
    place = np.concatenate([_raised(part.position, HEIGHT["particles"]) for part in parts])
    color = [np.ascontiguousarray(direction_color(part.direction)).view(">u4")[:, 0] for part in parts]
    dots = rr.Points3D.columns(positions=place, colors=np.concatenate(color).astype(np.uint32))
    return "/particles", dots.partition([len(part) for part in parts])


def event_marks(shown: Sequence[Sequence[tuple[str, FloatArray]]]) -> Columns:
    """Names and places of what has happened a short time ago, at each of some instants."""
    all_of = [mark for marks in shown for mark in marks]
    place = np.array([where for _, where in all_of]).reshape(-1, 2)
    labelled = rr.Points3D.columns(positions=_raised(place, HEIGHT["ids"]), labels=[text for text, _ in all_of])
    return "/events/marks", labelled.partition([len(marks) for marks in shown])


def forecasts(track_id: Sequence[str], paths: FloatArray, regions: Sequence[Sequence[Region]]) -> Iterator[Columns]:
    """Rollouts of vehicles at one instant, by entity: some thin lines, and the fans that hold them all.

    Args:
        track_id: n ids.
        paths: (n, n_samples, n_instants, 2) metres, from where the vehicles are.
        regions: n vehicles', for each of `FANS`.
    """
    color = track_color(track_id)
    last = max(paths.shape[2] - 1, 0)
    kept = np.unique(np.append(np.arange(last, -1, -2), 0))  # every second instant, the first and the last
    lines = paths[:, :6, kept] if len(track_id) else np.empty((0, 1, 1, 2))
    shade = np.repeat(color, lines.shape[1], axis=0)
    shade[:, 3] = 64
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


def strips_of(lines: Sequence[Sequence[FloatArray]]) -> AnyArray:
    """(n,) lines, (k, 2) metres each, as strips at the height of trails."""
    return _apart([_raised(np.asarray(line), HEIGHT["trails"]) for line in lines])


def _apart(values: Sequence[AnyArray] | AnyArray) -> AnyArray:
    """(n,) objects, of arrays of any lengths."""
    strips: AnyArray = np.empty(len(values), object)
    strips[:] = [*values]
    return strips


def _covariance(estimates: Estimates, shade: ByteArray) -> Part:
    """Ellipses that hold a probability of 0.9; of no size where the vehicle may be anywhere."""
    half_axes, angle = shapes.covariance_axes(estimates.covariance, probability=0.9)
    half_axes[may_be_anywhere(estimates)] = 0.0
    turn = np.zeros((len(estimates), 4), dtype=np.float32)
    turn[:, 2], turn[:, 3] = np.sin(0.5 * angle), np.cos(0.5 * angle)
    center, half = _raised(estimates.position, HEIGHT["covariance"]), _raised(half_axes, 0.0)
    return Part(rr.Ellipsoids3D, {"centers": center, "half_sizes": half, "quaternions": turn, "colors": shade})


def _on_earth(rows: Tracks | Estimates, more: Mapping[str, AnyArray]) -> Iterator[Part]:
    """Where their plane lies on the Earth, if that is known."""
    if (origin := drawable(rows.origin)) is not None:
        yield Part(rr.GeoPoints, {"positions": origin.to_globe(rows.position), **more})


def _shade(estimates: Estimates) -> ByteArray:
    """The colours of vehicles; of those out of sight half as light."""
    color = track_color(estimates.track_id)
    unseen: BoolArray = estimates.is_coasting
    color[unseen, :3] = np.rint(0.5 * color[unseen, :3])
    return color


def _raised(points: FloatArray, height: FloatArray | float) -> npt.NDArray[np.float32]:
    """(..., 2) and a height (...) -> (..., 3), in the viewer's own precision."""
    raised = np.empty((*points.shape[:-1], 3), dtype=np.float32)
    raised[..., :2] = points
    raised[..., 2] = height
    return raised
