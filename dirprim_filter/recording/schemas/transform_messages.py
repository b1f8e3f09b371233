"""Transforms between frames: `tf2_msgs/TFMessage`, `foxglove.FrameTransform` and `foxglove.FrameTransforms`.

A transform is the pose of the child's frame in the parent's. Read as objects, only where a topic is named, each
child is one, where it stands in its parent's axes.

Sources: tf2_msgs/msg/TFMessage.msg of ROS 2; foxglove/FrameTransform.proto of the Foxglove SDK.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.recording.decoding.field_columns import FieldColumns
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.field_groups import ORIENTATION, POSITION, header, orientation, xyz
from dirprim_filter.recording.schemas.object_rows import Family, ObjectRows, object_rows


class TransformRows(NamedTuple):
    """Transforms of a batch of messages."""

    message: IntArray  # (n,) ascending
    stamp_ns: IntArray  # (n,)
    parent: AnyArray  # (n,) str
    child: AnyArray  # (n,) str
    translation: FloatArray  # (n, 3) metres
    rotation: FloatArray  # (n, 4) quaternion x, y, z, w

    def of(self, rows: BoolArray | IntArray) -> TransformRows:
        """Those of a mask, or of indices."""
        columns: list[Any] = [column[rows] for column in self]
        return TransformRows(*columns)


NO_TRANSFORMS = TransformRows(
    message=np.empty(0, np.int64), stamp_ns=np.empty(0, np.int64), parent=np.empty(0, np.str_),
    child=np.empty(0, np.str_), translation=np.empty((0, 3)), rotation=np.empty((0, 4)),
)  # fmt: skip
"""None at all."""


def transforms_of(columns: FieldColumns) -> TransformRows:
    """The transforms of messages of one of `FAMILIES`; frames without the slash that names began with in ROS 1."""
    return TransformRows(
        message=columns.message_of(columns.fields["child"].table),
        stamp_ns=columns.times("stamp"),
        parent=np.strings.lstrip(columns.names("frame"), "/"),
        child=np.strings.lstrip(columns.names("child"), "/"),
        translation=columns.vectors(POSITION),
        rotation=columns.vectors(ORIENTATION),
    )


def _objects(columns: FieldColumns, _topics: AnyArray) -> ObjectRows:
    return object_rows(columns, columns.fields["child"].table, track_id=columns.names("child"), heading=None)


def _family(*schemas: str, stamp: str, parent: str, at: str, pose: str) -> Family:
    return Family(
        schemas=schemas,
        fields={
            **header(at, stamp=stamp, frame=parent),
            "child": Field(path=f"{at}.child_frame_id", kind="name"),
            **xyz("p", f"{at}{pose}.translation"),
            **orientation(f"{at}{pose}.rotation", optional=False),
        },
        objects=_objects,
    )


_FOXGLOVE = {"stamp": ".timestamp", "parent": ".parent_frame_id", "pose": ""}
FAMILIES = (
    _family(
        "tf2_msgs/msg/TFMessage",
        stamp=".header.stamp",
        parent=".header.frame_id",
        at=".transforms[]",
        pose=".transform",
    ),
    _family("foxglove.FrameTransform", "foxglove_msgs/msg/FrameTransform", at="", **_FOXGLOVE),
    _family("foxglove.FrameTransforms", "foxglove_msgs/msg/FrameTransforms", at=".transforms[]", **_FOXGLOVE),
)
