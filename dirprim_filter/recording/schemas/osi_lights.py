"""Which way vehicles signal: the indicator lights of `osi3.GroundTruth` and `osi3.SensorView` logs.

Source: ASAM OSI 3.7, osi_object.proto: `MovingObject.vehicle_classification.light_state.indicator_state`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from os import PathLike
from typing import Any, NamedTuple

from google.protobuf.message_factory import GetMessageClass

from dirprim_filter.recording.records import Channel
from dirprim_filter.recording.scan import scan
from dirprim_filter.recording.schemas.dirprim import parse
from dirprim_filter.recording.schemas.protobuf_plan import message_descriptor

_GROUND_TRUTH: dict[str, Callable[[Any], Any]] = {
    "osi3.GroundTruth": lambda message: message,
    "osi3.SensorView": lambda message: message.global_ground_truth,
}


class IndicatorLight(NamedTuple):
    """What a vehicle signals at a time."""

    time_ns: int  # log time
    track_id: str
    state: str  # the name in OSI without its prefix: "OFF", "LEFT", "RIGHT", "WARNING", "UNKNOWN", "OTHER"


def read_indicator_lights(path: str | PathLike[str]) -> Iterator[IndicatorLight]:
    """The indicator of every vehicle that tells of one, message by message in order of log time.

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
                    yield IndicatorLight(message.log_time_ns, str(mover.id.value), _state_name(lights.light_state))


def _state_name(light_state: Any) -> str:
    """The name of the state, its number where this version of OSI has no name for it."""
    number = light_state.indicator_state
    names = light_state.DESCRIPTOR.fields_by_name["indicator_state"].enum_type.values_by_number
    return names[number].name.removeprefix("INDICATOR_STATE_") if number in names else str(number)
