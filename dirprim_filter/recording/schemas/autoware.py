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

from dirprim_filter.recording.decoding.field_columns import Shredded
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.attitude import (
    ORIENTATION,
    POSITION,
    VELOCITY,
    course,
    heading,
    pose,
    rotated,
    xyz,
)
from dirprim_filter.recording.schemas.covariances import covariance, covariances
from dirprim_filter.recording.schemas.extents import extents, sizes
from dirprim_filter.recording.schemas.labels import UNTOLD, label_names, most_probable
from dirprim_filter.recording.schemas.object_rows import Family, ObservedRows, numbers, rows_of
from tessellation.arrays import AnyArray, FloatArray

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
        "stamp": Field(path=".header.stamp", kind="time"),
        "frame": Field(path=".header.frame_id", kind="name"),
        "id": Field(path=".objects[].object_id.uuid", kind="name", optional=True),
        "known": Field(path=f"{_KINEMATICS}.orientation_availability", optional=True),
        "moves": Field(path=f"{_KINEMATICS}.has_twist", optional=True),
        "unsure": Field(path=f"{_KINEMATICS}.has_position_covariance", optional=True),
        "label": Field(path=f"{_GUESSES}.label", optional=True),
        "probability": Field(path=f"{_GUESSES}.probability", optional=True),
        "shape": Field(path=".objects[].shape.type", optional=True),
        **extents(".objects[].shape.dimensions"),
        **pose(f"{_KINEMATICS}.{pose_name}.pose"),
        **covariance(f"{_KINEMATICS}.{pose_name}.covariance", n_rows=6),
        **xyz("v", f"{_KINEMATICS}.{twist_name}.twist.linear"),
    }


def _sizes(shredded: Shredded) -> FloatArray:
    kind = shredded.integers("shape", default=_BOX)[:, None]
    told = sizes(shredded)
    if (kind == _BOX).all():  # as is usual
        return told
    round_one = told[:, [0, 0, 2]]
    outlined = told * [np.nan, np.nan, 1.0]
    return np.select([kind == _BOX, kind == _CYLINDER, kind == _POLYGON], [told, round_one, outlined], np.nan)


def _objects(shredded: Shredded, _topics: AnyArray) -> ObservedRows:
    message = shredded.message_of(".objects[]")
    orientation = numbers(shredded, *ORIENTATION)
    standing = np.where(shredded.integers("known", default=2) == UNAVAILABLE, np.nan, heading(orientation))
    velocity = rotated(orientation, numbers(shredded, *VELOCITY))
    direction, speed = course(velocity, standing)
    untold = shredded.integers("moves", default=1) == 0
    label = np.full(message.size, UNTOLD)
    guesses, objects = most_probable(shredded, "label", "probability")
    label[objects] = shredded.integers("label")[guesses]
    return rows_of(
        message,
        track_id=shredded.names("id"),
        stamp_ns=shredded.times("stamp")[message],
        frame_id=shredded.names("frame")[message],
        place=numbers(shredded, *POSITION),
        direction=np.where(untold, np.nan, direction),
        speed=np.where(untold, np.nan, speed),
        climb=velocity[:, 2],
        covariance=covariances(shredded, shredded.integers("unsure", default=1) > 0),
        label=label_names(label, LABELS),
        size=_sizes(shredded),
        heading=standing,
    )


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
