"""What the messages of a log say about objects, whatever their schema."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.recording.decoding.field_columns import FieldColumns
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.rows import LEFT_OUT, Rows
from dirprim_filter.recording.schemas.attitude import course, heading, rotated
from dirprim_filter.recording.schemas.field_groups import (
    COVARIANCE,
    ORIENTATION,
    POSITION,
    SIZE,
    VELOCITY,
    covariances,
)
from dirprim_filter.sizes import known_sizes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ObjectRows(Rows):
    """The objects of a batch of messages, those of a message together and in its order.

    Attributes:
        message: (n,) which message of the batch each is of, ascending.
        track_id: (n,) str; empty where the message knows the object by no name.
        stamp_ns: (n,) the time that the message itself carries, nanoseconds; `NO_TIME` where it carries none.
        frame_id: (n,) str, in whose axes position and direction are; empty where unknown, so the map's.
        position: (n, 2) metres.
        height: (n,) metres, the third coordinate; 0 where unknown.
        direction: (n,) course over ground, radians; NaN where unknown.
        speed: (n,) over ground, m/s; NaN where unknown.
        climb: (n,) velocity along the third axis, m/s; 0 where unknown.
        group: (n,) int64; 0 where the message knows no groups.
        covariance: (n, 2, 2) of the position's error, square metres; NaN where unknown.
        label: (n,) str, what the object is in the words of its schema; empty where unknown.
        size: (n, 3) length, width and height of the body, metres; NaN where unknown.
        heading: (n,) yaw of the body, radians; NaN where unknown.
        cue: (n, 2) what it signals of its next turn, as in `Detections`; NaN where it signals nothing.
    """

    message: IntArray
    track_id: AnyArray
    stamp_ns: IntArray
    frame_id: AnyArray
    position: FloatArray
    height: FloatArray
    direction: FloatArray = LEFT_OUT
    speed: FloatArray = LEFT_OUT
    climb: FloatArray = LEFT_OUT
    group: IntArray = LEFT_OUT
    covariance: FloatArray = LEFT_OUT
    label: AnyArray = LEFT_OUT
    size: FloatArray = LEFT_OUT
    heading: FloatArray = LEFT_OUT
    cue: FloatArray = LEFT_OUT

    NOTHING: ClassVar[Mapping[str, Any]] = {
        "direction": np.nan, "speed": np.nan, "climb": 0.0, "group": np.int64(0), "covariance": [[np.nan] * 2] * 2,
        "label": "", "size": [np.nan] * 3, "heading": np.nan, "cue": [np.nan] * 2,
    }  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """Schemas that say the same in the same fields, and how their objects are read.

    Attributes:
        schemas: names, of whatever encoding.
        fields: what is wanted of a message, by label.
        objects: from the fields' columns and (n_messages,) topics to the objects; may mark messages as failed.
    """

    schemas: tuple[str, ...]
    fields: Mapping[str, Field]
    objects: Callable[[FieldColumns, AnyArray], ObjectRows]


def object_rows(columns: FieldColumns, table: str, **known: Any) -> ObjectRows:
    """The objects that are the rows of a table.

    What is not `known` is read from the fields of the usual labels, as `field_groups` has them: `stamp`, `frame`, `id`,
    `p`, `c`, `size` and, for the heading, `q`; a value for each message holds for all objects in it.

    Args:
        columns: of the fields.
        table: whose rows are objects; empty where a message is one object.
        known: columns of `ObjectRows`, and `place` (n, 3) metres, as `rows_of` takes them.
    """
    message = columns.message_of(table)

    def read(label: str, values: AnyArray) -> AnyArray:
        return values[message] if table and columns.fields[label].table == "" else values

    has = columns.fields.__contains__
    if "stamp_ns" not in known:
        known["stamp_ns"] = read("stamp", columns.times("stamp"))
    if "frame_id" not in known:
        known["frame_id"] = read("frame", columns.names("frame")) if has("frame") else np.full(message.size, "")
    if "track_id" not in known:
        known["track_id"] = read("id", columns.names("id"))
    if "place" not in known:
        known["place"] = columns.vectors(POSITION)
    if "covariance" not in known and has(COVARIANCE[0]):
        known["covariance"] = covariances(columns)
    if "size" not in known and has(SIZE[0]):
        known["size"] = columns.vectors(SIZE)
    if "heading" not in known and has(ORIENTATION[0]):
        known["heading"] = heading(columns.vectors(ORIENTATION))
    return rows_of(message, **known)


def motion(columns: FieldColumns, yaw: FloatArray, *, in_body: bool = False) -> dict[str, FloatArray]:
    """Direction, speed and climb by the velocity under label `v`, NaN where its message is not set (label `moves`).

    Args:
        columns: of the fields.
        yaw: (n,) radians, the course of who stands.
        in_body: the velocity is in the axes of the body, that `q` turns.
    """
    velocity = columns.vectors(VELOCITY)
    if in_body:
        velocity = rotated(columns.vectors(ORIENTATION), velocity)
    if "moves" in columns.fields:
        velocity[~columns.is_set("moves")] = np.nan
    direction, speed = course(velocity, yaw)
    return {"direction": direction, "speed": speed, "climb": velocity[:, 2]}


def rows_of(message: IntArray, *, place: FloatArray, **known: Any) -> ObjectRows:
    """Rows of which all but the place may be unknown.

    The place is (n, 3) metres, of which an unknown height counts as 0; a size that is not positive is unknown, as a
    field that was not set reads as 0; so is a heading that is not finite. All else is as in `ObjectRows`.
    """
    for name, instead in (("climb", 0.0), ("heading", np.nan)):
        if known.get(name) is not None:
            known[name] = np.where(np.isfinite(known[name]), known[name], instead)
    if known.get("size") is not None:
        known["size"] = known_sizes(known["size"])
    height = np.where(np.isfinite(place[:, 2]), place[:, 2], 0.0)
    return ObjectRows(message=message, position=np.ascontiguousarray(place[:, :2]), height=height, **known)


NO_ROWS = rows_of(
    np.empty(0, np.int64), track_id=np.empty(0, np.str_), stamp_ns=np.empty(0, np.int64),
    frame_id=np.empty(0, np.str_), place=np.empty((0, 3)),
)  # fmt: skip
"""Nothing observed."""
