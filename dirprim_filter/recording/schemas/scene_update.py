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
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.recording.decoding.field_columns import FieldColumns
from dirprim_filter.recording.schemas.family import SIZE, family

INT64_TEXT_LENGTH = 20
_ENTITIES, _NOTES = ".entities[]", ".entities[].metadata[]"
_CUBE, _CYLINDER, _MODEL = (f"{_ENTITIES}.{body}[0]" for body in ("cubes", "cylinders", "models"))
_PLACES = (("x", "y", "z"), ("r.x", "r.y", "r.z"), ("m.x", "m.y", "m.z"))
_ROUND = ("round.x", "round.y", "round.z")
SIZE_NOTES = ("length_m", "width_m", "height_m")
"""In the metadata: of what was observed, where the cube may be of a middling size."""
DRAWN_NOTE = "drawn"
"""In the metadata: the body is for the eye, and what is not noted beside it was not measured."""
HEADING_NOTE = "heading_rad"
"""In the metadata: of what was observed, where the cube may be turned into the course."""


def _by_bodies_and_notes(columns: FieldColumns, message: IntArray, known: dict[str, Any]) -> BoolArray:
    """What the metadata say, and the size, the place and the heading of the body; which entities have one."""
    notes = _Notes(columns, message.size)
    is_noted = notes.has("speed_mps")
    facing = np.where(columns.is_set("cube"), known["heading"], np.nan)
    if is_noted.any():
        facing = np.where(is_noted, notes.numbers(HEADING_NOTE), facing)
    known |= {
        "place": _of_body(columns, *_PLACES), "direction": notes.numbers("direction_rad"),
        "speed": notes.numbers("speed_mps"), "size": _sizes(columns, notes), "heading": facing,
        "group": notes.read("group", _group, np.zeros(message.size, np.int64)),
        "label": notes.read("category", str, np.full(message.size, "", columns.names("value").dtype)),
    }  # fmt: skip
    is_body = columns.is_set("cube")
    for other in ("cylinder", "model"):
        is_body = is_body | columns.is_set(other, default=False)
    return is_body


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


class _Notes:
    """The metadata of the entities."""

    def __init__(self, columns: FieldColumns, n: int) -> None:
        self._n, self._entity = n, columns.parent_of(_NOTES)
        self._key, self._value = columns.names("key"), columns.names("value")

    def has(self, key: str) -> BoolArray:
        """(n,) which entities have a note."""
        return self.read(key, lambda _: True, np.zeros(self._n, np.bool_))

    def numbers(self, key: str) -> FloatArray:
        """(n,) NaN, so unknown, where it is missing or no number."""
        return self.read(key, _number, np.full(self._n, np.nan))

    def read(self, key: str, parse: Callable[[str], object], found: AnyArray) -> AnyArray:
        """The array (n,), with what the note of each entity says where it has one."""
        is_key = self._key == key
        found[self._entity[is_key]] = [parse(text) for text in self._value[is_key].tolist()]
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


SCENE_UPDATE = family(
    "foxglove.SceneUpdate", "foxglove_msgs/msg/SceneUpdate",
    paths={
        "foxglove": _ENTITIES, "id": f"{_ENTITIES}.id", "cube": _CUBE, "cylinder": _CYLINDER, "model": _MODEL,
        "pose": f"{_CUBE}.pose", "size": f"{_CUBE}.size", "key": f"{_NOTES}.key", "value": f"{_NOTES}.value",
        **{name: f"{_CYLINDER}.pose.position.{name[-1]}" for name in _PLACES[1]},
        **{name: f"{_MODEL}.pose.position.{name[-1]}" for name in _PLACES[2]},
        **{name: f"{_CYLINDER}.size.{name[-1]}" for name in _ROUND},
    },
    amend=_by_bodies_and_notes,
)  # fmt: skip
