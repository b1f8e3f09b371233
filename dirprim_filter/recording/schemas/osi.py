"""ASAM OSI: ground truth of the world, and what a sensor perceives in its own axes.

The base of an object is the centre of its bounding box, x east, y north in ground truth; a vehicle signals by lights.

In `osi3.SensorData` positions are in the axes of the virtual sensor. Its mounting position is in the axes of the host
vehicle, whose origin is the rear axle; where that is in the world is in the copy of the sensor view. Velocities are
relative to the moving sensor, so they are left out: direction and speed come from the positions on the map. Errors
are those of `base_rmse`, along the sensor's axes.

Source: ASAM OSI 3.7, osi_object.proto, osi_sensordata.proto (`mounting_position`), osi_common.proto (`Orientation3d`:
turned about z by yaw, then about the new y by pitch, then about the new x by roll).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.recording.decoding.field_columns import NO_TIME, FieldColumns
from dirprim_filter.recording.schemas.family import SIZE, Family, family
from dirprim_filter.recording.schemas.object_columns import UNLABELLED, label_names

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

KINDS = ("unknown", "other", "vehicle", "pedestrian", "animal")
"""`MovingObject.Type`."""
VEHICLE, LEFT, RIGHT = 2, 3, 4
"""Of the types; and `VehicleClassification.LightState.IndicatorState`."""
VEHICLES = (
    "vehicle", "vehicle", "small_car", "compact_car", "car", "luxury_car", "delivery_van", "heavy_truck",
    "semitrailer", "trailer", "motorbike", "bicycle", "bus", "tram", "train", "wheelchair", "semitractor",
    "standup_scooter",
)  # fmt: skip
"""`MovingObject.VehicleClassification.Type`; of those that are unknown or other no more is known than of the object."""
_ANGLES = ("yaw", "pitch", "roll")
_TRUTH = ".sensor_view[0].global_ground_truth"
_HOST = f"{_TRUTH}.moving_object[]"


def _signs(columns: FieldColumns, _: IntArray, known: dict[str, Any]) -> BoolArray:
    """What a vehicle is, and signals; an object that stands, of unknown yaw, has the course of what little it moves."""
    from dirprim_filter.primitives.cues import signalled  # noqa: PLC0415 - logs without lights do without

    kind = columns.read("type", UNLABELLED)
    vehicle = label_names(columns.read("vehicle", 0), VEHICLES)
    known["label"] = np.where(kind == VEHICLE, vehicle, label_names(kind, KINDS))
    light = columns.read("indicator", 0)
    known["cue"] = signalled(light == LEFT, light == RIGHT)
    drift = np.arctan2(columns.read("vy"), columns.read("vx"))
    stands = np.isnan(known["direction"]) & np.isfinite(known["speed"])
    known["direction"] = np.where(stands, drift, known["direction"])
    return columns.is_set("placed")


def _in_the_world(columns: FieldColumns, message: IntArray, known: dict[str, Any]) -> BoolArray:
    """Places and headings out of the axes of the sensor; which objects have a place and a host."""
    movers = columns.message_of(_HOST)
    is_host = columns.read("mover", "") == columns.read("host", "")[movers]
    host = np.full(columns.n_messages, -1, np.int64)
    host[movers[is_host]] = np.flatnonzero(is_host)
    host = host[message]  # of each object, among the movers
    columns.fail(message[host < 0], f"{_TRUTH} without the host vehicle, so it is unknown where the sensor is")
    kept = columns.is_set("placed") & (host >= 0)
    if not kept.any():
        return kept
    mounted, vehicle = _turn(columns, "mounted", message), _turn(columns, "turn", host)
    in_vehicle = mounted.apply(known["place"]) + _place(columns, "mount")[message] + _place(columns, "rear")[host]
    known["place"] = vehicle.apply(in_vehicle) + _place(columns, "at")[host]
    errors = columns.vectors([f"error.{axis}" for axis in "xyz"])  # 0 where not set: no covariance
    axes = (vehicle * mounted).as_matrix()[:, :2] * errors[:, None]
    known["covariance"] = axes @ axes.transpose(0, 2, 1)
    ahead = (vehicle * mounted * _turn(columns, "body", np.arange(message.size))).apply([1.0, 0.0, 0.0])
    known["heading"] = np.where(columns.is_set("faces"), np.arctan2(ahead[:, 1], ahead[:, 0]), np.nan)
    measured = columns.read("measured", NO_TIME)[message]
    known["stamp_ns"] = np.where(measured == NO_TIME, known["stamp_ns"], measured)
    return kept


def _place(columns: FieldColumns, prefix: str) -> FloatArray:
    """(n, 3); 0 where unknown."""
    return np.nan_to_num(columns.vectors([f"{prefix}.{axis}" for axis in "xyz"]))


def _turn(columns: FieldColumns, prefix: str, rows: IntArray) -> Rotation:
    """Of the chosen rows; an unknown angle is 0."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - few logs need it

    angles = columns.vectors([f"{prefix}.{angle}" for angle in _ANGLES])[rows]
    return Rotation.from_euler("ZYX", np.where(np.isfinite(angles), angles, 0.0))


def ground_truth(schema: str, truth: str) -> Family:
    """The family of a schema that holds a `GroundTruth` at a path."""
    return family(
        schema,
        f"time={truth}.timestamp id=@.id.value type=@.type vehicle=@.vehicle_classification.type "
        "indicator=@.vehicle_classification.light_state.indicator_state placed=@.base.position "
        "position=@.base.position moves=@.base.velocity velocity=@.base.velocity "
        f"turned=@.base.orientation heading=@.base.orientation.yaw {_SIZE}",
        at=f"{truth}.moving_object[]", amend=_signs,
    )  # fmt: skip


_SIZE = " ".join(f"{side}=@.base.dimension.{side}" for side in SIZE)
_AXES = {
    "error": "@.base_rmse.position", "mount": ".mounting_position.position", "at": f"{_HOST}.base.position",
    "rear": f"{_HOST}.vehicle_attributes.bbcenter_to_rear",
}  # fmt: skip
_TURNS = {
    "body": "@.base.orientation", "mounted": ".mounting_position.orientation", "turn": f"{_HOST}.base.orientation"
}  # fmt: skip
SENSOR_DATA = family(
    "osi3.SensorData",
    "time=.timestamp measured=.last_measurement_time id=@.header.tracking_id.value placed=@.base.position "
    "existence=@.header.existence_probability "
    f"position=@.base.position faces=@.base.orientation host={_TRUTH}.host_vehicle_id.value mover={_HOST}.id.value "
    + " ".join([
        _SIZE, *(f"{of}.{axis}={path}.{axis}" for of, path in _AXES.items() for axis in "xyz"),
        *(f"{of}.{angle}={path}.{angle}" for of, path in _TURNS.items() for angle in _ANGLES),
    ]),
    at=".moving_object[]", amend=_in_the_world,
)  # fmt: skip
