"""Estimates as ROS 2 messages in CDR, which ROS 2 plays back without this package.

`vision_msgs/Detection3DArray` has position, course, existence and its covariance; `autoware_perception_msgs/
TrackedObjects` also the speed. A size is 0, so unset, where no detection reported one; the yaw is the course.

Sources: https://github.com/ros-perception/vision_msgs, version 4; https://github.com/autowarefoundation/autoware_msgs.
"""

from __future__ import annotations

import math
import uuid
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dirprim_filter.drawing.vehicles import SURE_FROM
from dirprim_filter.estimates import Estimates
from dirprim_filter.recording.container.records import Schema
from dirprim_filter.recording.decoding.field_columns import NANOSECONDS
from dirprim_filter.recording.schemas.dirprim import MAP_FRAME
from dirprim_filter.recording.topic_names import ROS_MESSAGES, RosMessages
from dirprim_filter.track_ids import as_texts

AUTOWARE, VISION = "autoware_perception_msgs/msg", "vision_msgs/msg"
DEFINITIONS = {
    f"{VISION}/ObjectHypothesis": "string class_id\nfloat64 score",
    f"{VISION}/ObjectHypothesisWithPose": "ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose",
    f"{VISION}/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
    f"{VISION}/Detection3D": (
        "std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox3D bbox\nstring id"
    ),
    f"{VISION}/Detection3DArray": "std_msgs/Header header\nDetection3D[] detections",
    f"{AUTOWARE}/ObjectClassification": "uint8 label\nfloat32 probability",
    f"{AUTOWARE}/Shape": "uint8 type\ngeometry_msgs/Polygon footprint\ngeometry_msgs/Vector3 dimensions",
    f"{AUTOWARE}/TrackedObjectKinematics": (
        "geometry_msgs/PoseWithCovariance pose_with_covariance\nuint8 orientation_availability\n"
        "geometry_msgs/TwistWithCovariance twist_with_covariance\n"
        "geometry_msgs/AccelWithCovariance acceleration_with_covariance\nbool is_stationary"
    ),
    f"{AUTOWARE}/TrackedObject": (
        "unique_identifier_msgs/UUID object_id\nfloat32 existence_probability\nObjectClassification[] classification\n"
        "TrackedObjectKinematics kinematics\nShape shape"
    ),
    f"{AUTOWARE}/TrackedObjects": "std_msgs/Header header\nTrackedObject[] objects",
}
UNSET = (0.0, 0.0, 0.0)
LATEST_S = (1 << 31) - 1
"""January 2038: ROS 2's times hold no later second."""


class RosEstimates:
    """Encodes the estimates of one instant after the other.

    Args:
        form: of `topic_names.ROS_MESSAGES`.

    Attributes:
        schema: of the messages.
    """

    def __init__(self, form: RosMessages) -> None:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415  (0.2 s)

        self._store, self._name = get_typestore(Stores.ROS2_JAZZY), ROS_MESSAGES[form]
        for name, text in DEFINITIONS.items():
            self._store.register(get_types_from_msg(text, name))
        definition, _ = self._store.generate_msgdef(self._name, ros_version=2)
        self.schema = Schema(name=self._name, encoding="ros2msg", data=definition.encode())

    def encode(self, estimates: Estimates, sizes: Mapping[str, Sequence[float]], time_ns: int) -> bytes:
        """The message of one instant.

        Raises:
            ValueError: a time that ROS 2 cannot hold.
        """
        seconds, rest = divmod(time_ns, NANOSECONDS)
        if not 0 <= seconds <= LATEST_S:
            raise ValueError(f"expected times from 0 s to {LATEST_S} s, as ROS 2 holds no others, got {seconds} s")
        header = self._of("std_msgs/msg/Header", self._of("builtin_interfaces/msg/Time", seconds, rest), MAP_FRAME)
        make = self._detection if self._name.startswith(VISION) else self._object
        items = [
            make(header, name, self._pose(estimates, i), self._vector(sizes.get(name, UNSET)), of=estimates, i=i)
            for i, name in enumerate(as_texts(estimates.track_id).tolist())
        ]
        return bytes(self._store.serialize_cdr(self._of(self._name, header, items), self._name))

    def _of(self, name: str, *fields: Any) -> Any:
        return self._store.types[name](*fields)

    def _vector(self, values: Sequence[float]) -> Any:
        return self._of("geometry_msgs/msg/Vector3", *values)

    def _pose(self, estimates: Estimates, i: int) -> Any:
        """With its covariance; what is not estimated is 0."""
        (x, y), half = estimates.position[i].tolist(), 0.5 * float(estimates.direction[i])
        turn = self._of("geometry_msgs/msg/Quaternion", 0.0, 0.0, math.sin(half), math.cos(half))
        pose = self._of("geometry_msgs/msg/Pose", self._of("geometry_msgs/msg/Point", x, y, 0.0), turn)
        covariance = np.zeros((6, 6))
        covariance[:2, :2] = estimates.covariance[i]
        return self._of("geometry_msgs/msg/PoseWithCovariance", pose, covariance.reshape(-1))

    def _detection(self, header: Any, name: str, pose: Any, size: Any, *, of: Estimates, i: int) -> Any:
        guess = self._of(f"{VISION}/ObjectHypothesis", "", float(of.existence[i]))
        result = self._of(f"{VISION}/ObjectHypothesisWithPose", guess, pose)
        box = self._of(f"{VISION}/BoundingBox3D", pose.pose, size)
        return self._of(f"{VISION}/Detection3D", header, [result], box, name)

    def _object(self, _: Any, name: str, pose: Any, size: Any, *, of: Estimates, i: int) -> Any:
        still, unsure = self._vector(UNSET), np.zeros(36)
        along = self._vector((float(of.speed[i]), 0.0, 0.0))
        twist = self._of(
            "geometry_msgs/msg/TwistWithCovariance", self._of("geometry_msgs/msg/Twist", along, still),
            np.eye(1, 36).reshape(-1) * float(of.speed_std[i]) ** 2,
        )  # fmt: skip
        accel = self._of(
            "geometry_msgs/msg/AccelWithCovariance", self._of("geometry_msgs/msg/Accel", still, still), unsure
        )
        is_turned = 2 if of.direction_resultant[i] >= SURE_FROM else 0
        return self._of(
            f"{AUTOWARE}/TrackedObject",
            self._of("unique_identifier_msgs/msg/UUID", np.frombuffer(uuid_of(name).bytes, np.uint8)),
            float(of.existence[i]), [self._of(f"{AUTOWARE}/ObjectClassification", 0, 1.0)],
            self._of(f"{AUTOWARE}/TrackedObjectKinematics", pose, is_turned, twist, accel, False),
            self._of(f"{AUTOWARE}/Shape", 0, self._of("geometry_msgs/msg/Polygon", []), size),
        )  # fmt: skip


def uuid_of(name: str) -> uuid.UUID:
    """Of a vehicle: its id where that is one already, as of Autoware's own objects, else made of it."""
    try:
        return uuid.UUID(name)
    except ValueError:
        return uuid.uuid5(uuid.NAMESPACE_OID, name)
