"""The schemas that are known: ROS 2, OSI, Autoware, Foxglove and our own, by the paths of their fields.

ROS 2. `nav_msgs/Odometry` and `foxglove.Odometry` have pose and covariance in the header's frame and the velocity in
the axes of the body, whose frame is the vehicle's name. Poses have neither velocity nor name: one to a message they
are named after the topic, several after their places in it. A marker that adds or changes a cube, sphere, cylinder or
mesh is an object, `namespace/id`; of a mesh the scale is a factor, so its size is unknown. Boxes of `vision_msgs`
keep their `id` where the detector tracks. CARLA's bridge and radar drivers write `derived_object_msgs`, whose twist
is in the header's frame. A transform is, where its topic is named, an object: the child, in the axes of its parent.

Autoware. The pose is that of the shape's centre. `orientation_availability` 0 is an unknown heading; a detection's
twist and covariance count where `has_twist` and `has_position_covariance` say so.

OSI. The base is the centre of the bounding box in the global frame, x east, y north; the velocity is in the same
frame. A sensor view's objects are those of its global ground truth.

Satellite fixes are degrees on WGS 84; covariances of an unknown type mean nothing.

Sources: https://docs.ros.org; https://github.com/ros-perception/vision_msgs, version 4;
https://github.com/astuff/astuff_sensor_msgs and carla_ros_bridge; https://github.com/autowarefoundation/autoware_msgs
(before 2024 autoware_auto_perception_msgs); ASAM OSI 3.7, osi_object.proto; the Foxglove SDK's schemas;
dirprim.proto.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dirprim_filter.arrays import BoolArray, IntArray
from dirprim_filter.recording.decoding.field_columns import FieldColumns
from dirprim_filter.recording.schemas.family import AS_BOX, UNLABELLED, Family, Shape, family, label_names
from dirprim_filter.recording.schemas.osi_sensor_data import SENSOR_DATA
from dirprim_filter.recording.schemas.scene_update import SCENE_UPDATE

AUTOWARE = ("unknown", "car", "truck", "bus", "trailer", "motorcycle", "bicycle", "pedestrian")
"""ObjectClassification.msg."""
DERIVED = (
    "unknown", "unknown_small", "unknown_medium", "unknown_big", "pedestrian", "bike", "car", "truck", "motorcycle",
    "other_vehicle", "barrier", "sign",
)  # fmt: skip
"""Object.msg, `classification`."""
OSI = ("unknown", "other", "vehicle", "pedestrian", "animal")
"""`MovingObject.Type`."""
OSI_VEHICLE, OSI_LEFT, OSI_RIGHT = 2, 3, 4
"""Of the types; and `VehicleClassification.LightState.IndicatorState`."""
OSI_VEHICLES = (
    "vehicle", "vehicle", "small_car", "compact_car", "car", "luxury_car", "delivery_van", "heavy_truck",
    "semitrailer", "trailer", "motorbike", "bicycle", "bus", "tram", "train", "wheelchair", "semitractor",
    "standup_scooter",
)  # fmt: skip
"""`MovingObject.VehicleClassification.Type`; of those that are unknown or other no more is known than of the object."""
FOOTPRINTS: dict[int, Shape] = {0: AS_BOX, 1: ((0, 0, 2), (1.0, 1.0, 1.0)), 2: ((-1, -1, 2), (1.0, 1.0, 1.0))}
"""Autoware's Shape.msg: box, cylinder (diameter and height), polygon (height)."""
_UPRIGHT: Shape = ((1, 1, 0), (2.0, 2.0, 1.0))
SOLIDS: dict[int, Shape] = {1: AS_BOX, 2: ((0, 0, 0), (2.0, 2.0, 2.0)), 3: _UPRIGHT, 4: _UPRIGHT}
"""SolidPrimitive.msg: box, sphere (radius), cylinder and cone (height and radius)."""
BODIES, ADD = (1, 2, 3, 10), 0
"""Of Marker.msg: CUBE, SPHERE, CYLINDER, MESH_RESOURCE; and the action."""


def _autoware(kind: str, pose: str = "pose_with_covariance", twist: str = "twist_with_covariance") -> Family:
    moves = ".objects[].kinematics"
    return family(
        f"autoware_perception_msgs/msg/{kind}", f"autoware_auto_perception_msgs/msg/{kind}",
        paths={
            "header": ".header", "id": ".objects[].object_id.uuid", "pose": f"{moves}.{pose}.pose",
            "covariance6": f"{moves}.{pose}.covariance", "velocity": f"{moves}.{twist}.twist.linear",
            "is_turned": f"{moves}.orientation_availability", "has_twist": f"{moves}.has_twist",
            "is_measured": f"{moves}.has_position_covariance", "label": ".objects[].classification[].label",
            "score": ".objects[].classification[].probability", "shape": ".objects[].shape.type",
            "size": ".objects[].shape.dimensions",
        },
        in_body=True, labels=AUTOWARE, shapes=FOOTPRINTS,
    )  # fmt: skip


def _derived(schema: str, pose: str, twist: str) -> Family:
    solid = ".objects[].shape.dimensions"
    return family(
        schema,
        paths={
            "header": ".header", "id": ".objects[].id", "label": ".objects[].classification",
            "pose": f".objects[]{pose}", "covariance6": ".objects[].pose.covariance",
            "velocity": f".objects[]{twist}.linear", "shape": ".objects[].shape.type", "length": f"{solid}[0]",
            "width": f"{solid}[1]", "height": f"{solid}[2]",
        },
        labels=DERIVED, shapes=SOLIDS,
    )  # fmt: skip


def _osi_signs(columns: FieldColumns, _: IntArray, known: dict[str, Any]) -> BoolArray:
    """What a vehicle is, and signals; an object that stands, of unknown yaw, has the course of what little it moves."""
    from dirprim_filter.primitives.cues import signalled  # noqa: PLC0415 - logs without lights do without

    kind = columns.integers("type", default=UNLABELLED)
    vehicle = label_names(columns.integers("vehicle"), OSI_VEHICLES)
    known["label"] = np.where(kind == OSI_VEHICLE, vehicle, label_names(kind, OSI))
    light = columns.integers("indicator")
    known["cue"] = signalled(light == OSI_LEFT, light == OSI_RIGHT)
    drift = np.arctan2(columns.numbers("vy"), columns.numbers("vx"))
    stands = np.isnan(known["direction"]) & np.isfinite(known["speed"])
    known["direction"] = np.where(stands, drift, known["direction"])
    return columns.is_set("placed")


def _osi(schema: str, truth: str) -> Family:
    movers = f"{truth}.moving_object[]"
    base, vehicle = f"{movers}.base", f"{movers}.vehicle_classification"
    return family(
        schema,
        paths={
            "time": f"{truth}.timestamp", "id": f"{movers}.id.value", "type": f"{movers}.type",
            "vehicle": f"{vehicle}.type", "indicator": f"{vehicle}.light_state.indicator_state",
            "placed": f"{base}.position", "position": f"{base}.position", "moves": f"{base}.velocity",
            "velocity": f"{base}.velocity", "turned": f"{base}.orientation", "heading": f"{base}.orientation.yaw",
            "length": f"{base}.dimension.length", "width": f"{base}.dimension.width",
            "height": f"{base}.dimension.height",
        },
        amend=_osi_signs,
    )  # fmt: skip


def _fix(*schemas: str, at: str = "", time: str = ".timestamp") -> Family:
    return family(
        *schemas,
        paths={
            "time": f"{at}{time}", "longitude": f"{at}.longitude", "latitude": f"{at}.latitude",
            "z": f"{at}.altitude", "status": f"{at}.status.status",
            "is_measured": f"{at}.position_covariance_type", "covariance3": f"{at}.position_covariance",
        },
        names="topic",
    )  # fmt: skip


def _transforms(*schemas: str, at: str, time: str, parent: str, pose: str) -> Family:
    paths = {
        "time": f"{at}{time}", "frame": f"{at}{parent}", "id": f"{at}.child_frame_id",
        "position": f"{at}{pose}.translation", "quaternion": f"{at}{pose}.rotation",
    }  # fmt: skip
    return family(*schemas, paths=paths)


def _both(name: str) -> tuple[str, str]:
    """Foxglove's schema, and the same as a ROS 2 message."""
    return f"foxglove.{name}", f"foxglove_msgs/msg/{name}"


_PARALLEL = (
    "x", "y", "direction", "speed", "group", "length", "width", "height", "heading", "cue_turn", "cue_concentration",
    "label",
)  # fmt: skip
OBSERVATIONS = family(
    "dirprim.Observations",
    paths={
        "foxglove": "", "id": ".track_id[]", "cxx": ".covariance_xx[]", "cxy": ".covariance_xy[]",
        "cyy": ".covariance_yy[]", **{name: f".{name}[]" for name in _PARALLEL},
    },
)  # fmt: skip

KINDS: tuple[tuple[Family, ...], ...] = (
    (OBSERVATIONS,),
    (_osi("osi3.GroundTruth", ""), _osi("osi3.SensorView", ".global_ground_truth")),
    (SENSOR_DATA,),
    (
        _autoware("TrackedObjects"),
        _derived("derived_object_msgs/msg/ObjectArray", ".pose", ".twist"),
        _derived("derived_object_msgs/msg/ObjectWithCovarianceArray", ".pose.pose", ".twist.twist"),
    ),
    (SCENE_UPDATE,),
    (
        family(
            "visualization_msgs/msg/MarkerArray",
            paths={
                "header": ".markers[].header", "space": ".markers[].ns", "id": ".markers[].id",
                "type": ".markers[].type", "shape": ".markers[].type", "action": ".markers[].action",
                "pose": ".markers[].pose", "size": ".markers[].scale",
            },
            only={"type": BODIES, "action": (ADD,)}, shapes=dict.fromkeys(BODIES[:3], AS_BOX),
        ),
    ),
    (
        _autoware("PredictedObjects", "initial_pose_with_covariance", "initial_twist_with_covariance"),
        _autoware("DetectedObjects"),
        family(
            "vision_msgs/msg/Detection3DArray",
            paths={
                "header": ".header", "id": ".detections[].id", "pose": ".detections[].bbox.center",
                "size": ".detections[].bbox.size", "label": ".detections[].results[].hypothesis.class_id",
                "score": ".detections[].results[].hypothesis.score",
            },
        ),
    ),
    (
        family(
            "nav_msgs/msg/Odometry",
            paths={
                "header": ".header", "id": ".child_frame_id", "pose": ".pose.pose", "covariance6": ".pose.covariance",
                "moves": ".twist", "velocity": ".twist.twist.linear",
            },
            in_body=True, names="topic",
        ),
        family(
            *_both("Odometry"),
            paths={
                "foxglove": "", "id": ".body_frame_id", "pose": ".pose", "covariance6": ".pose_covariance",
                "moves": ".linear_velocity", "velocity": ".linear_velocity",
            },
            in_body=True, names="topic",
        ),
    ),
    (
        family(*_both("PoseInFrame"), paths={"foxglove": "", "pose": ".pose"}, names="topic"),
        family("geometry_msgs/msg/PoseStamped", paths={"header": ".header", "pose": ".pose"}, names="topic"),
        family(
            "geometry_msgs/msg/PoseWithCovarianceStamped",
            paths={"header": ".header", "pose": ".pose.pose", "covariance6": ".pose.covariance"}, names="topic",
        ),
        family(*_both("PosesInFrame"), paths={"foxglove": "", "pose": ".poses[]"}, names="place"),
        family("geometry_msgs/msg/PoseArray", paths={"header": ".header", "pose": ".poses[]"}, names="place"),
    ),
    (
        _fix(*_both("LocationFix")),
        _fix(*_both("LocationFixes"), at=".fixes[]"),
        _fix("sensor_msgs/msg/NavSatFix", time=".header.stamp"),
    ),
)  # fmt: skip
"""Schemas of one kind hold the same; the first kind that a log has holds the most."""
_FOXGLOVE = {"time": ".timestamp", "parent": ".parent_frame_id", "pose": ""}
TRANSFORMS = (
    _transforms(
        "tf2_msgs/msg/TFMessage", at=".transforms[]", time=".header.stamp", parent=".header.frame_id", pose=".transform"
    ),
    _transforms(*_both("FrameTransform"), at="", **_FOXGLOVE),
    _transforms(*_both("FrameTransforms"), at=".transforms[]", **_FOXGLOVE),
)
"""Of frames in each other; read as objects only where a topic is named."""
FAMILIES: dict[str, Family] = {name: one for kind in (*KINDS, TRANSFORMS) for one in kind for name in one.schemas}
"""By schema name."""
