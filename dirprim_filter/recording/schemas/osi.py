"""Moving objects of ASAM Open Simulation Interface logs: `osi3.GroundTruth` and `osi3.SensorView`.

Read by the descriptor set that the log itself carries, so every version of OSI reads. A sensor view's objects are
those of its global ground truth.

Source: ASAM OSI 3.7, osi_object.proto: `base.position` is the centre of the bounding box in the global frame,
x east, y north, metres; `base.velocity` is in the same frame; an object that stands has no course, its body's
yaw stands in. `base.dimension` is the size of that box, along the body's axes.
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import AnyArray
from dirprim_filter.primitives.cues import signalled
from dirprim_filter.recording.decoding.field_columns import FieldColumns
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.field_groups import UNLABELLED, VELOCITY, extents, label_names, xyz
from dirprim_filter.recording.schemas.object_rows import Family, ObjectRows, motion, object_rows

LABELS = ("unknown", "other", "vehicle", "pedestrian", "animal")
"""`MovingObject.Type`."""
DIMENSION = ("length", "width", "height")
LEFT, RIGHT = 3, 4
"""`VehicleClassification.LightState.IndicatorState`."""
VEHICLE = 2
VEHICLES = (
    "vehicle", "vehicle", "small_car", "compact_car", "car", "luxury_car", "delivery_van", "heavy_truck",
    "semitrailer", "trailer", "motorbike", "bicycle", "bus", "tram", "train", "wheelchair", "semitractor",
    "standup_scooter",
)  # fmt: skip
"""`MovingObject.VehicleClassification.Type`; of those that are unknown or other no more is known than of the object."""


def _labels(columns: FieldColumns) -> AnyArray:
    kind = columns.integers("type", default=UNLABELLED)
    vehicle = label_names(columns.integers("vehicle"), VEHICLES)
    return np.where(kind == VEHICLE, vehicle, label_names(kind, LABELS))


def _family(schema: str, truth: str) -> Family:
    movers = f"{truth}.moving_object[]"

    def objects(columns: FieldColumns, _topics: AnyArray) -> ObjectRows:
        velocity = columns.vectors(VELOCITY)
        yaw = np.where(columns.is_set("turned"), columns.numbers("yaw"), np.nan)
        standing = np.where(np.isnan(yaw), np.arctan2(velocity[:, 1], velocity[:, 0]), yaw)
        moving = motion(columns, standing) | {"climb": None}
        light = columns.integers("indicator")
        cue = signalled(light == LEFT, light == RIGHT)
        rows = object_rows(columns, movers, **moving, heading=yaw, label=_labels(columns), cue=cue)
        return rows[columns.is_set("placed")]

    return Family(
        schemas=(schema,),
        fields={
            "stamp": Field(path=f"{truth}.timestamp", kind="time"),
            "id": Field(path=f"{movers}.id.value", kind="name"),
            "type": Field(path=f"{movers}.type", optional=True),
            "vehicle": Field(path=f"{movers}.vehicle_classification.type", optional=True),
            "indicator": Field(path=f"{movers}.vehicle_classification.light_state.indicator_state", optional=True),
            "placed": Field(path=f"{movers}.base.position", kind="presence"),
            "moves": Field(path=f"{movers}.base.velocity", kind="presence"),
            "turned": Field(path=f"{movers}.base.orientation", kind="presence"),
            "yaw": Field(path=f"{movers}.base.orientation.yaw"),
            **xyz("p", f"{movers}.base.position"),
            **xyz("v", f"{movers}.base.velocity"),
            **extents(f"{movers}.base.dimension", DIMENSION),
        },
        objects=objects,
    )


GROUND_TRUTH = _family("osi3.GroundTruth", "")
SENSOR_VIEW = _family("osi3.SensorView", ".global_ground_truth")
