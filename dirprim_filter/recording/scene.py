"""What Foxglove draws: vehicles, beliefs, particles and maps as `SceneUpdate` and `PointCloud` messages.

Source: the Foxglove schemas, https://docs.foxglove.dev/docs/sdk/schemas. Every sub-message is set, zeros too:
a reader that turns messages into columns takes an unset one for a null.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive

from dirprim_filter.detections import Detections
from dirprim_filter.distributions.von_mises import mean_resultant_length
from dirprim_filter.estimates import Estimates, Particles
from dirprim_filter.forecasting import REGION_SHARES, Forecasts
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording.schemas.dirprim import MAP_FRAME, set_time
from dirprim_filter.recording.schemas.scene_update import HEADING_NOTE, SIZE_NOTES
from dirprim_filter.recording.stencil import Stencils
from dirprim_filter.tracks import Tracks, as_texts
from tessellation.arrays import AnyArray, FloatArray, IntArray

VEHICLE_SIZE = (4.5, 1.9, 1.5)
"""Length, width and height of the cube that stands for a vehicle of unknown size, metres: a middling car."""
DETECTION_DIAMETER = 0.6
ELLIPSE_SCALE = 2.0 * np.sqrt(-2.0 * np.log(0.1))
"""Axes of the 90 % region of a normal law in the plane, in standard deviations (chi-squared, 2 degrees)."""
MIN_AXIS = 0.02
"""Metres; a thinner ellipse would not be seen."""
MAX_PETAL_HALF_WIDTH = np.pi / 4

VEHICLE_COLOR = (0.35, 0.6, 0.95, 0.8)
DETECTION_COLOR = (1.0, 0.85, 0.2, 1.0)
ESTIMATE_COLOR = (0.2, 0.85, 0.4, 1.0)
SMOOTHED_COLOR = (0.34, 0.71, 0.91, 1.0)
ELLIPSE_OPACITY = 0.3
COASTING_OPACITY = 0.4
"""Of a vehicle that is predicted without being measured, against one that is seen."""
FORECAST_COLOR = (0.8, 0.475, 0.655, 0.4)
REGION_COLORS = ((0.8, 0.475, 0.655, 0.18), (0.8, 0.475, 0.655, 0.35))
"""Of the wider region and of the narrower one within it: one hue, Okabe and Ito's reddish purple, told by lightness."""
REGION_HEIGHTS = (0.01, 0.02)
"""Metres: areas in one plane would flicker."""
CELL_COLOR = (0.55, 0.55, 0.55, 0.6)
PETAL_COLOR = (0.95, 0.55, 0.15, 0.9)
SLOW_TO_FAST: FloatArray = np.array([[0.27, 0.0, 0.33], [0.13, 0.57, 0.55], [0.99, 0.91, 0.15]])
"""The ends and the middle of viridis: colours of mean speeds from 0 m/s to the fastest of the map."""
PETAL_OPACITY = 0.9

_ENCODED_POINT = np.dtype(
    [("key", "u1"), ("length", "u1"), ("x_key", "u1"), ("x", "<f8"), ("y_key", "u1"), ("y", "<f8")]
)
_ENCODED_COLOR = np.dtype(
    [("key", "u1"), ("length", "u1")]
    + [(f"{channel}{of}", kind) for channel in "rgba" for of, kind in (("_key", "u1"), ("", "<f8"))]
)
_PARTICLE = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("weight", "<f4")])


def frame_transform(time_ns: int) -> FrameTransform:
    """The identity from the map to `base_link`: the 3D panel draws no frame that no transform names."""
    transform = FrameTransform(parent_frame_id=MAP_FRAME, child_frame_id="base_link")
    set_time(transform.timestamp, time_ns)
    transform.translation.SetInParent()
    transform.rotation.w = 1.0
    return transform


def tracks_scene(tracks: Tracks, rows: IntArray, time_ns: int, *, lifetime_ns: int) -> SceneUpdate:
    """A cube for each vehicle of one instant; its metadata tells direction, speed, size and heading to the last bit."""
    update = SceneUpdate()
    columns = (as_texts(tracks.track_id[rows]), tracks.position[rows], tracks.direction[rows],
               tracks.speed[rows], tracks.group[rows], tracks.size[rows], tracks.heading[rows])  # fmt: skip
    for name, (x, y), direction, speed, group, size, heading in zip(*(c.tolist() for c in columns), strict=True):
        entity = _entity(update, name, time_ns, lifetime_ns)
        entity.frame_locked = True
        entity.metadata.add(key="direction_rad", value=repr(direction))
        entity.metadata.add(key="speed_mps", value=repr(speed))
        entity.metadata.add(key="group", value=str(group))
        for key, metres in zip(SIZE_NOTES, size, strict=True):
            if not math.isnan(metres):
                entity.metadata.add(key=key, value=repr(metres))
        if not math.isnan(heading):
            entity.metadata.add(key=HEADING_NOTE, value=repr(heading))
        length, width, height = (
            middling if math.isnan(metres) else metres for metres, middling in zip(size, VEHICLE_SIZE, strict=True)
        )
        cube = entity.cubes.add()
        _place(cube.pose, x, y, height / 2, direction if math.isnan(heading) else heading)
        cube.size.x, cube.size.y, cube.size.z = length, width, height
        _paint(cube.color, VEHICLE_COLOR)
    return update


def detections_scene(detections: Detections, rows: IntArray, time_ns: int, *, lifetime_ns: int) -> SceneUpdate:
    """A small sphere for each report of one instant."""
    update = SceneUpdate()
    columns = (detections.track_id[rows], detections.position[rows])
    for name, (x, y) in zip(*(c.tolist() for c in columns), strict=True):
        sphere = _entity(update, name, time_ns, lifetime_ns).spheres.add()
        _place(sphere.pose, x, y, DETECTION_DIAMETER / 2, 0.0)
        sphere.size.x = sphere.size.y = sphere.size.z = DETECTION_DIAMETER
        _paint(sphere.color, DETECTION_COLOR)
    return update


class EstimatesScene:
    """For each vehicle an arrow over one second of its motion, the 90 % region of its position, and its id.

    A vehicle that coasts is drawn paler. Each update first deletes what earlier ones drew: a vehicle that is no longer
    tracked vanishes. Vehicles are drawn once and then filled in: a hundred of them, drawn ten times a second, would
    cost as much as tracking them.
    """

    def __init__(self, color: tuple[float, float, float, float] = ESTIMATE_COLOR) -> None:
        entities = SceneUpdate.DESCRIPTOR.fields_by_name["entities"].number
        self._stencils = Stencils(partial(_drawn_estimate, color=color), 16, field=entities)
        self._opacity = np.array([1.0, ELLIPSE_OPACITY, 1.0]) * color[3]

    def encode(self, estimates: Estimates, time_ns: int) -> bytes:
        """The `SceneUpdate` of the estimates of one instant."""
        variance, axes = np.linalg.eigh(estimates.covariance)
        minor, major = np.maximum(ELLIPSE_SCALE * np.sqrt(np.maximum(variance, 0.0)), MIN_AXIS).T
        half_turn, half = 0.5 * np.arctan2(axes[:, 1, 1], axes[:, 0, 1]), 0.5 * estimates.direction
        x, y = estimates.position.T
        opacity = np.where(estimates.is_coasting, COASTING_OPACITY, 1.0)
        numbers = np.column_stack(
            [
                estimates.speed, x, y, np.sin(half), np.cos(half),
                major, minor, x, y, np.sin(half_turn), np.cos(half_turn), x, y,
                opacity[:, None] * self._opacity,
            ]
        )  # fmt: skip
        shared = SceneEntity()
        set_time(shared.timestamp, time_ns)
        entities = self._stencils.encode(
            as_texts(estimates.track_id).tolist(), numbers, shared=shared.SerializeToString()
        )
        return _fresh_update(time_ns).SerializeToString() + entities


def _drawn_estimate(name: str, numbers: Sequence[float], *, color: tuple[float, float, float, float]) -> SceneEntity:
    """A vehicle of `EstimatesScene`: arrow by length and pose, region by axes and pose, label by place; opacities."""
    length, *arrow_pose, major, minor, x, y, sine, cosine, label_x, label_y, arrow_a, region_a, label_a = numbers
    entity = SceneEntity(id=name, frame_id=MAP_FRAME)
    set_time(entity.lifetime, 0)
    arrow = entity.arrows.add(shaft_length=length, shaft_diameter=0.3, head_length=0.8, head_diameter=0.8)
    _turn(arrow.pose, *arrow_pose, z=0.5)
    _paint(arrow.color, (*color[:3], arrow_a))
    region = entity.cylinders.add(bottom_scale=1.0, top_scale=1.0)
    _turn(region.pose, x, y, sine, cosine, z=0.05)
    region.size.x, region.size.y, region.size.z = major, minor, 0.05
    _paint(region.color, (*color[:3], region_a))
    label = entity.texts.add(billboard=True, font_size=14.0, scale_invariant=True, text=name)
    _turn(label.pose, label_x, label_y, 0.0, 1.0, z=2.0)
    _paint(label.color, (*color[:3], label_a))
    return entity


def forecast_scene(forecasts: Forecasts) -> SceneUpdate:
    """A line for each sampled path, and each vehicle's regions as areas. Earlier forecasts are deleted."""
    time_ns = forecasts.time_ns
    update = _fresh_update(time_ns)
    style = _line(LinePrimitive(), LinePrimitive.LINE_STRIP, 1.0, FORECAST_COLOR).SerializeToString()
    paths = _encoded_points(LinePrimitive, forecasts.paths)
    for name, samples, regions in zip(forecasts.track_id, paths, forecasts.regions, strict=True):
        entity = _entity(update, name, time_ns, 0)
        for path in samples:
            entity.lines.add().MergeFromString(style + path.tobytes())
        for share, region, color, height in zip(REGION_SHARES, regions, REGION_COLORS, REGION_HEIGHTS, strict=True):
            area = entity.triangles.add()
            _place(area.pose, 0.0, 0.0, height, 0.0)
            _paint(area.color, color)
            area.MergeFromString(_encoded_points(TriangleListPrimitive, region.vertex).tobytes())
            area.indices.extend(region.triangle.ravel().tolist())
            entity.metadata.add(key=f"triangles_{len(entity.triangles) - 1}_share", value=repr(share))
    return update


def map_scene(primitive_map: PrimitiveMap, time_ns: int) -> SceneUpdate:
    """The cells' outlines as one entity, and a petal for each mode, in the colour of its speed, as another."""
    update = _fresh_update(time_ns)
    cells = _line(_entity(update, "cells", time_ns, 0).lines.add(), LinePrimitive.LINE_LIST, 1.0, CELL_COLOR)
    first = 0
    for polygon in primitive_map.tessellation.polygons():
        cells.MergeFromString(_encoded_points(LinePrimitive, polygon).tobytes())
        corner = first + np.arange(len(polygon))
        cells.indices.extend(np.column_stack([corner, np.roll(corner, -1)]).ravel().tolist())
        first += len(polygon)
    roses = _entity(update, "roses", time_ns, 0).triangles.add()
    _place(roses.pose, 0.0, 0.0, 0.0, 0.0)
    _paint(roses.color, PETAL_COLOR)
    roses.MergeFromString(_encoded_points(TriangleListPrimitive, petals(primitive_map)).tobytes())
    roses.MergeFromString(_encoded_colors(np.repeat(petal_colors(primitive_map), 3, axis=0)).tobytes())
    return update


def petals(primitive_map: PrimitiveMap) -> FloatArray:
    """A triangle from the cell's centre for each of its modes. -> (n_petals, 3, 2) metres, counter-clockwise.

    It points to the mode's mean direction, is as long as the mode's weight tells, to half the cell's width,
    and as wide as the circular standard deviation sqrt(-2 log(I1(kappa) / I0(kappa))), to
    `MAX_PETAL_HALF_WIDTH`.
    The place-free modes are not drawn: they are the same everywhere.
    """
    cells = primitive_map.direction[np.arange(primitive_map.tessellation.n_cells)]
    cell, mode = _own_modes(primitive_map)
    center = primitive_map.tessellation.centers[cell]
    length = 0.5 * np.sqrt(primitive_map.tessellation.area[cell]) * cells.weight[cell, mode]
    resultant = np.maximum(mean_resultant_length(cells.concentration[cell, mode]), 1e-3)
    half_width = np.clip(np.sqrt(np.maximum(-2.0 * np.log(resultant), 0.0)), 0.02, MAX_PETAL_HALF_WIDTH)
    side = cells.mean_direction[cell, mode, None] + half_width[:, None] * np.array([-1.0, 1.0])
    tip = center[:, None] + length[:, None, None] * np.stack([np.cos(side), np.sin(side)], axis=-1)
    return np.concatenate([center[:, None], tip], axis=1)


def petal_colors(primitive_map: PrimitiveMap) -> FloatArray:
    """Red, green, blue and opacity of each petal, by the mean speed of its mode. -> (n_petals, 4) of 0 to 1."""
    speed = primitive_map.speed.mean[_own_modes(primitive_map)]
    place = (len(SLOW_TO_FAST) - 1) * speed / max(float(speed.max(initial=0.0)), 1e-9)
    rgb = [np.interp(place, np.arange(len(SLOW_TO_FAST)), channel) for channel in SLOW_TO_FAST.T]
    return np.stack([*rgb, np.full(speed.size, PETAL_OPACITY)], axis=-1)


def _own_modes(primitive_map: PrimitiveMap) -> tuple[IntArray, IntArray]:
    """Cell and number of each mode that a cell has of its own."""
    weight = primitive_map.direction.weight[:-1]
    cell, mode = np.nonzero(weight[:, : weight.shape[1] - primitive_map.n_place_free_modes] > 0)
    return cell.astype(np.int64), mode.astype(np.int64)


def particle_cloud(particles: Particles, time_ns: int) -> PointCloud:
    """Each particle as a point with its weight; single precision counts from the middle."""
    position, weight = particles.position, particles.weight
    origin = np.round(position.mean(axis=0)) if len(position) else np.zeros(2)
    points: AnyArray = np.zeros(len(position), _PARTICLE)
    points["x"], points["y"] = (position - origin).T
    points["weight"] = weight
    cloud = PointCloud(frame_id=MAP_FRAME, point_stride=_PARTICLE.itemsize, data=points.tobytes())
    set_time(cloud.timestamp, time_ns)
    _place(cloud.pose, float(origin[0]), float(origin[1]), 0.0, 0.0)
    for i, name in enumerate(_PARTICLE.names or ()):
        cloud.fields.add(name=name, offset=4 * i, type=PackedElementField.FLOAT32)
    return cloud


def _fresh_update(time_ns: int) -> SceneUpdate:
    update = SceneUpdate()
    set_time(update.deletions.add(type=SceneEntityDeletion.ALL).timestamp, time_ns)
    return update


def _entity(update: SceneUpdate, name: str, time_ns: int, lifetime_ns: int) -> SceneEntity:
    """A new entity of the update; a lifetime of 0 lasts until it is replaced or deleted."""
    entity = update.entities.add(id=name, frame_id=MAP_FRAME)
    set_time(entity.timestamp, time_ns)
    set_time(entity.lifetime, lifetime_ns)
    return entity


def _line(
    line: LinePrimitive, kind: LinePrimitive.Type.ValueType, thickness: float, color: tuple[float, ...]
) -> LinePrimitive:
    line.type, line.thickness, line.scale_invariant = kind, thickness, True
    _place(line.pose, 0.0, 0.0, 0.0, 0.0)
    _paint(line.color, color)
    return line


def _encoded_points(primitive: type[LinePrimitive] | type[TriangleListPrimitive], points: FloatArray) -> AnyArray:
    """The primitive's field `points` as it stands in a message: bytes to be merged. (..., 2) metres -> (...).

    Each is a `foxglove.Point3` of 18 bytes, in which a double follows the key of its field. Adding points one by
    one costs ten times as much, and forecasts have them by the hundred thousand.
    """
    encoded: AnyArray = np.empty(points.shape[:-1], _ENCODED_POINT)
    encoded["key"] = primitive.DESCRIPTOR.fields_by_name["points"].number << 3 | 2  # a message, its length first
    encoded["length"] = 18
    encoded["x_key"], encoded["y_key"] = 1 << 3 | 1, 2 << 3 | 1  # eight bytes each
    encoded["x"], encoded["y"] = points[..., 0], points[..., 1]
    return encoded


def _encoded_colors(rgba: FloatArray) -> AnyArray:
    """The field `colors` of triangles, likewise: a `foxglove.Color` of 36 bytes each. (n, 4) -> (n,)."""
    encoded: AnyArray = np.empty(len(rgba), _ENCODED_COLOR)
    encoded["key"] = TriangleListPrimitive.DESCRIPTOR.fields_by_name["colors"].number << 3 | 2
    encoded["length"] = 36
    for number, name in enumerate("rgba", start=1):
        encoded[f"{name}_key"] = number << 3 | 1
        encoded[name] = rgba[:, number - 1]
    return encoded


def _place(pose: Any, x: float, y: float, z: float, yaw: float) -> None:
    _turn(pose, x, y, math.sin(yaw / 2), math.cos(yaw / 2), z=z)


def _turn(pose: Any, x: float, y: float, sine: float, cosine: float, *, z: float) -> None:
    """A pose by the sine and cosine of half its yaw."""
    pose.position.SetInParent()
    pose.position.x, pose.position.y, pose.position.z = x, y, z
    pose.orientation.z, pose.orientation.w = sine, cosine


def _paint(color: Any, rgba: tuple[float, ...]) -> None:
    color.r, color.g, color.b, color.a = rgba
