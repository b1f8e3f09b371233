"""Which schemas of a log can be read as observed objects, and by what.

A schema's decoder is made from the definition that the log carries, so it must not be kept for another log.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from dirprim_filter.recording.schemas.dirprim import decode_observations
from dirprim_filter.recording.schemas.observed import ObservedFrame
from dirprim_filter.recording.schemas.osi import ground_truth_decoder, sensor_view_decoder
from dirprim_filter.recording.schemas.scene_update import decode_scene_update


class Decoder(Protocol):
    """Turns a message into the objects it tells of."""

    def __call__(self, data: bytes, /) -> ObservedFrame:
        """The objects of one message.

        Raises:
            google.protobuf.message.DecodeError: it is not what its schema says.
        """
        ...


DECODERS: dict[str, Callable[[bytes], Decoder]] = {
    "dirprim.Observations": lambda _definition: decode_observations,
    "osi3.GroundTruth": ground_truth_decoder,
    "osi3.SensorView": sensor_view_decoder,
    "foxglove.SceneUpdate": lambda _definition: decode_scene_update,
}
"""By schema name: makes a decoder from the schema's definition. All are of message encoding "protobuf"."""

KINDS: tuple[tuple[str, ...], ...] = (
    ("dirprim.Observations",),
    ("osi3.GroundTruth", "osi3.SensorView"),
    ("foxglove.SceneUpdate",),
)
"""Schemas of one kind tell the same; the first kind that a log holds tells the most."""

ESTIMATES_SCHEMA = "dirprim.TrackEstimates"
"""The schema of our own estimates: no observations, so no input."""
