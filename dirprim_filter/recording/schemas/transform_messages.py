"""Transforms between frames: `tf2_msgs/TFMessage`, `foxglove.FrameTransform` and `foxglove.FrameTransforms`.

A transform is the pose of the child's frame in the parent's. Read as objects, only where a topic is named, each
child is one, where it stands in its parent's axes.

Sources: tf2_msgs/msg/TFMessage.msg of ROS 2; foxglove/FrameTransform.proto of the Foxglove SDK.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from dirprim_filter.recording.decoding.field_columns import Shredded
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.attitude import ORIENTATION, POSITION, xyz
from dirprim_filter.recording.schemas.object_rows import Family, ObservedRows, numbers, rows_of
from tessellation.arrays import AnyArray, BoolArray, FloatArray, IntArray


class TransformRows(NamedTuple):
    """Transforms of a batch of messages."""

    message: IntArray  # (n,) ascending
    stamp_ns: IntArray  # (n,)
    parent: AnyArray  # (n,) str
    child: AnyArray  # (n,) str
    translation: FloatArray  # (n, 3) metres
    rotation: FloatArray  # (n, 4) quaternion x, y, z, w

    def of(self, rows: BoolArray) -> TransformRows:
        """Those of a mask."""
        columns: list[Any] = [column[rows] for column in self]
        return TransformRows(*columns)


NO_TRANSFORMS = TransformRows(
    message=np.empty(0, np.int64), stamp_ns=np.empty(0, np.int64), parent=np.empty(0, np.str_),
    child=np.empty(0, np.str_), translation=np.empty((0, 3)), rotation=np.empty((0, 4)),
)  # fmt: skip
"""None at all."""


def transforms_of(shredded: Shredded) -> TransformRows:
    """The transforms of messages of one of `FAMILIES`."""
    return TransformRows(
        message=shredded.message_of(shredded.fields["child"].table),
        stamp_ns=shredded.times("stamp"),
        parent=shredded.names("frame"),
        child=shredded.names("child"),
        translation=numbers(shredded, *POSITION),
        rotation=numbers(shredded, *ORIENTATION),
    )


def _objects(shredded: Shredded, _topics: AnyArray) -> ObservedRows:
    rows = transforms_of(shredded)
    return rows_of(
        rows.message, track_id=rows.child, stamp_ns=rows.stamp_ns, frame_id=rows.parent, place=rows.translation
    )


def _family(*schemas: str, stamp: str, parent: str, at: str, pose: str) -> Family:
    return Family(
        schemas=schemas,
        fields={
            "stamp": Field(path=f"{at}{stamp}", kind="time"),
            "frame": Field(path=f"{at}{parent}", kind="name"),
            "child": Field(path=f"{at}.child_frame_id", kind="name"),
            **xyz("p", f"{at}{pose}.translation"),
            **{f"q.{axis}": Field(path=f"{at}{pose}.rotation.{axis}") for axis in "xyzw"},
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
