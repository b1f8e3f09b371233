"""Moving objects as a sensor perceives them: `osi3.SensorData`.

Positions are in the axes of the virtual sensor. Its mounting position is in the axes of the host vehicle, whose
origin is the rear axle; where that is in the world is in the copy of the sensor view. Velocities are relative to
the moving sensor, so they are left out: direction and speed come from the positions in the world. The orientation of an
object is in the sensor's axes, as its position is.

Source: ASAM OSI 3.7, osi_sensordata.proto (`mounting_position`), osi_common.proto (`Orientation3d`: turned about z by
yaw, then about the new y by pitch, then about the new x by roll).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.recording.decoding.field_columns import NO_TIME, FieldColumns
from dirprim_filter.recording.schemas.attitude import rotated
from dirprim_filter.recording.schemas.family import SIZE, family

_TRUTH = ".sensor_view[0].global_ground_truth"
_MOVERS = f"{_TRUTH}.moving_object[]"
_ANGLES = ("yaw", "pitch", "roll")


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


def _in_the_world(columns: FieldColumns, message: IntArray, known: dict[str, Any]) -> BoolArray:
    """Places and headings out of the axes of the sensor; which objects have a place and a host."""
    host = _hosts(columns)[message]
    columns.fail(message[host < 0], f"{_TRUTH} without the host vehicle, so it is unknown where the sensor is")
    kept = columns.is_set("placed") & (host >= 0)
    if not kept.any():
        return kept
    mounted, turned = _angles(columns, "mounted")[message], _angles(columns, "turn")[host]
    in_vehicle = rotated(mounted, known["place"]) + _vector(columns, "mount")[message] + _vector(columns, "rear")[host]
    known["place"] = rotated(turned, in_vehicle) + _vector(columns, "at")[host]
    ahead = rotated(_angles(columns, "body"), np.broadcast_to([1.0, 0.0, 0.0], known["place"].shape))
    ahead = rotated(turned, rotated(mounted, ahead))
    known["heading"] = np.where(columns.is_set("faces"), np.arctan2(ahead[:, 1], ahead[:, 0]), np.nan)
    measured = columns.times("measured")[message]
    known["stamp_ns"] = np.where(measured == NO_TIME, known["stamp_ns"], measured)
    return kept


def _each(prefix: str, path: str, names: Sequence[str]) -> dict[str, str]:
    return {f"{prefix}.{name}": f"{path}.{name}" for name in names}


_OWN = ".moving_object[].base"
SENSOR_DATA = family(
    "osi3.SensorData",
    paths={
        "time": ".timestamp", "measured": ".last_measurement_time",
        "id": ".moving_object[].header.tracking_id.value", "placed": f"{_OWN}.position", "position": f"{_OWN}.position",
        "faces": f"{_OWN}.orientation", **_each("body", f"{_OWN}.orientation", _ANGLES),
        **{name: f"{_OWN}.dimension.{name}" for name in SIZE},
        **_each("mount", ".mounting_position.position", "xyz"),
        **_each("mounted", ".mounting_position.orientation", _ANGLES),
        "host": f"{_TRUTH}.host_vehicle_id.value", "mover": f"{_MOVERS}.id.value",
        **_each("at", f"{_MOVERS}.base.position", "xyz"), **_each("turn", f"{_MOVERS}.base.orientation", _ANGLES),
        **_each("rear", f"{_MOVERS}.vehicle_attributes.bbcenter_to_rear", "xyz"),
    },
    amend=_in_the_world,
)  # fmt: skip
