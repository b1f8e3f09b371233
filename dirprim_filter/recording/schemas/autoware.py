"""Autoware's perceived objects: tracked, detected and predicted.

The pose is that of the shape's centre in the header's frame, and so is its covariance. The twist is over ground and in
the axes of the object's body. `orientation_availability` says whether the orientation is measured (2), measured up to
front and back (1), or not at all (0); a body whose orientation is not measured has no heading while it stands. A
detection has no name; it has a twist only where `has_twist` says so, and a covariance where `has_position_covariance`
does. Of several classifications the most probable counts. The dimensions are length, width and height of a bounding
box, diameter and height of a cylinder; of a polygon only the height.

Source: https://github.com/autowarefoundation/autoware_msgs, autoware_perception_msgs; the names before 2024 were
autoware_auto_perception_msgs.
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray
from dirprim_filter.recording.decoding.field_columns import FieldColumns
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.attitude import heading
from dirprim_filter.recording.schemas.field_groups import (
    ORIENTATION,
    SIZE,
    UNLABELLED,
    covariance,
    covariances,
    extents,
    header,
    label_names,
    most_probable,
    pose,
    xyz,
)
from dirprim_filter.recording.schemas.object_rows import Family, ObjectRows, motion, object_rows

_PACKAGES = ("autoware_perception_msgs", "autoware_auto_perception_msgs")
UNAVAILABLE = 0
_KINEMATICS = ".objects[].kinematics"
_GUESSES = ".objects[].classification[]"
LABELS = ("unknown", "car", "truck", "bus", "trailer", "motorcycle", "bicycle", "pedestrian")
"""ObjectClassification.msg."""
_BOX, _CYLINDER, _POLYGON = 0, 1, 2
"""Shape.msg, `type`."""


def _fields(pose_name: str, twist_name: str) -> dict[str, Field]:
    return {
        **header(),
        "id": Field(path=".objects[].object_id.uuid", kind="name", optional=True),
        "known": Field(path=f"{_KINEMATICS}.orientation_availability", optional=True),
        "has_twist": Field(path=f"{_KINEMATICS}.has_twist", optional=True),
        "unsure": Field(path=f"{_KINEMATICS}.has_position_covariance", optional=True),
        "label": Field(path=f"{_GUESSES}.label", optional=True),
        "probability": Field(path=f"{_GUESSES}.probability", optional=True),
        "shape": Field(path=".objects[].shape.type", optional=True),
        **extents(".objects[].shape.dimensions"),
        **pose(f"{_KINEMATICS}.{pose_name}.pose"),
        **covariance(f"{_KINEMATICS}.{pose_name}.covariance", n_rows=6),
        **xyz("v", f"{_KINEMATICS}.{twist_name}.twist.linear"),
    }


def _sizes(columns: FieldColumns) -> FloatArray:
    kind = columns.integers("shape", default=_BOX)[:, None]
    dimensions = columns.vectors(SIZE)
    if (kind == _BOX).all():  # as is usual
        return dimensions
    round_one = dimensions[:, [0, 0, 2]]
    outlined = dimensions * [np.nan, np.nan, 1.0]
    return np.select([kind == _BOX, kind == _CYLINDER, kind == _POLYGON], [dimensions, round_one, outlined], np.nan)


def _objects(columns: FieldColumns, _topics: AnyArray) -> ObjectRows:
    is_turned = columns.integers("known", default=2) != UNAVAILABLE
    yaw = np.where(is_turned, heading(columns.vectors(ORIENTATION)), np.nan)
    moving = motion(columns, yaw, in_body=True)
    has_twist = columns.integers("has_twist", default=1) != 0
    moving |= {name: np.where(has_twist, moving[name], np.nan) for name in ("direction", "speed")}
    label = np.full(yaw.size, UNLABELLED)
    guesses, objects = most_probable(columns, "label", "probability")
    label[objects] = columns.integers("label")[guesses]
    return object_rows(
        columns, ".objects[]", **moving, heading=yaw, label=label_names(label, LABELS), size=_sizes(columns),
        covariance=covariances(columns, columns.integers("unsure", default=1) > 0),
    )  # fmt: skip


TRACKED = Family(
    schemas=tuple(f"{package}/msg/TrackedObjects" for package in _PACKAGES),
    fields=_fields("pose_with_covariance", "twist_with_covariance"),
    objects=_objects,
)
DETECTED = Family(
    schemas=tuple(f"{package}/msg/DetectedObjects" for package in _PACKAGES),
    fields=TRACKED.fields,
    objects=_objects,
)
PREDICTED = Family(
    schemas=tuple(f"{package}/msg/PredictedObjects" for package in _PACKAGES),
    fields=_fields("initial_pose_with_covariance", "initial_twist_with_covariance"),
    objects=_objects,
)
