"""The topics of the logs that this package writes."""

from collections.abc import Mapping
from typing import Literal

OBJECTS = "/objects"
DETECTIONS = "/detections"
ESTIMATES = "/dirprim/tracks"
MEASURED, COASTING = "/dirprim/tracks/measured", "/dirprim/tracks/coasting"
ESTIMATES_GLOBE, MAP_GLOBE, LOCATION = "/dirprim/tracks/geojson", "/dirprim/map/geojson", "/dirprim/origin"
ASSIGNED = "/dirprim/assigned"
ESTIMATES_SCENE = "/dirprim/tracks/scene"
SMOOTHED = "/dirprim/smoothed"
SMOOTHED_SCENE = "/dirprim/smoothed/scene"
PARTICLES = "/dirprim/particles"
REPORTS = "/dirprim/detections"
FORECAST = "/dirprim/forecast"
TRANSFORM = "/tf"
MAP = "/dirprim/map"
MAP_SCENE = "/dirprim/map/scene"

RosMessages = Literal["vision_msgs", "autoware"]
ROS_MESSAGES: Mapping[RosMessages, str] = {
    "vision_msgs": "vision_msgs/msg/Detection3DArray", "autoware": "autoware_perception_msgs/msg/TrackedObjects",
}  # fmt: skip
"""ROS 2 messages in which estimates can be written too, by the last part of their topics' names."""
