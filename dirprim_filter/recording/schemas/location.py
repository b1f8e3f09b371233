"""Satellite fixes of one vehicle: `foxglove.LocationFix`, `foxglove.LocationFixes`, `sensor_msgs/NavSatFix`.

Degrees on WGS 84, to be projected to a local plane. The vehicle is named after the topic: the frame is that of the
antenna. A receiver without a fix says so by a status below 0, by 0 degrees north and 0 east to the last
bit, which are unset fields, or by degrees that do not exist. Covariances are of east, north and up in
square metres, and mean nothing where their type is unknown.

Sources: foxglove/LocationFix.proto of the Foxglove SDK; sensor_msgs/msg/NavSatFix.msg, NavSatStatus.msg of ROS 2.
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import AnyArray
from dirprim_filter.recording.decoding.field_columns import FieldColumns
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.field_groups import covariance, covariances
from dirprim_filter.recording.schemas.object_rows import Family, ObjectRows, object_rows

GEODETIC = "WGS 84"
"""The frame of positions (longitude, latitude) in degrees and a height above the ellipsoid in metres."""
UNKNOWN = 0
"""COVARIANCE_TYPE_UNKNOWN."""


def _objects(columns: FieldColumns, topics: AnyArray) -> ObjectRows:
    table = columns.fields["latitude"].table
    message = columns.message_of(table)
    place = columns.vectors(("longitude", "latitude", "altitude"))
    longitude, latitude = place[:, 0], place[:, 1]
    is_set = (latitude != 0) | (longitude != 0)
    is_fix = (columns.integers("status") >= 0) & is_set & (np.abs(latitude) <= 90) & (np.abs(longitude) <= 360)
    place[~is_fix] = np.nan
    known = columns.integers("covariance_type") != UNKNOWN
    return object_rows(
        columns, table, track_id=topics[message], frame_id=np.full(message.size, GEODETIC), place=place,
        covariance=covariances(columns, known),
    )  # fmt: skip


def _family(*schemas: str, at: str, stamp: str) -> Family:
    return Family(
        schemas=schemas,
        fields={
            "stamp": Field(path=f"{at}{stamp}", kind="time"),
            "status": Field(path=f"{at}.status.status", optional=True),
            "covariance_type": Field(path=f"{at}.position_covariance_type", optional=True),
            **covariance(f"{at}.position_covariance", n_rows=3),
            **{name: Field(path=f"{at}.{name}") for name in ("latitude", "longitude", "altitude")},
        },
        objects=_objects,
    )


FAMILIES = (
    _family("foxglove.LocationFix", "foxglove_msgs/msg/LocationFix", at="", stamp=".timestamp"),
    _family("foxglove.LocationFixes", "foxglove_msgs/msg/LocationFixes", at=".fixes[]", stamp=".timestamp"),
    _family("sensor_msgs/msg/NavSatFix", at="", stamp=".header.stamp"),
)
