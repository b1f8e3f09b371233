"""`visualization_msgs/MarkerArray`: what a node drew of its objects.

A marker that adds or changes a cube, a sphere, a cylinder or a mesh is an object, named "namespace/id"; arrows,
lines and texts are no objects, nor is what deletes. Each marker has a header of its own. No velocity. The scale is the
size of what is drawn; of a mesh it is a factor, and the size unknown.

Source: visualization_msgs/msg/Marker.msg of ROS 2.
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import AnyArray
from dirprim_filter.recording.decoding.field_columns import FieldColumns
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.field_groups import SIZE, extents, header, pose
from dirprim_filter.recording.schemas.object_rows import Family, ObjectRows, object_rows

BODIES = (1, 2, 3, 10)  # CUBE, SPHERE, CYLINDER, MESH_RESOURCE
MESH = 10
ADD = 0


def _objects(columns: FieldColumns, _topics: AnyArray) -> ObjectRows:
    kind = columns.integers("type")
    is_body = np.isin(kind, BODIES) & (columns.integers("action") == ADD)
    names = np.char.add(np.char.add(columns.names("space"), "/"), columns.names("id"))
    size = np.where((kind == MESH)[:, None], np.nan, columns.vectors(SIZE))
    return object_rows(columns, ".markers[]", track_id=names, size=size)[is_body]


MARKERS = Family(
    schemas=("visualization_msgs/msg/MarkerArray",),
    fields={
        **header(".markers[]"),
        "space": Field(path=".markers[].ns", kind="name"),
        "id": Field(path=".markers[].id", kind="name"),
        "type": Field(path=".markers[].type"),
        "action": Field(path=".markers[].action"),
        **pose(".markers[].pose", optional=True),
        **extents(".markers[].scale"),
    },
    objects=_objects,
)
