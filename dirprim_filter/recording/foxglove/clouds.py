"""Particles and reports as `PointCloud` messages: points of the same size on the screen at every zoom."""

from __future__ import annotations

import numpy as np
from foxglove.messages import PackedElementField, PackedElementFieldNumericType, PointCloud

from dirprim_filter.arrays import AnyArray, FloatArray
from dirprim_filter.drawing.colors import direction_color
from dirprim_filter.estimates import Particles
from dirprim_filter.recording.foxglove.scene import HEIGHT, SCENE_FRAME, pose, stamp

PARTICLE_OPACITY = 0.7
_CHANNELS = ("red", "green", "blue", "alpha")
_PLACE = [("x", "<f4"), ("y", "<f4")]
_PARTICLE = np.dtype([*_PLACE, ("weight", "<f4"), *((channel, "u1") for channel in _CHANNELS)])
_REPORT = np.dtype(_PLACE)
_FIELD_TYPE = {"f4": PackedElementFieldNumericType.Float32, "u1": PackedElementFieldNumericType.Uint8}


def particle_cloud(particles: Particles, time_ns: int, origin: FloatArray) -> PointCloud:
    """Each particle with its weight, in the colour of its direction."""
    points: AnyArray = np.zeros(len(particles), _PARTICLE)
    points["weight"] = particles.weight
    for channel, value in zip(_CHANNELS, direction_color(particles.direction).T, strict=True):
        points[channel] = value
    points["alpha"] = round(255 * PARTICLE_OPACITY)
    return _cloud(points, particles.position - origin, time_ns, height=HEIGHT["particles"])


def detection_cloud(position: FloatArray, time_ns: int, origin: FloatArray) -> PointCloud:
    """What was reported at one instant, (n, 2) metres."""
    return _cloud(np.zeros(len(position), _REPORT), position - origin, time_ns, height=HEIGHT["detections"])


def _cloud(points: AnyArray, position: FloatArray, time_ns: int, *, height: float) -> PointCloud:
    """Single precision counts from the middle of the points."""
    middle = np.round(position.mean(axis=0)) if len(position) else np.zeros(2)
    points["x"], points["y"] = (position - middle).T
    x, y = middle.tolist()
    return PointCloud(
        timestamp=stamp(time_ns), frame_id=SCENE_FRAME, pose=pose(x, y, height),
        point_stride=points.dtype.itemsize, data=points.tobytes(),
        fields=[
            PackedElementField(name=name, offset=offset, type=_FIELD_TYPE[kind.str[1:]])
            for name, (kind, offset, *_) in (points.dtype.fields or {}).items()
        ],
    )  # fmt: skip
