"""Moving objects of ASAM Open Simulation Interface logs: `osi3.GroundTruth` and `osi3.SensorView`.

Read by the descriptor set that the log itself carries, so every version of OSI reads. A sensor view's objects are
those of its global ground truth.

Source: ASAM OSI 3.7, osi_object.proto: `base.position` is the centre of the bounding box in the global frame,
x east, y north, metres; `base.velocity` is in the same frame; an object that stands has no course, its body's
yaw stands in. `base.dimension` is the size of that box, along the body's axes.
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.recording.decoding.field_columns import Shredded
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.attitude import POSITION, VELOCITY, course, xyz
from dirprim_filter.recording.schemas.extents import extents, sizes
from dirprim_filter.recording.schemas.labels import UNTOLD, label_names
from dirprim_filter.recording.schemas.object_rows import Family, ObservedRows, numbers, rows_of
from tessellation.arrays import AnyArray

LABELS = ("unknown", "other", "vehicle", "pedestrian", "animal")
"""`MovingObject.Type`."""
DIMENSION = ("length", "width", "height")
VEHICLE = 2
VEHICLES = (
    "vehicle", "vehicle", "small_car", "compact_car", "car", "luxury_car", "delivery_van", "heavy_truck",
    "semitrailer", "trailer", "motorbike", "bicycle", "bus", "tram", "train", "wheelchair", "semitractor",
    "standup_scooter",
)  # fmt: skip
"""`MovingObject.VehicleClassification.Type`; of those that are unknown or other no more is known than of the object."""


def _labels(shredded: Shredded) -> AnyArray:
    kind = shredded.integers("type", default=UNTOLD)
    vehicle = label_names(shredded.integers("vehicle"), VEHICLES)
    return np.where(kind == VEHICLE, vehicle, label_names(kind, LABELS))


def _family(schema: str, truth: str) -> Family:
    movers = f"{truth}.moving_object[]"

    def objects(shredded: Shredded, _topics: AnyArray) -> ObservedRows:
        message = shredded.message_of(movers)
        velocity = numbers(shredded, *VELOCITY)
        yaw = np.where(shredded.marks("turned"), shredded.numbers("yaw"), np.nan)
        standing = np.where(np.isnan(yaw), np.arctan2(velocity[:, 1], velocity[:, 0]), yaw)
        velocity[~shredded.marks("moves")] = np.nan
        direction, speed = course(velocity, standing)
        return rows_of(
            message,
            track_id=shredded.names("id"),
            stamp_ns=shredded.times("stamp")[message],
            frame_id=np.full(message.size, ""),
            place=numbers(shredded, *POSITION),
            direction=direction,
            speed=speed,
            label=_labels(shredded),
            size=sizes(shredded),
            heading=yaw,
        )[shredded.marks("placed")]

    return Family(
        schemas=(schema,),
        fields={
            "stamp": Field(path=f"{truth}.timestamp", kind="time"),
            "id": Field(path=f"{movers}.id.value", kind="name"),
            "type": Field(path=f"{movers}.type", optional=True),
            "vehicle": Field(path=f"{movers}.vehicle_classification.type", optional=True),
            "placed": Field(path=f"{movers}.base.position", kind="mark"),
            "moves": Field(path=f"{movers}.base.velocity", kind="mark"),
            "turned": Field(path=f"{movers}.base.orientation", kind="mark"),
            "yaw": Field(path=f"{movers}.base.orientation.yaw"),
            **xyz("p", f"{movers}.base.position"),
            **xyz("v", f"{movers}.base.velocity"),
            **extents(f"{movers}.base.dimension", DIMENSION),
        },
        objects=objects,
    )


GROUND_TRUTH = _family("osi3.GroundTruth", "")
SENSOR_VIEW = _family("osi3.SensorView", ".global_ground_truth")
