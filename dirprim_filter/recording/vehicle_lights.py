"""What vehicles signal: the indicator and brake lights of `osi3.GroundTruth` and `osi3.SensorView` logs.

Source: ASAM OSI 3.7, osi_object.proto: `MovingObject.vehicle_classification.light_state`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from os import PathLike
from typing import Any, NamedTuple

from google.protobuf.message_factory import GetMessageClass

from dirprim_filter.recording.container.log import scan
from dirprim_filter.recording.container.records import Channel
from dirprim_filter.recording.decoding.protobuf_plan import message_descriptor
from dirprim_filter.recording.schemas.dirprim import parse

_GROUND_TRUTH: dict[str, Callable[[Any], Any]] = {
    "osi3.GroundTruth": lambda message: message,
    "osi3.SensorView": lambda message: message.global_ground_truth,
}


class VehicleLights(NamedTuple):
    """What a vehicle signals at a time, in the names of OSI without their prefix."""

    time_ns: int  # log time
    track_id: str
    indicator: str  # "OFF", "LEFT", "RIGHT", "WARNING", "UNKNOWN" or "OTHER"
    brake: str  # "OFF", "NORMAL", "STRONG", "UNKNOWN" or "OTHER"


def read_vehicle_lights(path: str | PathLike[str]) -> Iterator[VehicleLights]:
    """The lights of every vehicle that reports them, message by message in order of log time.

    Args:
        path: an MCAP log; messages other than OSI's ground truth are passed over.

    Raises:
        NotMcapError: the file is no MCAP log.
        google.protobuf.message.DecodeError: a message is not what its schema says.
    """
    classes: dict[Channel, Any] = {}
    with scan(path) as log:
        for message in log:
            channel = message.channel
            if channel.schema.name not in _GROUND_TRUTH or channel.message_encoding != "protobuf":
                continue
            if channel not in classes:
                classes[channel] = GetMessageClass(message_descriptor(channel.schema.name, channel.schema.data))
            view = classes[channel]()
            parse(view, message.data)
            for mover in _GROUND_TRUTH[channel.schema.name](view).moving_object:
                lights = mover.vehicle_classification
                if lights.HasField("light_state"):
                    states = (_state_name(lights.light_state, name) for name in ("indicator", "brake_light"))
                    yield VehicleLights(message.log_time_ns, str(mover.id.value), *states)


def _state_name(light_state: Any, light: str) -> str:
    """The name of a light's state, its number where this version of OSI has no name for it."""
    number = getattr(light_state, f"{light}_state")
    names = light_state.DESCRIPTOR.fields_by_name[f"{light}_state"].enum_type.values_by_number
    return names[number].name.removeprefix(f"{light.upper()}_STATE_") if number in names else str(number)
