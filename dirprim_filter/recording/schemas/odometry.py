"""One body's own motion: `nav_msgs/Odometry` and `foxglove.Odometry`.

Both give the pose of the body's frame and its covariance in the header's frame, and the velocity in the axes of the
body. The body's frame (`base_link`) is the vehicle's name, the topic where it is not told.

Sources: https://docs.ros.org/en/api/nav_msgs/html/msg/Odometry.html; foxglove/Odometry.proto of the Foxglove SDK.
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
from dirprim_filter.recording.schemas.object_rows import Family, ObservedRows, numbers, rows_of
from tessellation.arrays import AnyArray


def _objects(shredded: Shredded, topics: AnyArray) -> ObservedRows:
    body = shredded.names("id")
    orientation = numbers(shredded, *ORIENTATION)
    velocity = rotated(orientation, numbers(shredded, *VELOCITY))
    velocity[~shredded.marks("moves")] = np.nan
    yaw = heading(orientation)
    direction, speed = course(velocity, yaw)
    return rows_of(
        shredded.message_of(""),
        track_id=np.where(body == "", topics, body),
        stamp_ns=shredded.times("stamp"),
        frame_id=shredded.names("frame"),
        place=numbers(shredded, *POSITION),
        direction=direction,
        speed=speed,
        climb=velocity[:, 2],
        covariance=covariances(shredded),
        heading=yaw,
    )


ROS = Family(
    schemas=("nav_msgs/msg/Odometry",),
    fields={
        "stamp": Field(path=".header.stamp", kind="time"),
        "frame": Field(path=".header.frame_id", kind="name"),
        "id": Field(path=".child_frame_id", kind="name"),
        "moves": Field(path=".twist", kind="mark"),
        **pose(".pose.pose"),
        **covariance(".pose.covariance", n_rows=6),
        **xyz("v", ".twist.twist.linear"),
    },
    objects=_objects,
)
FOXGLOVE = Family(
    schemas=("foxglove.Odometry", "foxglove_msgs/msg/Odometry"),
    fields={
        "stamp": Field(path=".timestamp", kind="time"),
        "frame": Field(path=".frame_id", kind="name"),
        "id": Field(path=".body_frame_id", kind="name"),
        "moves": Field(path=".linear_velocity", kind="mark"),
        **pose(".pose"),
        **covariance(".pose_covariance", n_rows=6),
        **xyz("v", ".linear_velocity"),
    },
    objects=_objects,
)
