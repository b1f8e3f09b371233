"""Objects of `foxglove.SceneUpdate` messages, by the convention of nuScenes logs.

One entity is one object; its first cube is the object's body, or its first upright cylinder, or its first model;
other primitives (lines of a lane map, arrows, texts) are no objects, so entities without a body are passed over.
Velocity is not part of the schema. The metadata's `category` is what the object is. The size is the body's, a model's
and that of an estimate, noted as `drawn`, unknown, and the heading that of a cube.

Source: https://docs.foxglove.dev/docs/sdk/schemas/scene-update and https://github.com/foxglove/nuscenes2mcap.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dirprim_filter.arrays import BoolArray, IntArray
from dirprim_filter.recording.decoding.field_columns import FieldColumns
from dirprim_filter.recording.schemas.family import SIZE, family

_NOTES = ".entities[].metadata[]"
_ROUND = ("round.x", "round.y", "round.z")
_OTHERS = {"cylinder": (("r.x", "r.y", "r.z"), _ROUND), "model": (("m.x", "m.y", "m.z"), SIZE)}
"""Bodies in place of a cube: where each is, and its size, which a model has not, nor a cube."""
DRAWN_NOTE, ONCE_DRAWN = "drawn", "speed_mps"
"""In the metadata: the body is for the eye, its size was not measured; and what says so in our logs of before 2027."""


def _by_bodies_and_notes(columns: FieldColumns, message: IntArray, known: dict[str, Any]) -> BoolArray:
    """The size, the place and the heading of the body, and what it is; which entities have one."""
    entity, key, value = columns.parent_of(_NOTES), columns.names("key"), columns.names("value")
    is_body = columns.is_set("cube")
    known["heading"] = np.where(is_body, known["heading"], np.nan)
    for body, (place, size) in _OTHERS.items():
        here = ~is_body & columns.is_set(body, default=False)
        if here.any():  # rarely: most logs draw cubes alone
            known["place"][here], known["size"][here] = (columns.vectors(of)[here] for of in (place, size))
        is_body = is_body | here
    known["size"][entity[np.isin(key, (DRAWN_NOTE, ONCE_DRAWN))]] = np.nan
    is_label, known["label"] = key == "category", np.full(message.size, "", value.dtype)
    known["label"][entity[is_label]] = value[is_label]
    return is_body


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
