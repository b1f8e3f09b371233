"""The frame that scenes are drawn in: `scene`, in the middle of what is drawn, without rotation in `map`.

The camera of the layout stands on it, wherever in the map that is. Viewers compute in single precision, which at
coordinates of a whole country is half a metre: from the middle of the scene it is a fraction of a millimetre.
"""

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform

from dirprim_filter.arrays import FloatArray
from dirprim_filter.drawing import shapes
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording.schemas.dirprim import MAP_FRAME, set_time

SCENE_FRAME = "scene"
BUSY_SHARE = 0.75
"""Of the traffic: the camera looks at the square that holds it."""


def scene_transform(time_ns: int, origin: FloatArray) -> FrameTransform:
    """Where `scene` is in `map`: (2,) metres. Viewers draw no frame that no transform names."""
    transform = FrameTransform(parent_frame_id=MAP_FRAME, child_frame_id=SCENE_FRAME)
    set_time(transform.timestamp, time_ns)
    transform.translation.SetInParent()
    transform.translation.x, transform.translation.y = origin.tolist()
    transform.rotation.w = 1.0
    return transform


def view_of(primitive_map: PrimitiveMap) -> FloatArray:
    """The part of a map to look at: its south-west and north-east corner, (2, 2) metres."""
    return shapes.busy_box(primitive_map, share=BUSY_SHARE)


def origin_of(points: FloatArray) -> FloatArray:
    """The middle of the box around points, (n, 2), in whole metres; of no point (0, 0). -> (2,)."""
    points = points.reshape(-1, 2)
    if not len(points):
        return np.zeros(2)
    return np.asarray(np.round(0.5 * (points.min(axis=0) + points.max(axis=0))))
