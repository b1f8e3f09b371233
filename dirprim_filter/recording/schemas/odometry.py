"""One body's own motion: `nav_msgs/Odometry` and `foxglove.Odometry`.

Both give the pose of the body's frame and its covariance in the header's frame, and the velocity in the axes of the
body. The body's frame (`base_link`) is the vehicle's name, the topic where it is empty.

Sources: https://docs.ros.org/en/api/nav_msgs/html/msg/Odometry.html; foxglove/Odometry.proto of the Foxglove SDK.
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import AnyArray
from dirprim_filter.recording.decoding.field_columns import FieldColumns
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.attitude import heading
from dirprim_filter.recording.schemas.field_groups import (
    ORIENTATION,
    covariance,
    foxglove_header,
    header,
    pose,
    xyz,
)
from dirprim_filter.recording.schemas.object_rows import Family, ObjectRows, motion, object_rows


def _objects(columns: FieldColumns, topics: AnyArray) -> ObjectRows:
    body = columns.names("id")
    moving = motion(columns, heading(columns.vectors(ORIENTATION)), in_body=True)
    return object_rows(columns, "", **moving, track_id=np.where(body == "", topics, body))


ROS = Family(
    schemas=("nav_msgs/msg/Odometry",),
    fields={
        **header(),
        "id": Field(path=".child_frame_id", kind="name"),
        "moves": Field(path=".twist", kind="presence"),
        **pose(".pose.pose"),
        **covariance(".pose.covariance", n_rows=6),
        **xyz("v", ".twist.twist.linear"),
    },
    objects=_objects,
)
FOXGLOVE = Family(
    schemas=("foxglove.Odometry", "foxglove_msgs/msg/Odometry"),
    fields={
        **foxglove_header(),
        "id": Field(path=".body_frame_id", kind="name"),
        "moves": Field(path=".linear_velocity", kind="presence"),
        **pose(".pose"),
        **covariance(".pose_covariance", n_rows=6),
        **xyz("v", ".linear_velocity"),
    },
    objects=_objects,
)
