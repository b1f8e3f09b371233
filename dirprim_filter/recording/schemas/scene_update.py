"""Objects of `foxglove.SceneUpdate` messages, by the convention of nuScenes logs.

One entity is one object; its first cube is the object's body, or its first upright cylinder, or its first model;
other primitives (lines of a lane map, arrows, texts) are no objects, so entities without a body are passed over.
Velocity is not part of the schema: it is taken from the entity's metadata `direction_rad` and `speed_mps` where these
are, and `group` and `category`, what the object is, likewise. The size is the body's, a model's unknown, and the
heading that of a cube; where metadata tell the speed both stand there too, as `length_m`, `width_m`, `height_m` and
`heading_rad`, and those of the cube are but drawn.

Source: https://docs.foxglove.dev/docs/sdk/schemas/scene-update and https://github.com/foxglove/nuscenes2mcap.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dirprim_filter.recording.decoding.field_columns import Shredded
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.attitude import ORIENTATION, POSITION, heading, orientation, xyz
from dirprim_filter.recording.schemas.extents import SIZE, extents
from dirprim_filter.recording.schemas.object_rows import Family, ObservedRows, numbers, rows_of
from tessellation.arrays import AnyArray, BoolArray, FloatArray, IntArray

INT64_TEXT_LENGTH = 20
_ENTITIES = ".entities[]"
_NOTES = ".entities[].metadata[]"
_PLACES = (POSITION, ("r.x", "r.y", "r.z"), ("m.x", "m.y", "m.z"))
_ROUND = ("round.x", "round.y", "round.z")
SIZE_NOTES = ("length_m", "width_m", "height_m")
"""In the metadata: of what was observed, where the cube may be of a middling size."""
HEADING_NOTE = "heading_rad"
"""In the metadata: of what was observed, where the cube may be turned into the course."""


def _objects(shredded: Shredded, _topics: AnyArray) -> ObservedRows:
    message = shredded.message_of(_ENTITIES)
    notes = _Notes(shredded, message.size)
    is_body = shredded.marks("cube")
    for other in ("cylinder", "model"):
        is_body = is_body | shredded.marks(other, default=False)
    return rows_of(
        message,
        track_id=shredded.names("id"),
        stamp_ns=shredded.times("stamp"),
        frame_id=shredded.names("frame"),
        place=_of_body(shredded, *_PLACES),
        direction=notes.numbers("direction_rad"),
        speed=notes.numbers("speed_mps"),
        group=notes.groups(),
        label=notes.texts("category"),
        size=_sizes(shredded, notes),
        heading=_headings(shredded, notes),
    )[is_body]


def _of_body(shredded: Shredded, cube: Sequence[str], cylinder: Sequence[str], model: Sequence[str]) -> FloatArray:
    """(n, 3) of the cube where there is one, else of the cylinder, else of the model, by the labels of each."""
    is_cube, is_cylinder = shredded.marks("cube"), shredded.marks("cylinder", default=False)
    found = numbers(shredded, *cube)
    for here, labels in ((~is_cube & is_cylinder, cylinder), (~is_cube & ~is_cylinder, model)):
        if here.any():  # rarely: most logs draw cubes alone
            found[here] = numbers(shredded, *labels)[here]
    return found


def _sizes(shredded: Shredded, notes: _Notes) -> FloatArray:
    """(n, 3) metres."""
    drawn = _of_body(shredded, SIZE, _ROUND, SIZE)  # who has a model alone has no cube, so none of its size
    told = notes.has("speed_mps")
    if told.any():
        drawn[told] = np.stack([notes.numbers(key) for key in SIZE_NOTES], axis=-1)[told]
    return drawn


def _headings(shredded: Shredded, notes: _Notes) -> FloatArray:
    """(n,) radians; of who is no cube unknown."""
    drawn = np.where(shredded.marks("cube"), heading(numbers(shredded, *ORIENTATION)), np.nan)
    told = notes.has("speed_mps")
    return np.where(told, notes.numbers(HEADING_NOTE), drawn) if told.any() else drawn


class _Notes:
    """The metadata of the entities."""

    def __init__(self, shredded: Shredded, n: int) -> None:
        self._n = n
        self._entity = shredded.parent_of(_NOTES)
        self._key = shredded.names("key")
        self._value = shredded.names("value")

    def has(self, key: str) -> BoolArray:
        """(n,) which entities have a note."""
        found = np.zeros(self._n, np.bool_)
        found[self._entity[self._key == key]] = True
        return found

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


def _elsewhere(prefix: str, path: str) -> dict[str, Field]:
    return {f"{prefix}.{axis}": Field(path=f"{_ENTITIES}.{path}.{axis}", optional=True) for axis in "xyz"}


SCENE_UPDATE = Family(
    schemas=("foxglove.SceneUpdate", "foxglove_msgs/msg/SceneUpdate"),
    fields={
        "stamp": Field(path=f"{_ENTITIES}.timestamp", kind="time"),
        "frame": Field(path=f"{_ENTITIES}.frame_id", kind="name"),
        "id": Field(path=f"{_ENTITIES}.id", kind="name"),
        "cube": Field(path=f"{_ENTITIES}.cubes[0]", kind="mark"),
        "cylinder": Field(path=f"{_ENTITIES}.cylinders[0]", kind="mark", optional=True),
        "model": Field(path=f"{_ENTITIES}.models[0]", kind="mark", optional=True),
        **xyz("p", f"{_ENTITIES}.cubes[0].pose.position"),
        **orientation(f"{_ENTITIES}.cubes[0].pose.orientation"),
        **_elsewhere("r", "cylinders[0].pose.position"),
        **_elsewhere("m", "models[0].pose.position"),
        **extents(f"{_ENTITIES}.cubes[0].size"),
        **_elsewhere("round", "cylinders[0].size"),
        "key": Field(path=f"{_NOTES}.key", kind="name"),
        "value": Field(path=f"{_NOTES}.value", kind="name"),
    },
    objects=_objects,
)
