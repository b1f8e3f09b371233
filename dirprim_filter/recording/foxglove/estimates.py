"""Tracked vehicles: body, arrow over one second of motion, 90 % region of the position, trail and name."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.drawing import shapes
from dirprim_filter.drawing.colors import track_color
from dirprim_filter.drawing.names import short_name
from dirprim_filter.drawing.sight import SURE_FROM, may_be_anywhere
from dirprim_filter.estimates import Estimates
from dirprim_filter.optional_columns import is_held
from dirprim_filter.recording.foxglove.entities import (
    HEIGHT,
    Color,
    add_line,
    encoded_points,
    fresh_update,
    paint,
    turn,
)
from dirprim_filter.recording.foxglove.frames import SCENE_FRAME
from dirprim_filter.recording.foxglove.objects import VEHICLE_SIZE
from dirprim_filter.recording.foxglove.templates import MessageTemplates, number_of
from dirprim_filter.recording.schemas.dirprim import set_time
from dirprim_filter.recording.schemas.scene_update import DRAWN_NOTE
from dirprim_filter.track_ids import as_texts

REGION_SHARE = 0.9
MIN_AXIS = 0.02
"""Metres; a thinner ellipse would not be seen."""
BODY_OPACITY, ARROW_OPACITY, REGION_OPACITY, TRAIL_OPACITY, LABEL_OPACITY = OPACITY = (0.4, 0.95, 0.25, 0.7, 0.95)
SMOOTHED_COLOR = (0.95, 0.95, 0.95)
COASTING_OPACITY = 0.35
"""Times as strong are vehicles that coast."""
HEAD_LENGTH, HEAD_SHARE = 0.9, 0.5
"""Of an arrow, metres, and of its length at most."""
LABEL_NORTH = 3.0
"""Metres; a label on the vehicle would hide what it names."""
TRAIL_S = 5.0
TRAIL_POINTS = 16
"""Of a trail: the vehicle, and where it was at as many even instants less one."""
_TRAIL_STEP_NS = int(TRAIL_S * 1e9 / (TRAIL_POINTS - 1))


class EstimatesScene:
    """The `SceneUpdate` of one instant after the other.

    Each update first deletes what earlier ones drew: a vehicle that is no longer tracked vanishes. Vehicles are drawn
    once and then filled in: a hundred of them, drawn ten times a second, would cost as much as tracking them.

    Args:
        color: red, green and blue of all vehicles; left out, each has its own, the same as in rerun.
    """

    def __init__(self, color: Color | None = None) -> None:
        self._templates = MessageTemplates(
            partial(_drawn_estimate, color), 27 + 2 * TRAIL_POINTS, field=number_of(SceneUpdate, "entities")
        )
        self._size: dict[str, FloatArray] = {}
        self._names: Sequence[str] = ()
        self._trail: FloatArray = np.empty((0, TRAIL_POINTS, 2))
        self._trail_ns: IntArray = np.empty(0, np.int64)

    def encode(self, estimates: Estimates, detections: Detections, time_ns: int, origin: FloatArray) -> bytes:
        """The update of one instant; sizes are those that were last reported of vehicles by name.

        A vehicle of unknown direction, as one that has stood from its first detection on, is drawn as long as wide.

        Args:
            estimates: of this instant.
            detections: of this instant.
            time_ns: the instant.
            origin: (2,) of the scene's frame, metres.
        """
        names = as_texts(estimates.track_id).tolist()
        self._see_sizes(detections)
        length, width, height = np.array([self._size.get(name, VEHICLE_SIZE) for name in names]).reshape(-1, 3).T
        length = np.where(estimates.direction_resultant < SURE_FROM, width, length)  # a square faces nowhere
        half_axes, angle = shapes.covariance_axes(estimates.covariance, probability=REGION_SHARE)
        minor, major = np.maximum(2.0 * half_axes, MIN_AXIS).T
        position = estimates.position - origin
        (x, y), half, half_turn = position.T, 0.5 * estimates.direction, 0.5 * angle
        facing = (np.sin(half), np.cos(half))
        head = np.minimum(HEAD_LENGTH, HEAD_SHARE * estimates.speed)
        strength = np.where(estimates.is_coasting, COASTING_OPACITY, 1.0)
        body, arrow, region, trail, label = np.array(OPACITY)[:, None] * strength
        region = np.where(may_be_anywhere(estimates), 0.0, region)
        numbers = np.column_stack(
            [
                x, y, *facing, 0.5 * height, length, width, height, body,
                x, y, *facing, estimates.speed - head, head, arrow,
                x, y, np.sin(half_turn), np.cos(half_turn), minor, major, region,
                x, y + LABEL_NORTH, label, trail, self._trails(names, position, time_ns),
            ]
        )  # fmt: skip
        shared = SceneEntity()
        set_time(shared.timestamp, time_ns)
        entities = self._templates.encode(names, numbers, shared=shared.SerializeToString())
        return fresh_update(time_ns).SerializeToString() + entities

    def _see_sizes(self, detections: Detections) -> None:
        if not is_held(detections.size):
            return
        for name, size in zip(detections.track_id.tolist(), detections.size, strict=True):
            if name != NO_ID and not np.isnan(size).all():
                self._size[name] = np.where(np.isnan(size), VEHICLE_SIZE, size)

    def _trails(self, names: Sequence[str], position: FloatArray, time_ns: int) -> FloatArray:
        """Where the vehicles were, oldest first, and are: (n, TRAIL_POINTS * 2) metres, x before y."""
        if names != self._names:
            row_of = {name: row for row, name in enumerate(self._names)}
            row = np.array([row_of.get(name, -1) for name in names], np.int64)
            known, before, since_ns = row >= 0, self._trail, self._trail_ns
            self._names, self._trail = names, np.repeat(position[:, None], TRAIL_POINTS, axis=1)
            self._trail_ns = np.full(len(names), time_ns)
            self._trail[known], self._trail_ns[known] = before[row[known]], since_ns[row[known]]
        n_steps = np.minimum((time_ns - self._trail_ns) // _TRAIL_STEP_NS, TRAIL_POINTS)
        point = np.minimum(np.arange(TRAIL_POINTS) + n_steps[:, None], TRAIL_POINTS - 1)
        self._trail = np.take_along_axis(self._trail, point[..., None], axis=1)
        self._trail[:, -1] = position
        self._trail_ns = self._trail_ns + n_steps * _TRAIL_STEP_NS
        return self._trail.reshape(len(names), TRAIL_POINTS * 2)


def _drawn_estimate(color: Color | None, name: str, numbers: Sequence[float]) -> SceneEntity:
    """A vehicle of `EstimatesScene`, with these numbers in their order there."""
    number = iter(numbers)

    def take(n: int) -> list[float]:
        return [next(number) for _ in range(n)]

    red, green, blue = color or (track_color([name])[0, :3] / 255.0).tolist()
    entity = SceneEntity(id=name, frame_id=SCENE_FRAME)
    set_time(entity.lifetime, 0)
    entity.metadata.add(key=DRAWN_NOTE, value="body")
    body = entity.cubes.add()
    x, y, sine, cosine, z = take(5)
    turn(body.pose, x, y, sine, cosine, z=z)
    body.size.x, body.size.y, body.size.z = take(3)
    paint(body.color, (red, green, blue, *take(1)))
    arrow = entity.arrows.add(shaft_diameter=0.35, head_diameter=1.0)
    turn(arrow.pose, *take(4), z=HEIGHT["arrow"])
    arrow.shaft_length, arrow.head_length = take(2)
    paint(arrow.color, (red, green, blue, *take(1)))
    region = entity.cylinders.add(bottom_scale=1.0, top_scale=1.0)
    turn(region.pose, *take(4), z=HEIGHT["region"])
    region.size.x, region.size.y = take(2)
    region.size.z = 0.02
    paint(region.color, (red, green, blue, *take(1)))
    label = entity.texts.add(billboard=True, font_size=13.0, scale_invariant=True, text=short_name(name))
    x, y = take(2)
    turn(label.pose, x, y, 0.0, 1.0, z=HEIGHT["label"])
    paint(label.color, (red, green, blue, *take(1)))
    trail = add_line(
        entity, LinePrimitive.LINE_STRIP, pixels=2.0, color=(red, green, blue, *take(1)), height=HEIGHT["trails"]
    )
    points = np.array(take(2 * TRAIL_POINTS)).reshape(TRAIL_POINTS, 2)
    trail.MergeFromString(encoded_points(LinePrimitive, points).tobytes())
    return entity
