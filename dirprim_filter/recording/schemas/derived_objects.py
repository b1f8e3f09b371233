"""`derived_object_msgs/ObjectArray`, as CARLA's ROS bridge and radar drivers write it.

Pose and twist are both in the axes of the header's frame: the bridge turns no velocity into the body's axes. A
twist over ground; a standing object's course is its body's heading.

Source: https://github.com/astuff/astuff_sensor_msgs, derived_object_msgs; carla_ros_bridge, `TrafficParticipant`.
"""

from __future__ import annotations

from dirprim_filter.arrays import AnyArray
from dirprim_filter.recording.decoding.field_columns import FieldColumns
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.attitude import heading
from dirprim_filter.recording.schemas.field_groups import (
    ORIENTATION,
    UNLABELLED,
    covariance,
    header,
    label_names,
    pose,
    solid,
    solid_sizes,
    xyz,
)
from dirprim_filter.recording.schemas.object_rows import Family, ObjectRows, motion, object_rows

LABELS = (
    "unknown", "unknown_small", "unknown_medium", "unknown_big", "pedestrian", "bike", "car", "truck", "motorcycle",
    "other_vehicle", "barrier", "sign",
)  # fmt: skip
"""Object.msg, `classification`."""


def _objects(columns: FieldColumns, _topics: AnyArray) -> ObjectRows:
    label = label_names(columns.integers("label", default=UNLABELLED), LABELS)
    moving = motion(columns, heading(columns.vectors(ORIENTATION)))
    return object_rows(columns, ".objects[]", **moving, label=label, size=solid_sizes(columns))


def _family(schema: str, pose_path: str, twist_path: str) -> Family:
    return Family(
        schemas=(schema,),
        fields={
            **header(),
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
