"""Moving objects as a sensor perceives them: `osi3.SensorData`.

Positions are in the axes of the virtual sensor. Its mounting position is in the axes of the host vehicle, whose
origin is the rear axle; where that is in the world is in the copy of the sensor view. Velocities are relative to
the moving sensor, so they are left out: direction and speed come from the positions in the world. The orientation of an
object is in the sensor's axes, as its position is.

Source: ASAM OSI 3.7, osi_sensordata.proto (`mounting_position`), osi_common.proto (`Orientation3d`: turned about z by
yaw, then about the new y by pitch, then about the new x by roll).
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.recording.decoding.field_columns import NO_TIME, FieldColumns
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.attitude import rotated
from dirprim_filter.recording.schemas.field_groups import POSITION, SIZE, extents, xyz
from dirprim_filter.recording.schemas.object_rows import Family, ObjectRows, rows_of
from dirprim_filter.recording.schemas.osi import DIMENSION

_TRUTH = ".sensor_view[0].global_ground_truth"
_MOVERS = f"{_TRUTH}.moving_object[]"
_ANGLES = ("yaw", "pitch", "roll")


def _turn(prefix: str, path: str) -> dict[str, Field]:
    return {f"{prefix}.{angle}": Field(path=f"{path}.{angle}") for angle in _ANGLES}


def _quaternion(angles: FloatArray) -> FloatArray:
    """(n, 4) of (n, 3) yaw, pitch and roll; an unknown angle is 0."""
    (cy, cp, cr), (sy, sp, sr) = (f(np.where(np.isfinite(angles), angles, 0.0) / 2).T for f in (np.cos, np.sin))
    x, y = sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy
    return np.stack([x, y, cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy], axis=-1)


def _vector(columns: FieldColumns, prefix: str) -> FloatArray:
    """(n, 3); 0 where unknown."""
    return np.nan_to_num(columns.vectors([f"{prefix}.{axis}" for axis in "xyz"]))


def _angles(columns: FieldColumns, prefix: str) -> FloatArray:
    return _quaternion(columns.vectors([f"{prefix}.{angle}" for angle in _ANGLES]))


def _hosts(columns: FieldColumns) -> IntArray:
    """(n_messages,) the row of the host vehicle among the movers; -1 where there is none."""
    of = columns.message_of(_MOVERS)
    is_host = columns.names("mover") == columns.names("host")[of]
    hosts = np.full(columns.n_messages, -1, np.int64)
    hosts[of[is_host]] = np.flatnonzero(is_host)
    return hosts


def _objects(columns: FieldColumns, _topics: AnyArray) -> ObjectRows:
    message = columns.message_of(".moving_object[]")
    hosts = _hosts(columns)
    lost = np.unique(message[hosts[message] < 0])
    columns.fail(lost, f"{_TRUTH} without the host vehicle, so it is unknown where the sensor is")
    placed = columns.is_set("placed") & (hosts[message] >= 0)
    message = message[placed]
    mounted, turned = _angles(columns, "mounted")[message], _angles(columns, "turned")[hosts[message]]
    in_vehicle = rotated(mounted, columns.vectors(POSITION)[placed])
    in_vehicle += _vector(columns, "mount")[message] + _vector(columns, "rear")[hosts[message]]
    place = rotated(turned, in_vehicle) + _vector(columns, "at")[hosts[message]]
    ahead = rotated(_angles(columns, "body")[placed], np.broadcast_to([1.0, 0.0, 0.0], place.shape))
    ahead = rotated(turned, rotated(mounted, ahead))
    measured, sent = columns.times("measured"), columns.times("stamp")
    return rows_of(
        message,
        track_id=columns.names("id")[placed],
        stamp_ns=np.where(measured == NO_TIME, sent, measured)[message],
        frame_id=np.full(message.size, ""),
        place=place,
        size=columns.vectors(SIZE)[placed],
        heading=np.where(columns.is_set("faces")[placed], np.arctan2(ahead[:, 1], ahead[:, 0]), np.nan),
    )


SENSOR_DATA = Family(
    schemas=("osi3.SensorData",),
    fields={
        "stamp": Field(path=".timestamp", kind="time"),
        "measured": Field(path=".last_measurement_time", kind="time", optional=True),
        "id": Field(path=".moving_object[].header.tracking_id.value", kind="name"),
        "placed": Field(path=".moving_object[].base.position", kind="presence"),
        "faces": Field(path=".moving_object[].base.orientation", kind="presence"),
        **xyz("p", ".moving_object[].base.position"),
        **_turn("body", ".moving_object[].base.orientation"),
        **extents(".moving_object[].base.dimension", DIMENSION),
        **xyz("mount", ".mounting_position.position"),
        **_turn("mounted", ".mounting_position.orientation"),
        "host": Field(path=f"{_TRUTH}.host_vehicle_id.value", kind="name"),
        "mover": Field(path=f"{_MOVERS}.id.value", kind="name"),
        **xyz("at", f"{_MOVERS}.base.position"),
        **_turn("turned", f"{_MOVERS}.base.orientation"),
        **xyz("rear", f"{_MOVERS}.vehicle_attributes.bbcenter_to_rear"),
    },
    objects=_objects,
)
