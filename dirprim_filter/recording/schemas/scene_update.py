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
from collections.abc import Callable
from typing import Any

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, IntArray
from dirprim_filter.recording.decoding.field_columns import FieldColumns
from dirprim_filter.recording.schemas.family import SIZE, family

INT64_TEXT_LENGTH = 20
_NOTES = ".entities[].metadata[]"
_ROUND = ("round.x", "round.y", "round.z")
_OTHERS = {"cylinder": (("r.x", "r.y", "r.z"), _ROUND), "model": (("m.x", "m.y", "m.z"), SIZE)}
"""Bodies in place of a cube: where each is, and its size, which a model has not, nor a cube."""
SIZE_NOTES = ("length_m", "width_m", "height_m")
"""In the metadata: of what was observed, where the cube may be of a middling size."""
DRAWN_NOTE = "drawn"
"""In the metadata: the body is for the eye, and what is not noted beside it was not measured."""
HEADING_NOTE = "heading_rad"
"""In the metadata: of what was observed, where the cube may be turned into the course."""


def _by_bodies_and_notes(columns: FieldColumns, message: IntArray, known: dict[str, Any]) -> BoolArray:
    """What the metadata say, and the size, the place and the heading of the body; which entities have one."""
    n, entity = message.size, columns.parent_of(_NOTES)
    key, value = columns.names("key"), columns.names("value")

    def noted(name: str, parse: Callable[[str], object] = _number, none: Any = np.nan) -> AnyArray:
        """(n,) what the note of each entity says, `none` where it has none."""
        found, is_named = np.full(n, none), key == name
        found[entity[is_named]] = [parse(text) for text in value[is_named].tolist()]
        return found

    is_body = columns.is_set("cube")
    facing = np.where(is_body, known["heading"], np.nan)
    for body, (place, size) in _OTHERS.items():
        here = ~is_body & columns.is_set(body, default=False)
        if here.any():  # rarely: most logs draw cubes alone
            known["place"][here], known["size"][here] = (columns.vectors(of)[here] for of in (place, size))
        is_body = is_body | here
    is_noted = noted("speed_mps", lambda _: True, np.False_)
    if is_noted.any():
        facing = np.where(is_noted, noted(HEADING_NOTE), facing)
    if (is_drawn := is_noted | noted(DRAWN_NOTE, lambda _: True, np.False_)).any():
        known["size"][is_drawn] = np.stack([noted(name) for name in SIZE_NOTES], axis=-1)[is_drawn]
    known |= {
        "direction": noted("direction_rad"), "speed": noted("speed_mps"), "heading": facing,
        "group": noted("group", _group, np.int64(0)), "label": noted("category", str, np.array("", value.dtype)),
    }  # fmt: skip
    return is_body


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
    "foxglove.SceneUpdate foxglove_msgs/msg/SceneUpdate",
    f"foxglove=@ id=@.id cube=@.cubes[0] cylinder=@.cylinders[0] model=@.models[0] pose=@.cubes[0].pose "
    f"size=@.cubes[0].size key={_NOTES}.key value={_NOTES}.value "
    + " ".join(
        f"r.{axis}=@.cylinders[0].pose.position.{axis} m.{axis}=@.models[0].pose.position.{axis} "
        f"round.{axis}=@.cylinders[0].size.{axis}" for axis in "xyz"
    ),
    at=".entities[]", amend=_by_bodies_and_notes,
)  # fmt: skip
