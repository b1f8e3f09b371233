"""Tracked vehicles: body, arrow over one second of motion, 90 % region of the position, trail and name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from foxglove.messages import (
    ArrowPrimitive,
    CubePrimitive,
    CylinderPrimitive,
    KeyValuePair,
    SceneUpdate,
    TextPrimitive,
    Vector3,
)

from dirprim_filter.arrays import FloatArray
from dirprim_filter.columns import is_held
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.drawing import shapes
from dirprim_filter.drawing.colors import track_color
from dirprim_filter.drawing.names import short_name
from dirprim_filter.drawing.sight import SURE_FROM, may_be_anywhere
from dirprim_filter.estimates import Estimates
from dirprim_filter.recording.foxglove.scene import HEIGHT, STRIP, entity, fresh_update, line, painted, pose
from dirprim_filter.recording.schemas.scene_update import DRAWN_NOTE
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
TRAIL_NS, TRAIL_POINTS = 5_000_000_000, 16
"""How far back a trail goes, and by how many points it leads to the vehicle."""


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
        self._trail: dict[str, list[tuple[int, list[float]]]] = {}

    def update(self, estimates: Estimates, detections: Detections, time_ns: int, origin: FloatArray) -> SceneUpdate:
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
        half_axes, ellipse_yaw = shapes.covariance_axes(estimates.covariance, probability=REGION_SHARE)
        columns = (
            estimates.position - origin, estimates.direction, estimates.speed,
            estimates.direction_resultant >= SURE_FROM, np.maximum(2.0 * half_axes, MIN_AXIS), ellipse_yaw,
            np.where(estimates.is_coasting, COASTING_OPACITY, 1.0), may_be_anywhere(estimates),
            track_color(names)[:, :3] / 255.0,
        )  # fmt: skip
        self._trail = {
            name: self._led_on(name, place, time_ns) for name, place in zip(names, columns[0].tolist(), strict=True)
        }
        entities = []
        for name, (x, y), yaw, speed, is_turned, (minor, major), turn, strength, is_anywhere, own in zip(
            names, *(column.tolist() for column in columns), strict=True
        ):
            length, width, height = self.sizes.get(name, VEHICLE_SIZE)
            rgb, opacity = self._color or own, {part: strength * alpha for part, alpha in OPACITY.items()}
            head = min(HEAD_LENGTH, HEAD_SHARE * speed)
            entities.append(entity(
                name, time_ns, metadata=[KeyValuePair(key=DRAWN_NOTE, value="body")],
                cubes=[CubePrimitive(
                    pose=pose(x, y, height / 2, yaw), color=painted(rgb, opacity["body"]),
                    size=Vector3(x=length if is_turned else width, y=width, z=height),
                )],
                arrows=[ArrowPrimitive(
                    pose=pose(x, y, HEIGHT["arrow"], yaw), color=painted(rgb, opacity["arrow"]), shaft_diameter=0.35,
                    head_diameter=1.0, shaft_length=speed - head, head_length=head,
                )],
                cylinders=[CylinderPrimitive(
                    pose=pose(x, y, HEIGHT["region"], turn), size=Vector3(x=minor, y=major, z=0.02), bottom_scale=1.0,
                    top_scale=1.0, color=painted(rgb, 0.0 if is_anywhere else opacity["region"]),
                )],
                texts=[TextPrimitive(
                    pose=pose(x, y + LABEL_NORTH, HEIGHT["label"]), billboard=True, font_size=13.0,
                    scale_invariant=True, text=short_name(name), color=painted(rgb, opacity["label"]),
                )],
                lines=[line(
                    STRIP, np.array([place for _, place in self._trail[name]]), pixels=2.0,
                    color=painted(rgb, opacity["trail"]), height=HEIGHT["trails"],
                )],
            ))  # fmt: skip
        return fresh_update(entities, time_ns)

    def _see_sizes(self, detections: Detections) -> None:
        if not is_held(detections.size):
            return
        for name, size in zip(detections.track_id.tolist(), detections.size, strict=True):
            if name != NO_ID and not np.isnan(size).all():
                self.sizes[name] = np.where(np.isnan(size), VEHICLE_SIZE, size).tolist()

    def _led_on(self, name: str, place: list[float], time_ns: int) -> list[tuple[int, list[float]]]:
        """Where a vehicle was at even instants, oldest first, and is."""
        *kept, last = self._trail.get(name) or [(time_ns, place)]
        if not kept or last[0] - kept[-1][0] >= TRAIL_NS // TRAIL_POINTS:
            kept.append(last)
        return [*(was for was in kept if time_ns - was[0] <= TRAIL_NS), (time_ns, place)]
