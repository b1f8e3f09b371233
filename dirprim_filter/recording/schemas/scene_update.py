"""Objects of `foxglove.SceneUpdate` messages, by the convention of nuScenes logs.

One entity is one object; its first cube is the object's body, or its first upright cylinder, or its first model;
other primitives (lines of a lane map, arrows, texts) are no objects, so entities without a body are passed over.
Velocity is not part of the schema: it is taken from the entity's metadata `direction_rad` and `speed_mps` where these
are, and `group` and `category`, what the object is, likewise. The size is the body's, a model's and that of an
estimate, noted as `drawn`, unknown, and the heading that of a cube; where metadata contain the speed both are there
too, as `length_m`, `width_m`, `height_m` and `heading_rad`, and those of the cube are but drawn.

Source: https://docs.foxglove.dev/docs/sdk/schemas/scene-update and https://github.com/foxglove/nuscenes2mcap.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.recording.decoding.field_columns import FieldColumns
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.attitude import heading
from dirprim_filter.recording.schemas.field_groups import (
    ORIENTATION,
    POSITION,
    SIZE,
    extents,
    foxglove_header,
    pose,
    xyz,
)
from dirprim_filter.recording.schemas.object_rows import Family, ObjectRows, object_rows

INT64_TEXT_LENGTH = 20
_ENTITIES = ".entities[]"
_NOTES = ".entities[].metadata[]"
_PLACES = (POSITION, ("r.x", "r.y", "r.z"), ("m.x", "m.y", "m.z"))
_ROUND = ("round.x", "round.y", "round.z")
SIZE_NOTES = ("length_m", "width_m", "height_m")
"""In the metadata: of what was observed, where the cube may be of a middling size."""
DRAWN_NOTE = "drawn"
"""In the metadata: the body is for the eye, and what is not noted beside it was not measured."""
HEADING_NOTE = "heading_rad"
"""In the metadata: of what was observed, where the cube may be turned into the course."""


def _objects(columns: FieldColumns, _topics: AnyArray) -> ObjectRows:
    message = columns.message_of(_ENTITIES)
    notes = _Notes(columns, message.size)
    is_body = columns.is_set("cube")
    for other in ("cylinder", "model"):
        is_body = is_body | columns.is_set(other, default=False)
    return object_rows(
        columns, _ENTITIES, place=_of_body(columns, *_PLACES), direction=notes.numbers("direction_rad"),
        speed=notes.numbers("speed_mps"), group=notes.groups(), label=notes.texts("category"),
        size=_sizes(columns, notes), heading=_headings(columns, notes),
    )[is_body]  # fmt: skip


def _of_body(columns: FieldColumns, cube: Sequence[str], cylinder: Sequence[str], model: Sequence[str]) -> FloatArray:
    """(n, 3) of the cube where there is one, else of the cylinder, else of the model, by the labels of each."""
    is_cube, is_cylinder = columns.is_set("cube"), columns.is_set("cylinder", default=False)
    found = columns.vectors(cube)
    for here, labels in ((~is_cube & is_cylinder, cylinder), (~is_cube & ~is_cylinder, model)):
        if here.any():  # rarely: most logs draw cubes alone
            found[here] = columns.vectors(labels)[here]
    return found


def _sizes(columns: FieldColumns, notes: _Notes) -> FloatArray:
    """(n, 3) metres."""
    drawn = _of_body(columns, SIZE, _ROUND, SIZE)  # who has a model alone has no cube, so none of its size
    noted = notes.has("speed_mps") | notes.has(DRAWN_NOTE)
    if noted.any():
        drawn[noted] = np.stack([notes.numbers(key) for key in SIZE_NOTES], axis=-1)[noted]
    return drawn


def _headings(columns: FieldColumns, notes: _Notes) -> FloatArray:
    """(n,) radians; of who is no cube unknown."""
    drawn = np.where(columns.is_set("cube"), heading(columns.vectors(ORIENTATION)), np.nan)
    noted = notes.has("speed_mps")
    return np.where(noted, notes.numbers(HEADING_NOTE), drawn) if noted.any() else drawn


class _Notes:
    """The metadata of the entities."""

    def __init__(self, columns: FieldColumns, n: int) -> None:
        self._n = n
        self._entity = columns.parent_of(_NOTES)
        self._key = columns.names("key")
        self._value = columns.names("value")

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


SCENE_UPDATE = Family(
    schemas=("foxglove.SceneUpdate", "foxglove_msgs/msg/SceneUpdate"),
    fields={
        **foxglove_header(_ENTITIES),
        "id": Field(path=f"{_ENTITIES}.id", kind="name"),
        "cube": Field(path=f"{_ENTITIES}.cubes[0]", kind="presence"),
        "cylinder": Field(path=f"{_ENTITIES}.cylinders[0]", kind="presence", optional=True),
        "model": Field(path=f"{_ENTITIES}.models[0]", kind="presence", optional=True),
        **pose(f"{_ENTITIES}.cubes[0].pose", optional=True),
        **xyz("r", f"{_ENTITIES}.cylinders[0].pose.position", optional=True),
        **xyz("m", f"{_ENTITIES}.models[0].pose.position", optional=True),
        **extents(f"{_ENTITIES}.cubes[0].size"),
        **xyz("round", f"{_ENTITIES}.cylinders[0].size", optional=True),
        "key": Field(path=f"{_NOTES}.key", kind="name"),
        "value": Field(path=f"{_NOTES}.value", kind="name"),
    },
    objects=_objects,
)
