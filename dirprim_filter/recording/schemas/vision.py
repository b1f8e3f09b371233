"""`vision_msgs/Detection3DArray`: boxes, without a velocity, and often without a name.

The box's centre is a pose in the header's frame. `id` stays the same over time where the detector tracks; it is
empty where it does not. Of several hypotheses the one of the highest score counts. The box's size is along its own
axes, x forward.

Source: https://github.com/ros-perception/vision_msgs, version 4 (ROS 2 Humble and later).
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.recording.decoding.field_columns import Shredded
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.attitude import ORIENTATION, POSITION, heading, orientation, xyz
from dirprim_filter.recording.schemas.extents import extents, sizes
from dirprim_filter.recording.schemas.labels import most_probable
from dirprim_filter.recording.schemas.object_rows import Family, ObservedRows, numbers, rows_of
from tessellation.arrays import AnyArray


def _objects(shredded: Shredded, _topics: AnyArray) -> ObservedRows:
    message = shredded.message_of(".detections[]")
    guesses, objects = most_probable(shredded, "label", "score")
    named = shredded.names("label")[guesses]
    label = np.full(message.size, "", dtype=named.dtype)
    label[objects] = named
    return rows_of(
        message,
        track_id=shredded.names("id"),
        stamp_ns=shredded.times("stamp")[message],
        frame_id=shredded.names("frame")[message],
        place=numbers(shredded, *POSITION),
        label=label,
        size=sizes(shredded),
        heading=heading(numbers(shredded, *ORIENTATION)),
    )


DETECTIONS_3D = Family(
    schemas=("vision_msgs/msg/Detection3DArray",),
    fields={
        "stamp": Field(path=".header.stamp", kind="time"),
        "frame": Field(path=".header.frame_id", kind="name"),
        "id": Field(path=".detections[].id", kind="name", optional=True),
        "label": Field(path=".detections[].results[].hypothesis.class_id", kind="name", optional=True),
        "score": Field(path=".detections[].results[].hypothesis.score", optional=True),
        **xyz("p", ".detections[].bbox.center.position"),
        **orientation(".detections[].bbox.center.orientation"),
        **extents(".detections[].bbox.size"),
    },
    objects=_objects,
)
