"""`vision_msgs/Detection3DArray`: boxes, without a velocity, and often without a name.

The box's centre is a pose in the header's frame. `id` stays the same over time where the detector tracks; it is
empty where it does not. Of several hypotheses the one of the highest score counts. The box's size is along its own
axes, x forward.

Source: https://github.com/ros-perception/vision_msgs, version 4 (ROS 2 Humble and later).
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import AnyArray
from dirprim_filter.recording.decoding.field_columns import FieldColumns
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.field_groups import extents, header, most_probable, pose
from dirprim_filter.recording.schemas.object_rows import Family, ObjectRows, object_rows


def _objects(columns: FieldColumns, _topics: AnyArray) -> ObjectRows:
    guesses, objects = most_probable(columns, "label", "score")
    named = columns.names("label")[guesses]
    label = np.full(columns.message_of(".detections[]").size, "", dtype=named.dtype)
    label[objects] = named
    return object_rows(columns, ".detections[]", label=label)


DETECTIONS_3D = Family(
    schemas=("vision_msgs/msg/Detection3DArray",),
    fields={
        **header(),
        "id": Field(path=".detections[].id", kind="name", optional=True),
        "label": Field(path=".detections[].results[].hypothesis.class_id", kind="name", optional=True),
        "score": Field(path=".detections[].results[].hypothesis.score", optional=True),
        **pose(".detections[].bbox.center", optional=True),
        **extents(".detections[].bbox.size"),
    },
    objects=_objects,
)
