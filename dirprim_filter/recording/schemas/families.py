"""The schemas that are known: ROS 2, OSI, Autoware, Foxglove and our own, by the paths of their fields.

ROS 2. `nav_msgs/Odometry` and `foxglove.Odometry` have pose and covariance in the header's frame and the velocity in
the axes of the body, whose frame is the vehicle's name. Poses have neither velocity nor name: one to a message they are
named after the topic, several after their places in it. A marker that adds or changes a cube, sphere, cylinder or mesh
is an object, `namespace/id`; of a mesh the scale is a factor, so its size is unknown. Boxes of `vision_msgs` keep their
`id` (`tracking_id` before version 3) where the detector tracks; class, covariance and confidence are those of the
result with the highest score, and so is the pose of a box that is not filled in. CARLA's bridge and radar drivers write
`derived_object_msgs`, whose twist is in the header's frame. A transform is, where its topic is named, an object: the
child, in the axes of its parent.

Autoware. The pose is that of the shape's centre. `orientation_availability` 0 is an unknown heading; a detection's
twist and covariance count where `has_twist` and `has_position_covariance` say so. A probability of 0 was not set.

Satellite fixes are degrees on WGS 84; covariances of an unknown type mean nothing. `GPSFix` has course and speed too,
and where its covariance is unknown the horizontal error at 95 %. The velocity of radar tracks is relative to the radar,
so it is not read.

Foxglove's scenes, by the convention of nuScenes logs. One entity is one object; its first cube is the object's body, or
its first upright cylinder, or its first model; other primitives (lines of a lane map, arrows, texts) are no objects, so
entities without a body are passed over. The metadata's `category` is what the object is. The size is the body's, a
model's and that of an estimate, noted as `drawn`, unknown, and the heading that of a cube.

Sources: https://docs.ros.org; https://github.com/ros-perception/vision_msgs, versions 0 to 4, and radar_msgs;
https://github.com/astuff/astuff_sensor_msgs and carla_ros_bridge; https://github.com/autowarefoundation/autoware_msgs
(before 2024 autoware_auto_perception_msgs); the Foxglove SDK's schemas; https://github.com/foxglove/nuscenes2mcap;
dirprim.proto.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dirprim_filter.arrays import BoolArray, IntArray
from dirprim_filter.columns import is_covariance
from dirprim_filter.recording.decoding.field_columns import FieldColumns
from dirprim_filter.recording.schemas import osi
from dirprim_filter.recording.schemas.family import AS_BOX, SIZE, Family, Shape, family
from dirprim_filter.recording.schemas.object_columns import STANDING_SPEED

AUTOWARE = ("unknown", "car", "truck", "bus", "trailer", "motorcycle", "bicycle", "pedestrian")
"""ObjectClassification.msg."""
DERIVED = (
    "unknown", "unknown_small", "unknown_medium", "unknown_big", "pedestrian", "bike", "car", "truck", "motorcycle",
    "other_vehicle", "barrier", "sign",
)  # fmt: skip
"""Object.msg, `classification`."""
FOOTPRINTS: dict[int, Shape] = {0: AS_BOX, 1: ((0, 0, 2), (1.0, 1.0, 1.0)), 2: ((-1, -1, 2), (1.0, 1.0, 1.0))}
"""Autoware's Shape.msg: box, cylinder (diameter and height), polygon (height)."""
_UPRIGHT: Shape = ((1, 1, 0), (2.0, 2.0, 1.0))
SOLIDS: dict[int, Shape] = {1: AS_BOX, 2: ((0, 0, 0), (2.0, 2.0, 2.0)), 3: _UPRIGHT, 4: _UPRIGHT}
"""SolidPrimitive.msg: box, sphere (radius), cylinder and cone (height and radius)."""
CHI2_95 = -2 * np.log(0.05)
"""Of an error in the plane, in variances of an axis: 95 % of the squares are less."""
BODIES, ADD = (1, 2, 3, 10), 0
"""Of Marker.msg: CUBE, SPHERE, CYLINDER, MESH_RESOURCE; and the action."""


OBSERVATIONS = family(
    "dirprim.Observations",
    "foxglove= id=.track_id[] x=.x[] y=.y[] direction=.direction[] speed=.speed[] group=.group[] length=.length[] "
    "width=.width[] height=.height[] heading=.heading[] label=.label[] cue_turn=.cue_turn[] "
    "cue_concentration=.cue_concentration[] confidence=.confidence[] cxx=.covariance_xx[] cxy=.covariance_xy[] "
    "cyy=.covariance_yy[]",
)


def _autoware(kind: str, initial: str = "") -> Family:
    pose, twist = f"@.kinematics.{initial}pose_with_covariance", f"@.kinematics.{initial}twist_with_covariance"
    return family(
        f"autoware_perception_msgs/msg/{kind} autoware_auto_perception_msgs/msg/{kind}",
        f"header=.header id=@.object_id.uuid pose={pose}.pose covariance6={pose}.covariance "
        f"velocity={twist}.twist.linear is_turned=@.kinematics.orientation_availability "
        "has_twist=@.kinematics.has_twist is_measured=@.kinematics.has_position_covariance size=@.shape.dimensions "
        "label=@.classification[].label score=@.classification[].probability shape=@.shape.type "
        "existence=@.existence_probability",
        at=".objects[]", in_body=True, labels=AUTOWARE, shapes=FOOTPRINTS,
    )  # fmt: skip


def _derived(schema: str, *, pose: str = "", twist: str = "") -> Family:
    return family(
        f"derived_object_msgs/msg/{schema}",
        f"header=.header own=@.header id=@.id label=@.classification pose=@.pose{pose} covariance6=@.pose.covariance "
        f"velocity=@.twist{twist}.linear shape=@.shape.type length=@.shape.dimensions[0] width=@.shape.dimensions[1] "
        "height=@.shape.dimensions[2]",
        at=".objects[]", labels=DERIVED, shapes=SOLIDS,
    )  # fmt: skip


def _fix(schemas: str, paths: str = "time=@.timestamp", *, at: str = "", **more: Any) -> Family:
    return family(
        schemas,
        f"{paths} longitude=@.longitude latitude=@.latitude z=@.altitude status=@.status.status "
        "is_measured=@.position_covariance_type covariance3=@.position_covariance",
        at=at, names="topic", **more,
    )  # fmt: skip


def _of_receiver(columns: FieldColumns, _: IntArray, known: dict[str, Any]) -> BoolArray:
    """Who stands has no course; and of an unknown covariance the radius within which 95 % of the errors are."""
    radius, p = columns.read("radius95"), known["covariance"]
    stated = ~is_covariance(p) & (radius > 0)
    known["covariance"] = np.where(stated[:, None, None], np.multiply.outer(radius**2 / CHI2_95, np.eye(2)), p)
    known["direction"] = np.where(known["speed"] < STANDING_SPEED, np.nan, known["direction"])
    return np.ones(radius.size, np.bool_)


def _boxes(schema: str, *, at: str = "", box: str = ".bbox") -> Family:
    return family(
        f"vision_msgs/msg/{schema}",
        f"header=.header own=@.header id=@.id|@.tracking_id pose=@{box}.center size=@{box}.size "
        "label=@.results[].hypothesis.class_id|@.results[].hypothesis.id|@.results[].id "
        "score=@.results[].hypothesis.score|@.results[].score existence=@.results[].hypothesis.score|@.results[].score "
        "covariance6=@.results[].pose.covariance guess=@.results[].pose.pose",
        at=at,
    )  # fmt: skip


def _both(name: str) -> str:
    """Foxglove's schema, and the same as a ROS 2 message."""
    return f"foxglove.{name} foxglove_msgs/msg/{name}"


ONE_BODY = (
    "entities have several cubes: the first is the body of each, the others are not read; where each is an object, "
    "--set fields=pose=.entities[].cubes[].pose reads them all"
)
_NOTES = ".entities[].metadata[]"
_ROUND = ("round.x", "round.y", "round.z")
_OTHERS = {"cylinder": (("r.x", "r.y", "r.z"), _ROUND), "model": (("m.x", "m.y", "m.z"), SIZE)}
"""Bodies in place of a cube: where each is, and its size, which a model has not, nor a cube."""
DRAWN_NOTE, ONCE_DRAWN = "drawn", "speed_mps"
"""In the metadata: the body is for the eye, its size was not measured; and what says so in our logs of before 2027."""


def _by_bodies_and_notes(columns: FieldColumns, message: IntArray, known: dict[str, Any]) -> BoolArray:
    """The size, the place and the heading of the body, and what it is; which entities have one."""
    entity, key, value = columns.parent_of(_NOTES), columns.read("key", ""), columns.read("value", "")
    is_body = columns.is_set("cube")
    if columns.is_set("second", 0).any():
        columns.notes.add(ONE_BODY)
    known["heading"] = np.where(is_body, known["heading"], np.nan)
    for body, (place, size) in _OTHERS.items():
        here = ~is_body & columns.is_set(body, 0)
        if here.any():  # rarely: most logs draw cubes alone
            known["place"][here], known["size"][here] = (columns.vectors(of)[here] for of in (place, size))
        is_body = is_body | here
    known["size"][entity[np.isin(key, (DRAWN_NOTE, ONCE_DRAWN))]] = np.nan
    is_label, known["label"] = key == "category", np.full(message.size, "", value.dtype)
    known["label"][entity[is_label]] = value[is_label]
    return is_body


SCENE_UPDATE = family(
    "foxglove.SceneUpdate foxglove_msgs/msg/SceneUpdate",
    "foxglove=@ id=@.id cube=@.cubes[0] second=@.cubes[1] cylinder=@.cylinders[0] model=@.models[0] "
    f"pose=@.cubes[0].pose size=@.cubes[0].size key={_NOTES}.key value={_NOTES}.value "
    + " ".join(
        f"r.{axis}=@.cylinders[0].pose.position.{axis} m.{axis}=@.models[0].pose.position.{axis} "
        f"round.{axis}=@.cylinders[0].size.{axis}" for axis in "xyz"
    ),
    at=".entities[]", amend=_by_bodies_and_notes,
)  # fmt: skip


MARKERS = family(
    "visualization_msgs/msg/MarkerArray",
    "header=@.header space=@.ns id=@.id type=@.type shape=@.type action=@.action pose=@.pose size=@.scale",
    at=".markers[]", only={"type": BODIES, "action": (ADD,)}, shapes=dict.fromkeys(BODIES[:3], AS_BOX),
)  # fmt: skip


KINDS: tuple[tuple[Family, ...], ...] = (
    (OBSERVATIONS,),
    (osi.ground_truth("osi3.GroundTruth", ""), osi.ground_truth("osi3.SensorView", ".global_ground_truth")),
    (osi.SENSOR_DATA,),
    (
        _autoware("TrackedObjects"), _derived("ObjectArray"),
        _derived("ObjectWithCovarianceArray", pose=".pose", twist=".twist"),
    ),
    (SCENE_UPDATE,),
    (MARKERS,),
    (
        _autoware("PredictedObjects", "initial_"),
        _autoware("DetectedObjects"),
        family(
            "radar_msgs/msg/RadarTracks",
            "header=.header id=@.uuid.uuid position=@.position covariance2=@.position_covariance size=@.size "
            "label=@.classification", at=".tracks[]", labels=("", "static", "dynamic"),
        ),
        _boxes("Detection3DArray", at=".detections[]"), _boxes("Detection3D"),
        _boxes("BoundingBox3DArray", at=".boxes[]", box=""),
    ),
    (
        family(
            "nav_msgs/msg/Odometry",
            "header=.header id=.child_frame_id axes=.child_frame_id pose=.pose.pose covariance6=.pose.covariance "
            "moves=.twist velocity=.twist.twist.linear",
            in_body=True, names="topic",
        ),
        family(
            _both("Odometry"),
            "foxglove= id=.body_frame_id axes=.body_frame_id pose=.pose covariance6=.pose_covariance "
            "moves=.linear_velocity velocity=.linear_velocity",
            in_body=True, names="topic",
        ),
    ),
    (
        family(_both("PoseInFrame"), "foxglove= pose=.pose", names="topic"),
        family("geometry_msgs/msg/PoseStamped", "header=.header pose=.pose", names="topic"),
        family(
            "geometry_msgs/msg/PoseWithCovarianceStamped",
            "header=.header pose=.pose.pose covariance6=.pose.covariance", names="topic",
        ),
        family(_both("PosesInFrame"), "foxglove= pose=.poses[]", names="place"),
        family("geometry_msgs/msg/PoseArray", "header=.header pose=.poses[]", names="place"),
    ),
    (
        _fix(
            "gps_msgs/msg/GPSFix gps_common/msg/GPSFix",
            "time=.header.stamp course_deg=.track speed=.speed radius95=.err_horz", amend=_of_receiver,
        ),
    ),
    (
        _fix(_both("LocationFix")), _fix(_both("LocationFixes"), at=".fixes[]"),
        _fix("sensor_msgs/msg/NavSatFix", "time=.header.stamp"),
    ),
)  # fmt: skip
"""Schemas of one kind hold the same; the first kind that a log has holds the most."""
_FOXGLOVE = "time=@.timestamp frame=@.parent_frame_id id=@.child_frame_id position=@.translation quaternion=@.rotation"
TRANSFORMS = (
    family(
        "tf2_msgs/msg/TFMessage",
        "header=@.header id=@.child_frame_id position=@.transform.translation quaternion=@.transform.rotation",
        at=".transforms[]",
    ),
    family(_both("FrameTransform"), _FOXGLOVE),
    family(_both("FrameTransforms"), _FOXGLOVE, at=".transforms[]"),
)  # fmt: skip
"""Of frames in each other; read as objects only where a topic is named."""
FAMILIES: dict[str, Family] = {name: one for kind in (*KINDS, TRANSFORMS) for one in kind for name in one.schemas}
"""By schema name."""
