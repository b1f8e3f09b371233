"""Poses without a velocity: Foxglove's and ROS 2's, one or several to a message; the orientation is the body's.

A topic of single poses is one vehicle, named after the topic. Several poses in a message have no names but their
places in it, so such a topic holds vehicles only where those places are kept from message to message.

Sources: foxglove/PoseInFrame.proto, foxglove/PosesInFrame.proto of the Foxglove SDK; geometry_msgs of ROS 2.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from dirprim_filter.recording.decoding.field_columns import Shredded
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.attitude import ORIENTATION, POSITION, heading, orientation, xyz
from dirprim_filter.recording.schemas.covariances import covariance, covariances
from dirprim_filter.recording.schemas.object_rows import Family, ObservedRows, numbers, rows_of
from tessellation.arrays import AnyArray, IntArray

_FOXGLOVE = {
    "stamp": Field(path=".timestamp", kind="time"),
    "frame": Field(path=".frame_id", kind="name"),
}  # fmt: skip
_ROS = {
    "stamp": Field(path=".header.stamp", kind="time"),
    "frame": Field(path=".header.frame_id", kind="name"),
}  # fmt: skip


def _single(
    *schemas: str, header: Mapping[str, Field], path: str, errors: Mapping[str, Field] = MappingProxyType({})
) -> Family:
    def objects(shredded: Shredded, topics: AnyArray) -> ObservedRows:
        message = shredded.message_of("")
        return rows_of(
            message,
            track_id=topics,
            stamp_ns=shredded.times("stamp"),
            frame_id=shredded.names("frame"),
            place=numbers(shredded, *POSITION),
            covariance=covariances(shredded) if errors else None,
            heading=heading(numbers(shredded, *ORIENTATION)),
        )

    wanted = {**header, **errors, **xyz("p", f"{path}.position"), **orientation(f"{path}.orientation")}
    return Family(schemas=schemas, fields=wanted, objects=objects)


def _several(*schemas: str, header: Mapping[str, Field]) -> Family:
    def objects(shredded: Shredded, topics: AnyArray) -> ObservedRows:
        message = shredded.message_of(".poses[]")
        return rows_of(
            message,
            track_id=np.strings.add(np.strings.add(topics[message], "/"), place_in_message(message).astype(np.str_)),
            stamp_ns=shredded.times("stamp")[message],
            frame_id=shredded.names("frame")[message],
            place=numbers(shredded, *POSITION),
            heading=heading(numbers(shredded, *ORIENTATION)),
        )

    wanted = {**header, **xyz("p", ".poses[].position"), **orientation(".poses[].orientation")}
    return Family(schemas=schemas, fields=wanted, objects=objects)


def place_in_message(message: IntArray) -> IntArray:
    """(n,) the number of each row among those of its message; `message` (n,) ascends."""
    return np.arange(message.size) - np.searchsorted(message, message, side="left")


POSE_IN_FRAME = _single("foxglove.PoseInFrame", "foxglove_msgs/msg/PoseInFrame", header=_FOXGLOVE, path=".pose")
POSE_STAMPED = _single("geometry_msgs/msg/PoseStamped", header=_ROS, path=".pose")
POSE_WITH_COVARIANCE = _single(
    "geometry_msgs/msg/PoseWithCovarianceStamped", header=_ROS, path=".pose.pose",
    errors=covariance(".pose.covariance", n_rows=6),
)  # fmt: skip
POSES_IN_FRAME = _several("foxglove.PosesInFrame", "foxglove_msgs/msg/PosesInFrame", header=_FOXGLOVE)
POSE_ARRAY = _several("geometry_msgs/msg/PoseArray", header=_ROS)
FAMILIES = (POSE_IN_FRAME, POSE_STAMPED, POSE_WITH_COVARIANCE, POSES_IN_FRAME, POSE_ARRAY)
