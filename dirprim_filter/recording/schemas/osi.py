"""Moving objects of ASAM Open Simulation Interface logs: `osi3.GroundTruth` and `osi3.SensorView`.

Message classes are built from the descriptor set that the log itself carries, so every version of OSI reads.
A sensor view's objects are those of its global ground truth. `osi3.SensorData` is not read: its objects are
relative to a moving sensor.

Source: ASAM OSI 3.7, osi_object.proto: `base.position` is the centre of the bounding box in the global frame,
x east, y north, metres; `base.velocity` is in the same frame; an object that stands has no course, its body's
yaw stands in.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError
from google.protobuf.message_factory import GetMessageClass

from dirprim_filter.recording.schemas.dirprim import parse, time_of
from dirprim_filter.recording.schemas.observed import ObservedFrame

STANDING_SPEED = 1e-3
"""Below this speed, m/s, the direction of a velocity is rounding error."""


def ground_truth_decoder(schema_data: bytes) -> Callable[[bytes], ObservedFrame]:
    """Decodes `osi3.GroundTruth` messages.

    Raises:
        DecodeError: `schema_data` is no descriptor set that defines them.
    """
    message_class = message_class_of("osi3.GroundTruth", schema_data)

    def decode(data: bytes) -> ObservedFrame:
        message = message_class()
        parse(message, data)
        return _moving_objects(message)

    return decode


def sensor_view_decoder(schema_data: bytes) -> Callable[[bytes], ObservedFrame]:
    """Decodes `osi3.SensorView` messages.

    Raises:
        DecodeError: `schema_data` is no descriptor set that defines them.
    """
    message_class = message_class_of("osi3.SensorView", schema_data)

    def decode(data: bytes) -> ObservedFrame:
        message = message_class()
        parse(message, data)
        return _moving_objects(message.global_ground_truth)

    return decode


def message_class_of(name: str, descriptors: bytes) -> Any:
    """The class of the message called `name`, from a serialised FileDescriptorSet in a pool of its own."""
    files = FileDescriptorSet()
    parse(files, descriptors)
    pool = DescriptorPool()
    pending = {file.name: file for file in files.file}
    try:
        while ready := [f for f in pending.values() if not any(needed in pending for needed in f.dependency)]:
            for file in ready:
                pool.AddSerializedFile(pending.pop(file.name).SerializeToString())
        return GetMessageClass(pool.FindMessageTypeByName(name))
    except (KeyError, TypeError) as error:
        raise DecodeError(f"{name}: expected a descriptor set that defines it, got {error}") from error


def _moving_objects(ground_truth: Any) -> ObservedFrame:
    movers = [mover for mover in ground_truth.moving_object if mover.base.HasField("position")]
    state = np.array([_state(mover.base) for mover in movers], dtype=np.float64).reshape(-1, 4)
    return ObservedFrame(
        track_id=[str(mover.id.value) for mover in movers],
        stamp_ns=time_of(ground_truth.timestamp) if ground_truth.HasField("timestamp") else None,
        position=state[:, :2],
        direction=state[:, 2],
        speed=state[:, 3],
        group=np.zeros(len(movers), np.int64),
    )


def _state(base: Any) -> tuple[float, float, float, float]:
    """Position, direction and speed of an object; the latter NaN where it carries no velocity."""
    place = base.position
    if not base.HasField("velocity"):
        return place.x, place.y, np.nan, np.nan
    speed = float(np.hypot(base.velocity.x, base.velocity.y))
    direction = float(np.arctan2(base.velocity.y, base.velocity.x))
    if speed < STANDING_SPEED and base.HasField("orientation"):
        direction = base.orientation.yaw
    return place.x, place.y, direction, speed
