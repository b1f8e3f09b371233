"""Objects of `foxglove.SceneUpdate` messages, by the convention of nuScenes logs.

One entity is one object; its first cube's pose is the object's; other primitives (lines of a lane map, arrows,
texts) are no objects, so entities without a cube are passed over. Velocity is not part of the schema: it is
taken from the entity's metadata `direction_rad` and `speed_mps` where these are, and `group` and `category`, what the
object is, likewise.

Source: https://docs.foxglove.dev/docs/sdk/schemas/scene-update and https://github.com/foxglove/nuscenes2mcap.
"""

from __future__ import annotations

import math

import numpy as np

from dirprim_filter.recording.schemas.attitude import POSITION, xyz
from dirprim_filter.recording.schemas.fields import Field
from dirprim_filter.recording.schemas.observed import Family, ObservedRows, numbers, rows_of
from dirprim_filter.recording.schemas.shredded import Shredded
from tessellation.arrays import AnyArray, FloatArray, IntArray

INT64_TEXT_LENGTH = 20
_ENTITIES = ".entities[]"
_NOTES = ".entities[].metadata[]"


def _objects(shredded: Shredded, _topics: AnyArray) -> ObservedRows:
    message = shredded.message_of(_ENTITIES)
    notes = _Notes(shredded, message.size)
    return rows_of(
        message,
        track_id=shredded.names("id"),
        stamp_ns=shredded.times("stamp"),
        frame_id=shredded.names("frame"),
        place=numbers(shredded, *POSITION),
        direction=notes.numbers("direction_rad"),
        speed=notes.numbers("speed_mps"),
        group=notes.groups(),
        label=notes.texts("category"),
    )[shredded.marks("cube")]


class _Notes:
    """The metadata of the entities."""

    def __init__(self, shredded: Shredded, n: int) -> None:
        self._n = n
        self._entity = shredded.parent_of(_NOTES)
        self._key = shredded.names("key")
        self._value = shredded.names("value")

    def numbers(self, key: str) -> FloatArray:
        """(n,) a number of each entity; NaN, so unknown, where it is missing or no number."""
        is_key = self._key == key
        found = np.full(self._n, np.nan)
        found[self._entity[is_key]] = [_number(text) for text in self._value[is_key].tolist()]
        return found

    def texts(self, key: str) -> AnyArray:
        """(n,) a text of each entity; empty where it is missing."""
        is_key = self._key == key
        found = np.full(self._n, "", dtype=self._value.dtype)
        found[self._entity[is_key]] = self._value[is_key]
        return found

    def groups(self) -> IntArray:
        """(n,) the group of each entity; 0 where it has none, or none that is a number."""
        is_key = self._key == "group"
        found = np.zeros(self._n, np.int64)
        found[self._entity[is_key]] = [_group(text) for text in self._value[is_key].tolist()]
        return found


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _group(text: str) -> int:
    digits = text.removeprefix("-")
    is_number = digits.isascii() and digits.isdigit() and len(digits) < INT64_TEXT_LENGTH - 1
    return int(text) if is_number else 0


SCENE_UPDATE = Family(
    schemas=("foxglove.SceneUpdate", "foxglove_msgs/msg/SceneUpdate"),
    fields={
        "stamp": Field(path=f"{_ENTITIES}.timestamp", kind="time"),
        "frame": Field(path=f"{_ENTITIES}.frame_id", kind="name"),
        "id": Field(path=f"{_ENTITIES}.id", kind="name"),
        "cube": Field(path=f"{_ENTITIES}.cubes[0]", kind="mark"),
        **xyz("p", f"{_ENTITIES}.cubes[0].pose.position"),
        "key": Field(path=f"{_NOTES}.key", kind="name"),
        "value": Field(path=f"{_NOTES}.value", kind="name"),
    },
    objects=_objects,
)
