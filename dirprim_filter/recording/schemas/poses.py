"""Poses without a velocity: Foxglove's and ROS 2's, one or several to a message; the orientation is the body's.

A topic of single poses is one vehicle, named after the topic. Several poses in a message have no names but their
places in it, so such a topic holds vehicles only where those places are kept from message to message.

Sources: foxglove/PoseInFrame.proto, foxglove/PosesInFrame.proto of the Foxglove SDK; geometry_msgs of ROS 2.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from dirprim_filter.arrays import AnyArray, IntArray
from dirprim_filter.recording.decoding.field_columns import FieldColumns
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.field_groups import covariance, foxglove_header, header, pose
from dirprim_filter.recording.schemas.object_rows import Family, ObjectRows, object_rows


def _single(
    *schemas: str, header: Mapping[str, Field], path: str, errors: Mapping[str, Field] = MappingProxyType({})
) -> Family:
    def objects(columns: FieldColumns, topics: AnyArray) -> ObjectRows:
        return object_rows(columns, "", track_id=topics)

    return Family(schemas=schemas, fields={**header, **errors, **pose(path, optional=True)}, objects=objects)


def _several(*schemas: str, header: Mapping[str, Field]) -> Family:
    def objects(columns: FieldColumns, topics: AnyArray) -> ObjectRows:
        message = columns.message_of(".poses[]")
        names = np.strings.add(np.strings.add(topics[message], "/"), place_in_message(message).astype(np.str_))
        return object_rows(columns, ".poses[]", track_id=names)

    return Family(schemas=schemas, fields={**header, **pose(".poses[]", optional=True)}, objects=objects)


def place_in_message(message: IntArray) -> IntArray:
    """(n,) the number of each row among those of its message; `message` (n,) ascends."""
    return np.arange(message.size) - np.searchsorted(message, message, side="left")


POSE_IN_FRAME = _single("foxglove.PoseInFrame", "foxglove_msgs/msg/PoseInFrame", header=foxglove_header(), path=".pose")
POSE_STAMPED = _single("geometry_msgs/msg/PoseStamped", header=header(), path=".pose")
POSE_WITH_COVARIANCE = _single(
    "geometry_msgs/msg/PoseWithCovarianceStamped", header=header(), path=".pose.pose",
    errors=covariance(".pose.covariance", n_rows=6),
)  # fmt: skip
POSES_IN_FRAME = _several("foxglove.PosesInFrame", "foxglove_msgs/msg/PosesInFrame", header=foxglove_header())
POSE_ARRAY = _several("geometry_msgs/msg/PoseArray", header=header())
FAMILIES = (POSE_IN_FRAME, POSE_STAMPED, POSE_WITH_COVARIANCE, POSES_IN_FRAME, POSE_ARRAY)
