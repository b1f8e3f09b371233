"""Objects of `foxglove.SceneUpdate` messages, by the convention of nuScenes logs.

One entity is one object; its cube's pose is the object's; other primitives (lines of a lane map, arrows,
texts) are no objects, so entities without a cube are passed over. Velocity is not part of the schema: it is
taken from the entity's metadata `direction_rad` and `speed_mps` where these are, and `group` likewise.

Source: https://docs.foxglove.dev/docs/sdk/schemas/scene-update and https://github.com/foxglove/nuscenes2mcap.
"""

from __future__ import annotations

import math

import numpy as np
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from dirprim_filter.recording.schemas.dirprim import parse, time_of
from dirprim_filter.recording.schemas.observed import ObservedFrame

INT64_TEXT_LENGTH = 20


def decode_scene_update(data: bytes) -> ObservedFrame:
    """The entities with a cube; the frame's time is that of the first of them.

    Raises:
        DecodeError: the bytes are no such message.
    """
    message = SceneUpdate()
    parse(message, data)
    entities = [entity for entity in message.entities if entity.cubes]
    noted = [{pair.key: pair.value for pair in entity.metadata} for entity in entities]
    places = [entity.cubes[0].pose.position for entity in entities]
    stamped = bool(entities) and entities[0].HasField("timestamp")
    return ObservedFrame(
        track_id=[entity.id for entity in entities],
        stamp_ns=time_of(entities[0].timestamp) if stamped else None,
        position=np.array([(place.x, place.y) for place in places], dtype=np.float64).reshape(-1, 2),
        direction=np.array([_number(note, "direction_rad") for note in noted], dtype=np.float64),
        speed=np.array([_number(note, "speed_mps") for note in noted], dtype=np.float64),
        group=np.array([_group(note) for note in noted], dtype=np.int64),
    )


def _number(note: dict[str, str], key: str) -> float:
    """A number of the metadata; NaN, so unknown, where it is missing or no number."""
    try:
        return float(note[key])
    except (KeyError, ValueError):
        return math.nan


def _group(note: dict[str, str]) -> int:
    text = note.get("group", "0").removeprefix("-")
    is_number = text.isascii() and text.isdigit() and len(text) < INT64_TEXT_LENGTH - 1
    return int(note["group"]) if is_number and "group" in note else 0
