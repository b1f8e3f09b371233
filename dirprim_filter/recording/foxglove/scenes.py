"""What is drawn of tracked vehicles, particles, reports, forecasts and maps.

A vehicle has a body, an arrow over one second of motion, the 90 % region of its position, a trail and a name; particles
and reports are points of the same size on the screen at every zoom; a forecast has thin lines and areas in the colour
of its vehicle; a map the outlines of its cells, and roses in the colours of speed, as rerun and figures draw them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from foxglove import messages as fg

from dirprim_filter.arrays import AnyArray, FloatArray
from dirprim_filter.columns import is_held
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.drawing import shapes
from dirprim_filter.drawing.colors import direction_color, fan_opacity, track_color
from dirprim_filter.drawing.vehicles import SURE_FROM, Trails, may_be_anywhere, short_name
from dirprim_filter.estimates import Estimates, Particles
from dirprim_filter.forecasting import REGION_SHARES, Forecasts
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording.foxglove.elements import (
    HEIGHT,
    SCENE_FRAME,
    SEGMENTS,
    STRIP,
    Template,
    area,
    entity,
    fresh_update,
    line,
    nested,
    painted,
    points,
    pose,
    rounded,
    stamp,
)
from dirprim_filter.recording.schemas.families import DRAWN_NOTE
from dirprim_filter.track_ids import as_texts

VEHICLE_SIZE = (4.5, 1.9, 1.5)
"""Length, width and height of the cube that stands for a vehicle of unknown size, metres: a middling car."""
REGION_SHARE = 0.9
MIN_AXIS = 0.02
"""Metres; a thinner ellipse would not be seen."""
OPACITY = {"body": 0.4, "arrow": 0.95, "region": 0.25, "trail": 0.7, "label": 0.95}
SMOOTHED_COLOR = (0.95, 0.95, 0.95)
COASTING_OPACITY = 0.35
"""Times as strong are vehicles that coast."""
HEAD_LENGTH, HEAD_SHARE = 0.9, 0.5
"""Of an arrow, metres, and of its length at most."""
LABEL_NORTH = 3.0
"""Metres; a label on the vehicle would hide what it names."""


class EstimatesScene:
    """The `SceneUpdate` of one instant after the other, which first deletes what earlier ones drew.

    Args:
        color: red, green and blue of all vehicles; left out, each has its own, the same as in rerun.

    Attributes:
        sizes: length, width and height that were last reported of vehicles, by name.
    """

    def __init__(self, color: Sequence[float] | None = None) -> None:
        self._color = color
        self.sizes: dict[str, list[float]] = {}
        self._trails = Trails()

    def update(self, estimates: Estimates, detections: Detections, time_ns: int, origin: FloatArray) -> bytes:
        """The encoded update of one instant; sizes are those that were last reported of vehicles by name.

        A vehicle of unknown direction, as one that has stood from its first detection on, is drawn as long as wide.

        Args:
            estimates: of this instant.
            detections: of this instant.
            time_ns: the instant.
            origin: (2,) of the scene's frame, metres.
        """
        names = as_texts(estimates.track_id).tolist()
        self._see_sizes(detections)
        half_axes, ellipse_yaw = shapes.covariance_axes(estimates.covariance, probability=REGION_SHARE)
        x, y = (estimates.position - origin).T
        length, width, height = np.array([self.sizes.get(name, VEHICLE_SIZE) for name in names]).reshape(-1, 3).T
        length = np.where(estimates.direction_resultant >= SURE_FROM, length, width)
        turns = (f(0.5 * yaw) for yaw in (estimates.direction, ellipse_yaw) for f in (np.sin, np.cos))
        head = np.minimum(HEAD_LENGTH, HEAD_SHARE * estimates.speed)
        color = track_color(names)[:, :3] / 255.0 if self._color is None else np.tile(self._color, (len(names), 1))
        strength = np.where(estimates.is_coasting, COASTING_OPACITY, 1.0)
        body, arrow, region, trail, label = (own * strength for own in OPACITY.values())
        drawn = _VEHICLE.encoded([
            x, y, 0.5 * height, length, width, height, *turns, estimates.speed - head, head,
            *np.maximum(2.0 * half_axes, MIN_AXIS).T, *color.T, body, arrow,
            np.where(may_be_anywhere(estimates), 0.0, region),
        ])  # fmt: skip
        lines, texts = _TRAIL.encoded([*color.T, trail]), _LABEL.encoded([x, y + LABEL_NORTH, *color.T, label])
        trails = self._trails.lead_on(names, [nested(5, point) for point in _POINT.encoded([x, y])], time_ns)
        common = entity("", time_ns, metadata=[fg.KeyValuePair(key=DRAWN_NOTE, value="body")]).encode()
        entities = (
            nested(2, common, nested(3, name.encode()), own, nested(11, line, *points),
                   nested(13, text, nested(6, short_name(name).encode())))
            for name, own, line, points, text in zip(names, drawn, lines, trails, texts, strict=True)
        )  # fmt: skip
        return b"".join([fresh_update([], time_ns).encode(), *entities])

    def _see_sizes(self, detections: Detections) -> None:
        if not is_held(detections.size):
            return
        for name, size in zip(detections.track_id.tolist(), detections.size, strict=True):
            if name != NO_ID and not np.isnan(size).all():
                self.sizes[name] = np.where(np.isnan(size), VEHICLE_SIZE, size).tolist()


def _vehicle(*number: float) -> fg.SceneEntity:
    """The parts of a vehicle that are numbers alone."""
    (x, y, middle, length, width, height, sine, cosine, ellipse_sine, ellipse_cosine, shaft, head, minor, major,
     *rgb, body, arrow, region) = number  # fmt: skip
    turn, of_ellipse = (
        fg.Quaternion(x=0.0, y=0.0, z=z, w=w) for z, w in ((sine, cosine), (ellipse_sine, ellipse_cosine))
    )
    return fg.SceneEntity(
        cubes=[fg.CubePrimitive(
            pose=pose(x, y, middle, turn), size=fg.Vector3(x=length, y=width, z=height), color=painted(rgb, body),
        )],
        arrows=[fg.ArrowPrimitive(
            pose=pose(x, y, HEIGHT["arrow"], turn), color=painted(rgb, arrow), shaft_diameter=0.35,
            head_diameter=1.0, shaft_length=shaft, head_length=head,
        )],
        cylinders=[fg.CylinderPrimitive(
            pose=pose(x, y, HEIGHT["region"], of_ellipse), size=fg.Vector3(x=minor, y=major, z=0.02),
            bottom_scale=1.0, top_scale=1.0, color=painted(rgb, region),
        )],
    )  # fmt: skip


_VEHICLE = Template(_vehicle, 20)
_POINT = Template(lambda x, y: fg.Point3(x=x, y=y, z=0.0), 2)
_TRAIL = Template(lambda *rgb: line(STRIP, [], pixels=2.0, color=painted(rgb, rgb[3]), height=HEIGHT["trails"]), 4)
_LABEL = Template(lambda x, y, *rgb: fg.TextPrimitive(
    pose=pose(x, y, HEIGHT["label"]), billboard=True, font_size=13.0, scale_invariant=True, color=painted(rgb, rgb[3]),
), 6)  # fmt: skip
PARTICLE_OPACITY = 0.7
_CHANNELS = ("red", "green", "blue", "alpha")
_PLACE = [("x", "<f4"), ("y", "<f4")]
_PARTICLE = np.dtype([*_PLACE, ("weight", "<f4"), *((channel, "u1") for channel in _CHANNELS)])
_REPORT = np.dtype(_PLACE)
_FIELD_TYPE = {"f4": fg.PackedElementFieldNumericType.Float32, "u1": fg.PackedElementFieldNumericType.Uint8}


def particle_cloud(particles: Particles, time_ns: int, origin: FloatArray) -> fg.PointCloud:
    """Each particle with its weight, in the colour of its direction."""
    rows: AnyArray = np.zeros(len(particles), _PARTICLE)
    rows["weight"] = particles.weight
    for channel, value in zip(_CHANNELS, direction_color(particles.direction).T, strict=True):
        rows[channel] = value
    rows["alpha"] = round(255 * PARTICLE_OPACITY)
    return _cloud(rows, particles.position - origin, time_ns, height=HEIGHT["particles"])


def detection_cloud(position: FloatArray, time_ns: int, origin: FloatArray) -> fg.PointCloud:
    """What was reported at one instant, (n, 2) metres."""
    return _cloud(np.zeros(len(position), _REPORT), position - origin, time_ns, height=HEIGHT["detections"])


def _cloud(rows: AnyArray, position: FloatArray, time_ns: int, *, height: float) -> fg.PointCloud:
    """Single precision counts from the middle of the points."""
    middle = np.round(position.mean(axis=0)) if len(position) else np.zeros(2)
    rows["x"], rows["y"] = (position - middle).T
    x, y = middle.tolist()
    return fg.PointCloud(
        timestamp=stamp(time_ns), frame_id=SCENE_FRAME, pose=pose(x, y, height),
        point_stride=rows.dtype.itemsize, data=rows.tobytes(),
        fields=[
            fg.PackedElementField(name=name, offset=offset, type=_FIELD_TYPE[kind.str[1:]])
            for name, (kind, offset, *_) in (rows.dtype.fields or {}).items()
        ],
    )  # fmt: skip


PATHS_OPACITY = 3.0
"""Of all the paths of a vehicle together, where they lie over each other; the more there are, the fainter is each."""
LEAST_OPACITY, MOST_OPACITY = 0.03, 0.4


def forecast_scene(forecasts: Forecasts, origin: FloatArray, *, hidden: frozenset[str] = frozenset()) -> fg.SceneUpdate:
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
        color = painted(rgb, opacity)
        lines = line(SEGMENTS, points(paths), pixels=1.0, color=color, height=HEIGHT["paths"], indices=segments)
        areas = [
            area(region.vertex - origin, region.triangle, height=HEIGHT[f"region_{round(100 * share)}"],
                 color=painted(rgb, fan))
            for share, region in zip(REGION_SHARES, regions, strict=True)
        ]  # fmt: skip
        notes = [
            fg.KeyValuePair(key=f"triangles_{k}_share", value=repr(share)) for k, share in enumerate(REGION_SHARES)
        ]
        entities.append(entity(name, forecasts.time_ns, lines=[lines], triangles=areas, metadata=notes))
    return fresh_update(entities, forecasts.time_ns)


def forecasts_of(update: Any, time_ns: int, origin: FloatArray, start: Mapping[str, FloatArray]) -> Forecasts:
    """What `forecast_scene` drew, a decoded message, of the vehicles with a known `start`."""
    drawn = [of for of in update.entities if of.id in start]
    paths = []
    for lines in (of.lines[0] for of in drawn):
        n_paths = len(lines.points) - len(lines.indices) // 2
        paths.append(origin + np.array([(p.x, p.y) for p in lines.points]).reshape(n_paths, -1, 2))
    starts = np.array([start[of.id] for of in drawn]).reshape(-1, 2)
    return Forecasts(time_ns, [of.id for of in drawn], starts, np.array(paths or np.empty((0, 1, 1, 2))))


CELL_COLOR = painted((0.45, 0.5, 0.6), 0.45)
ROSE_OPACITY = 0.65
"""What moves must stand out."""
CELLS_AT_ONCE = 8192
"""Of a map in one update, which takes 50 kB of memory for each while it is made."""


def map_scenes(primitive_map: PrimitiveMap, time_ns: int, origin: FloatArray) -> Iterator[fg.SceneUpdate]:
    """Of so many cells at a time their outlines as one entity, and a petal for each mode as another.

    The first update deletes what was drawn before; a map of up to `CELLS_AT_ONCE` cells has one.
    """
    polygons, petals = primitive_map.tessellation.polygons(), shapes.rose_petals(primitive_map)
    fastest = shapes.fastest_speed(petals)
    for i, start in enumerate(range(0, max(len(polygons), 1), CELLS_AT_ONCE)):
        end = start + CELLS_AT_ONCE
        own = [polygon for polygon in polygons[start:end] if len(polygon)]
        corners, ends = np.concatenate([np.empty((0, 2)), *own]), np.cumsum([0, *map(len, own)])
        corner, then = np.arange(len(corners)), np.arange(1, len(corners) + 1)
        then[ends[1:] - 1] = ends[:-1]  # from the last corner back to the first
        cells = line(
            SEGMENTS, points(rounded(corners - origin)), pixels=1.0, color=CELL_COLOR, height=HEIGHT["cells"],
            indices=np.column_stack([corner, then]).ravel().tolist(),
        )  # fmt: skip
        is_own = (petals.cell >= start) & (petals.cell < end)
        drawn = shapes.Petals._make(column[is_own] for column in petals)
        colors = shapes.petal_colors(drawn, fastest=fastest).reshape(-1, 4)[:, :3] / 255.0
        roses = area(
            rounded(drawn.polygon - origin), shapes.fan_triangles(drawn.polygon), height=HEIGHT["roses"],
            colors=[painted(rgb, ROSE_OPACITY) for rgb in colors.tolist()],
        )  # fmt: skip
        name = f" {i}" if i else ""
        entities = [entity(f"cells{name}", time_ns, lines=[cells]), entity(f"roses{name}", time_ns, triangles=[roses])]
        yield fresh_update(entities, time_ns) if i == 0 else fg.SceneUpdate(entities=entities)
