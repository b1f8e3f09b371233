"""`derived_object_msgs/ObjectArray`, as CARLA's ROS bridge and radar drivers write it.

Pose and twist are both in the axes of the header's frame: the bridge turns no velocity into the body's axes. A
twist over ground; a standing object's course is its body's heading.

Source: https://github.com/astuff/astuff_sensor_msgs, derived_object_msgs; carla_ros_bridge, `TrafficParticipant`.
"""

from __future__ import annotations

from dirprim_filter.recording.decoding.field_columns import Shredded
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.attitude import ORIENTATION, POSITION, VELOCITY, course, heading, pose, xyz
from dirprim_filter.recording.schemas.covariances import covariance, covariances
from dirprim_filter.recording.schemas.extents import solid, solid_sizes
from dirprim_filter.recording.schemas.labels import UNTOLD, label_names
from dirprim_filter.recording.schemas.object_rows import Family, ObservedRows, numbers, rows_of
from tessellation.arrays import AnyArray

LABELS = (
    "unknown", "unknown_small", "unknown_medium", "unknown_big", "pedestrian", "bike", "car", "truck", "motorcycle",
    "other_vehicle", "barrier", "sign",
)  # fmt: skip
"""Object.msg, `classification`."""


def _objects(shredded: Shredded, _topics: AnyArray) -> ObservedRows:
    message = shredded.message_of(".objects[]")
    velocity = numbers(shredded, *VELOCITY)
    yaw = heading(numbers(shredded, *ORIENTATION))
    direction, speed = course(velocity, yaw)
    return rows_of(
        message,
        track_id=shredded.names("id"),
        stamp_ns=shredded.times("stamp")[message],
        frame_id=shredded.names("frame")[message],
        place=numbers(shredded, *POSITION),
        direction=direction,
        speed=speed,
        climb=velocity[:, 2],
        covariance=covariances(shredded),
        label=label_names(shredded.integers("label", default=UNTOLD), LABELS),
        size=solid_sizes(shredded),
        heading=yaw,
    )


def _family(schema: str, pose_path: str, twist_path: str) -> Family:
    return Family(
        schemas=(schema,),
        fields={
            "stamp": Field(path=".header.stamp", kind="time"),
            "frame": Field(path=".header.frame_id", kind="name"),
            "id": Field(path=".objects[].id", kind="name"),
            "label": Field(path=".objects[].classification", optional=True),
            **pose(f".objects[]{pose_path}"),
            **covariance(".objects[].pose.covariance", n_rows=6),
            **xyz("v", f".objects[]{twist_path}.linear"),
            **solid(".objects[].shape"),
        },
        objects=_objects,
    )


FAMILIES = (
    _family("derived_object_msgs/msg/ObjectArray", ".pose", ".twist"),
    _family("derived_object_msgs/msg/ObjectWithCovarianceArray", ".pose.pose", ".twist.twist"),
)
