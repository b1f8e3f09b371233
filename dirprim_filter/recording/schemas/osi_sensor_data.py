"""Moving objects as a sensor perceives them: `osi3.SensorData`.

Positions are in the axes of the virtual sensor. Its mounting position is told in the axes of the host vehicle, whose
origin is the rear axle; where that is in the world is told by the copy of the sensor view. Velocities are relative to
the moving sensor, so they are left out: direction and speed come from the positions in the world. The orientation of an
object is in the sensor's axes, as its position is.

Source: ASAM OSI 3.7, osi_sensordata.proto (`mounting_position`), osi_common.proto (`Orientation3d`: turned about z by
yaw, then about the new y by pitch, then about the new x by roll).
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.recording.decoding.field_columns import NO_TIME, Shredded
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.attitude import POSITION, rotated, xyz
from dirprim_filter.recording.schemas.extents import extents, sizes
from dirprim_filter.recording.schemas.object_rows import Family, ObservedRows, numbers, rows_of
from dirprim_filter.recording.schemas.osi import DIMENSION
from tessellation.arrays import AnyArray, FloatArray, IntArray

_TRUTH = ".sensor_view[0].global_ground_truth"
_MOVERS = f"{_TRUTH}.moving_object[]"
_ANGLES = ("yaw", "pitch", "roll")


def _turn(prefix: str, path: str) -> dict[str, Field]:
    return {f"{prefix}.{angle}": Field(path=f"{path}.{angle}") for angle in _ANGLES}


def _quaternion(angles: FloatArray) -> FloatArray:
    """(n, 4) of (n, 3) yaw, pitch and roll; an angle that is not told is 0."""
    (cy, cp, cr), (sy, sp, sr) = (f(np.where(np.isfinite(angles), angles, 0.0) / 2).T for f in (np.cos, np.sin))
    x, y = sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy
    return np.stack([x, y, cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy], axis=-1)


def _vector(shredded: Shredded, prefix: str) -> FloatArray:
    """(n, 3); 0 where it is not told."""
    return np.nan_to_num(numbers(shredded, *(f"{prefix}.{axis}" for axis in "xyz")))


def _angles(shredded: Shredded, prefix: str) -> FloatArray:
    return _quaternion(numbers(shredded, *(f"{prefix}.{angle}" for angle in _ANGLES)))


def _hosts(shredded: Shredded) -> IntArray:
    """(n_messages,) the row of the host vehicle among the movers; -1 where there is none."""
    of = shredded.message_of(_MOVERS)
    is_host = shredded.names("mover") == shredded.names("host")[of]
    hosts = np.full(shredded.n_messages, -1, np.int64)
    hosts[of[is_host]] = np.flatnonzero(is_host)
    return hosts


def _objects(shredded: Shredded, _topics: AnyArray) -> ObservedRows:
    message = shredded.message_of(".moving_object[]")
    hosts = _hosts(shredded)
    lost = np.unique(message[hosts[message] < 0])
    shredded.fail(lost, f"{_TRUTH} without the host vehicle, so it is unknown where the sensor is")
    placed = shredded.marks("placed") & (hosts[message] >= 0)
    message = message[placed]
    mounted, turned = _angles(shredded, "mounted")[message], _angles(shredded, "turned")[hosts[message]]
    in_vehicle = rotated(mounted, numbers(shredded, *POSITION)[placed])
    in_vehicle += _vector(shredded, "mount")[message] + _vector(shredded, "rear")[hosts[message]]
    place = rotated(turned, in_vehicle) + _vector(shredded, "at")[hosts[message]]
    ahead = rotated(_angles(shredded, "body")[placed], np.broadcast_to([1.0, 0.0, 0.0], place.shape))
    ahead = rotated(turned, rotated(mounted, ahead))
    measured, sent = shredded.times("measured"), shredded.times("stamp")
    return rows_of(
        message,
        track_id=shredded.names("id")[placed],
        stamp_ns=np.where(measured == NO_TIME, sent, measured)[message],
        frame_id=np.full(message.size, ""),
        place=place,
        size=sizes(shredded)[placed],
        heading=np.where(shredded.marks("faces")[placed], np.arctan2(ahead[:, 1], ahead[:, 0]), np.nan),
    )


SENSOR_DATA = Family(
    schemas=("osi3.SensorData",),
    fields={
        "stamp": Field(path=".timestamp", kind="time"),
        "measured": Field(path=".last_measurement_time", kind="time", optional=True),
        "id": Field(path=".moving_object[].header.tracking_id.value", kind="name"),
        "placed": Field(path=".moving_object[].base.position", kind="mark"),
        "faces": Field(path=".moving_object[].base.orientation", kind="mark"),
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
