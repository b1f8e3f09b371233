"""ROS 2 definitions of the messages that tests write, and a log of them by independent writers.

Those of ROS itself come with rosbags, the others from `data/ros2_messages.msg`. Their sources: vision_msgs,
autoware_msgs, astuff_sensor_msgs and the Foxglove SDK; comments and what no test fills are left out where the layout of
the rest does not depend on it.
"""

from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

from mcap_ros2.writer import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

PERCEPTION = "autoware_perception_msgs", "autoware_auto_perception_msgs"
"""Autoware's package, and its former name."""
PARTS = (Path(__file__).parents[1] / "data" / "ros2_messages.msg").read_text().split(f"{'=' * 80}\nMSG: ")[1:]
DEFINITIONS = {
    name.replace(*rename): text.strip().replace(*rename)
    for name, _, text in (part.partition("\n") for part in PARTS)
    for rename in (("", ""), PERCEPTION)
}
ROS = get_typestore(Stores.ROS2_JAZZY)


def definition(name):
    """Of package/Name alone."""
    whole = ROS.generate_msgdef(name.replace("/", "/msg/"), ros_version=2)[0] if name not in DEFINITIONS else ""
    return DEFINITIONS.get(name) or whole.partition("=" * 80)[0].rstrip()


@cache
def parsed(name, text):
    return get_types_from_msg(text, name)


def full_definition(name, changed=MappingProxyType({})):
    """The ros2msg definition of package/msg/Name with all that it depends on, as rosbag2 writes it."""
    store = get_typestore(Stores.ROS2_JAZZY)
    store.fielddefs = dict(ROS.fielddefs)
    for one, text in (DEFINITIONS | changed).items():
        store.fielddefs |= parsed(one.replace("/", "/msg/"), text)
    return store.generate_msgdef(name, ros_version=2)[0]


def write_ros2_log(path, messages, changed=MappingProxyType({})):
    """A log of (topic, log time, package/msg/Name, message as a dictionary), by mcap-ros2-support's writer.

    `changed` are definitions of another version by package/Name.
    """
    with path.open("wb") as file:
        writer = Writer(file)
        schemas: dict[str, Any] = {}
        for topic, time_ns, name, message in messages:
            if name not in schemas:
                schemas[name] = writer.register_msgdef(name, full_definition(name, changed))
            writer.write_message(topic, schemas[name], message, log_time=time_ns, publish_time=time_ns)
        writer.finish()
    return path


def header(time_ns, frame="map"):
    """A std_msgs/Header."""
    return {"stamp": {"sec": time_ns // 10**9, "nanosec": time_ns % 10**9}, "frame_id": frame}


def point(x, y, z):
    return {"x": float(x), "y": float(y), "z": float(z)}


def quaternion(roll, pitch, yaw):
    """Of a body turned by yaw, then pitch, then roll, by scipy, which knows nothing of ours."""
    return dict(zip("xyzw", Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat().tolist(), strict=True))


def ros_transform(time_ns, parent, child, place, yaw=0.0):
    return {
        "header": header(time_ns, parent), "child_frame_id": child,
        "transform": {"translation": point(*place), "rotation": quaternion(0, 0, yaw)},
    }  # fmt: skip


def tf(time_ns, *transforms, topic="/tf"):
    """A message of transforms, as `write_ros2_log` takes it."""
    return topic, time_ns, "tf2_msgs/msg/TFMessage", {"transforms": list(transforms)}


def array(stamp_ns, frame, objects, *, late_ns=0):
    """A message of objects, logged so much later than it is stamped."""
    message = {"header": header(stamp_ns, frame), "objects": objects}
    return "/objects", stamp_ns + late_ns, "derived_object_msgs/msg/ObjectArray", message


def ros2_log_in_order(path, *messages):
    return write_ros2_log(path, sorted(messages, key=lambda message: message[1]))
