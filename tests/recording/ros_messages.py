"""ROS 2 definitions of the messages that tests write, and a log of them by independent writers.

Those of ROS itself come with rosbags. Sources of the others: vision_msgs, autoware_msgs, astuff_sensor_msgs and the
Foxglove SDK; comments and what no test fills are left out where the layout of the rest does not depend on it.
"""

from typing import Any

from mcap_ros2.writer import Writer
from rosbags.typesys import Stores, get_typestore

BASIC = {
    "visualization_msgs/Marker": (
        "std_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\ngeometry_msgs/Pose pose\n"
        "geometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\nbuiltin_interfaces/Duration lifetime\n"
        "bool frame_locked\ngeometry_msgs/Point[] points\nstd_msgs/ColorRGBA[] colors\nstring text\n"
        "string mesh_resource\nbool mesh_use_embedded_materials"
    ),
    "vision_msgs/ObjectHypothesis": "string class_id\nfloat64 score",
    "vision_msgs/ObjectHypothesisWithPose": "ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose",
    "vision_msgs/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
    "vision_msgs/Detection3D": (
        "std_msgs/Header header\nObjectHypothesisWithPose[] results\nvision_msgs/BoundingBox3D bbox\nstring id"
    ),
    "vision_msgs/Detection3DArray": "std_msgs/Header header\nvision_msgs/Detection3D[] detections",
    "derived_object_msgs/Object": (
        "std_msgs/Header header\nuint32 id\nuint8 detection_level\nbool object_classified\ngeometry_msgs/Pose pose\n"
        "geometry_msgs/Twist twist\ngeometry_msgs/Accel accel\ngeometry_msgs/Polygon polygon\n"
        "shape_msgs/SolidPrimitive shape\nuint8 classification\nuint8 classification_certainty\n"
        "uint32 classification_age"
    ),
    "derived_object_msgs/ObjectArray": "std_msgs/Header header\nderived_object_msgs/Object[] objects",
    "foxglove_msgs/PoseInFrame": "builtin_interfaces/Time timestamp\nstring frame_id\ngeometry_msgs/Pose pose",
    "foxglove_msgs/PosesInFrame": "builtin_interfaces/Time timestamp\nstring frame_id\ngeometry_msgs/Pose[] poses",
    "foxglove_msgs/Odometry": (
        "builtin_interfaces/Time timestamp\nstring frame_id\nstring body_frame_id\ngeometry_msgs/Pose pose\n"
        "geometry_msgs/Vector3 linear_velocity\ngeometry_msgs/Vector3 angular_velocity"
    ),
    "foxglove_msgs/FrameTransform": (
        "builtin_interfaces/Time timestamp\nstring parent_frame_id\nstring child_frame_id\n"
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation"
    ),
    "foxglove_msgs/LocationFix": (
        "builtin_interfaces/Time timestamp\nstring frame_id\nfloat64 latitude\nfloat64 longitude\nfloat64 altitude\n"
        "float64[9] position_covariance\nuint8 position_covariance_type"
    ),
    "foxglove_msgs/KeyValuePair": "string key\nstring value",
    "foxglove_msgs/CubePrimitive": ("geometry_msgs/Pose pose\ngeometry_msgs/Vector3 size\nstd_msgs/ColorRGBA color"),
    "foxglove_msgs/SceneEntity": (  # what no test fills is an array of something
        "builtin_interfaces/Time timestamp\nstring frame_id\nstring id\nbuiltin_interfaces/Duration lifetime\n"
        "bool frame_locked\nKeyValuePair[] metadata\nKeyValuePair[] arrows\nCubePrimitive[] cubes\n"
        "KeyValuePair[] spheres\nKeyValuePair[] cylinders\nKeyValuePair[] lines\nKeyValuePair[] triangles\n"
        "KeyValuePair[] texts\nKeyValuePair[] models"
    ),
    "foxglove_msgs/SceneUpdate": "KeyValuePair[] deletions\nSceneEntity[] entities",
    "acme/Detection": "uint8 kind\nfloat32[2] place\nstring id",
    "acme/Detections": "string frame\nacme/Detection[] detections",
}


def autoware(package):
    """Definitions of Autoware's perception messages, by the name of their package."""
    p = package
    return {
        f"{p}/ObjectClassification": "uint8 UNKNOWN = 0\nuint8 CAR = 1\nuint8 label\nfloat32 probability",
        f"{p}/Shape": "uint8 type\ngeometry_msgs/Polygon footprint\ngeometry_msgs/Vector3 dimensions",
        f"{p}/TrackedObjectKinematics": (
            "uint8 UNAVAILABLE=0\nuint8 SIGN_UNKNOWN=1\nuint8 AVAILABLE=2\n"
            "geometry_msgs/PoseWithCovariance pose_with_covariance\nuint8 orientation_availability\n"
            "geometry_msgs/TwistWithCovariance twist_with_covariance\n"
            "geometry_msgs/AccelWithCovariance acceleration_with_covariance\nbool is_stationary"
        ),
        f"{p}/TrackedObject": (
            f"unique_identifier_msgs/UUID object_id\nfloat32 existence_probability\n"
            f"{p}/ObjectClassification[] classification\n{p}/TrackedObjectKinematics kinematics\n{p}/Shape shape"
        ),
        f"{p}/TrackedObjects": f"std_msgs/Header header\n{p}/TrackedObject[] objects",
        f"{p}/DetectedObjectKinematics": (
            "geometry_msgs/PoseWithCovariance pose_with_covariance\nbool has_position_covariance\n"
            "uint8 orientation_availability\ngeometry_msgs/TwistWithCovariance twist_with_covariance\n"
            "bool has_twist\nbool has_twist_covariance"
        ),
        f"{p}/DetectedObject": (
            f"float32 existence_probability\n{p}/ObjectClassification[] classification\n"
            f"{p}/DetectedObjectKinematics kinematics\n{p}/Shape shape"
        ),
        f"{p}/DetectedObjects": f"std_msgs/Header header\n{p}/DetectedObject[] objects",
    }


DEFINITIONS = BASIC | autoware("autoware_perception_msgs") | autoware("autoware_auto_perception_msgs")
_PLAIN = {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)} | {
    "bool", "byte", "char", "float32", "float64", "string", "time", "duration",
}  # fmt: skip


ROS = get_typestore(Stores.ROS2_JAZZY)


def definition(name):
    """Of package/Name alone."""
    if name in DEFINITIONS:
        return DEFINITIONS[name]
    return ROS.generate_msgdef(name.replace("/", "/msg/"), ros_version=2)[0].partition("=" * 80)[0].rstrip()


def full_definition(name):
    """The ros2msg definition of package/Name with all that it depends on, as rosbag2 writes it."""
    pending, parts = [name], {}
    while pending:
        one = pending.pop(0)
        if one in parts:
            continue
        parts[one] = definition(one)
        for line in parts[one].splitlines():
            kind = line.split()[0].partition("[")[0]
            if kind.partition("<")[0] not in _PLAIN and "=" not in line:
                pending.append(kind if "/" in kind else f"{one.partition('/')[0]}/{kind}")
    rest = "".join(f"\n{'=' * 80}\nMSG: {other}\n{text}" for other, text in parts.items() if other != name)
    return parts[name] + rest


def write_ros2_log(path, messages):
    """A log of (topic, log time, package/msg/Name, message as a dictionary), by mcap-ros2-support's writer."""
    with path.open("wb") as file:
        writer = Writer(file)
        schemas: dict[str, Any] = {}
        for topic, time_ns, name, message in messages:
            if name not in schemas:
                schemas[name] = writer.register_msgdef(name, full_definition(name.replace("/msg/", "/")))
            writer.write_message(topic, schemas[name], message, log_time=time_ns, publish_time=time_ns)
        writer.finish()
    return path


def header(time_ns, frame="map"):
    """A std_msgs/Header."""
    return {"stamp": {"sec": time_ns // 10**9, "nanosec": time_ns % 10**9}, "frame_id": frame}
