"""`visualization_msgs/MarkerArray`: what a node drew of its objects.

A marker that adds or changes a cube, a sphere, a cylinder or a mesh is an object, named "namespace/id"; arrows,
lines and texts are no objects, nor is what deletes. Each marker has a header of its own. No velocity. The scale is the
size of what is drawn; of a mesh it is a factor, and the size unknown.

Source: visualization_msgs/msg/Marker.msg of ROS 2.
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.recording.decoding.field_columns import Shredded
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.attitude import ORIENTATION, POSITION, heading, orientation, xyz
from dirprim_filter.recording.schemas.extents import extents, sizes
from dirprim_filter.recording.schemas.object_rows import Family, ObservedRows, numbers, rows_of
from tessellation.arrays import AnyArray

BODIES = (1, 2, 3, 10)  # CUBE, SPHERE, CYLINDER, MESH_RESOURCE
MESH = 10
ADD = 0


def _objects(shredded: Shredded, _topics: AnyArray) -> ObservedRows:
    kind = shredded.integers("type")
    is_body = np.isin(kind, BODIES) & (shredded.integers("action") == ADD)
    message = shredded.message_of(".markers[]")
    space, number = shredded.names("space"), shredded.names("id")
    return rows_of(
        message,
        track_id=np.char.add(np.char.add(space, "/"), number),
        stamp_ns=shredded.times("stamp"),
        frame_id=shredded.names("frame"),
        place=numbers(shredded, *POSITION),
        size=np.where((kind == MESH)[:, None], np.nan, sizes(shredded)),
        heading=heading(numbers(shredded, *ORIENTATION)),
    )[is_body]


MARKERS = Family(
    schemas=("visualization_msgs/msg/MarkerArray",),
    fields={
        "stamp": Field(path=".markers[].header.stamp", kind="time"),
        "frame": Field(path=".markers[].header.frame_id", kind="name"),
        "space": Field(path=".markers[].ns", kind="name"),
        "id": Field(path=".markers[].id", kind="name"),
        "type": Field(path=".markers[].type"),
        "action": Field(path=".markers[].action"),
        **xyz("p", ".markers[].pose.position"),
        **orientation(".markers[].pose.orientation"),
        **extents(".markers[].scale"),
    },
    objects=_objects,
)
