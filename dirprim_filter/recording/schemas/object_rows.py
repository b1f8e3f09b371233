"""What the messages of a log say about objects, whatever their schema."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np

from dirprim_filter.optional_columns import chosen, joined, unknown
from dirprim_filter.recording.decoding.field_columns import Shredded
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.sizes import known_sizes
from tessellation.arrays import AnyArray, BoolArray, FloatArray, IntArray

_OPTIONAL = ("size", "heading")


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservedRows:
    """The objects of a batch of messages, those of a message together and in its order.

    Attributes:
        message: (n,) which message of the batch each is of, ascending.
        track_id: (n,) str; empty where the message knows the object by no name.
        stamp_ns: (n,) the time that the message itself carries, nanoseconds; `NO_TIME` where it carries none.
        frame_id: (n,) str, in whose axes position and direction are; empty: not told, so the map's.
        position: (n, 2) metres.
        height: (n,) metres, the third coordinate; 0 where the message tells none.
        direction: (n,) course over ground, radians; NaN where the message does not tell.
        speed: (n,) over ground, m/s; NaN where the message does not tell.
        climb: (n,) velocity along the third axis, m/s; 0 where the message tells none.
        group: (n,) int64; 0 where the message knows no groups.
        covariance: (n, 2, 2) of the position's error, square metres; NaN where the message does not tell.
        label: (n,) str, what the object is in the words of its schema; empty where the message does not tell.
        size: (n, 3) length, width and height of the body, metres; NaN where the message does not tell.
        heading: (n,) yaw of the body, radians; NaN where the message does not tell.
    """

    message: IntArray
    track_id: AnyArray
    stamp_ns: IntArray
    frame_id: AnyArray
    position: FloatArray
    height: FloatArray
    direction: FloatArray
    speed: FloatArray
    climb: FloatArray
    group: IntArray
    covariance: FloatArray
    label: AnyArray
    size: FloatArray
    heading: FloatArray

    def __len__(self) -> int:
        return int(self.message.size)

    def __getitem__(self, rows: BoolArray | IntArray) -> Self:
        """The rows of a mask or of indices; the same rows where a mask leaves out none."""
        if rows.dtype == np.bool_ and rows.all():
            return self
        columns: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self)}
        columns = {n: chosen(column, rows) if n in _OPTIONAL else column[rows] for n, column in columns.items()}
        return replace(self, **columns)


def concatenated(parts: Sequence[ObservedRows]) -> ObservedRows:
    """All rows of all parts, of which there is at least one; `message` stays as it is."""
    if len(parts) == 1:
        return parts[0]
    columns: dict[str, Any] = {}
    for f in fields(ObservedRows):
        join = joined if f.name in _OPTIONAL else np.concatenate
        columns[f.name] = join([getattr(part, f.name) for part in parts])
    return ObservedRows(**columns)


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """Schemas that tell the same in the same fields, and how their objects are read.

    Attributes:
        schemas: names, of whatever encoding.
        fields: what is wanted of a message, by label.
        objects: from the fields' columns and (n_messages,) topics to the objects; may mark messages as failed.
    """

    schemas: tuple[str, ...]
    fields: Mapping[str, Field]
    objects: Callable[[Shredded, AnyArray], ObservedRows]


def numbers(shredded: Shredded, *labels: str) -> FloatArray:
    """(n, k) some columns of one table beside each other; NaN where missing."""
    return np.stack([shredded.numbers(label) for label in labels], axis=-1)


def rows_of(
    message: IntArray,
    *,
    track_id: AnyArray,
    stamp_ns: IntArray,
    frame_id: AnyArray,
    place: FloatArray,
    direction: FloatArray | None = None,
    speed: FloatArray | None = None,
    climb: FloatArray | None = None,
    group: IntArray | None = None,
    covariance: FloatArray | None = None,
    label: AnyArray | None = None,
    size: FloatArray | None = None,
    heading: FloatArray | None = None,
) -> ObservedRows:
    """Rows of which all but the place may be unknown.

    Args:
        message: (n,) ascending.
        track_id: (n,) str.
        stamp_ns: (n,) nanoseconds.
        frame_id: (n,) str.
        place: (n, 3) metres; an unknown height counts as 0.
        direction: (n,) radians.
        speed: (n,) m/s.
        climb: (n,) m/s.
        group: (n,) int64.
        covariance: (n, 2, 2) square metres.
        label: (n,) str.
        size: (n, 3) metres; what is not positive is unknown: a field that nobody set reads as 0.
        heading: (n,) radians; what is not finite is unknown.
    """
    none = np.full(message.size, np.nan)
    return ObservedRows(
        message=message,
        track_id=track_id,
        stamp_ns=stamp_ns,
        frame_id=frame_id,
        position=np.ascontiguousarray(place[:, :2]),
        height=np.where(np.isfinite(place[:, 2]), place[:, 2], 0.0),
        direction=none if direction is None else direction,
        speed=none if speed is None else speed,
        climb=np.zeros(message.size) if climb is None else np.where(np.isfinite(climb), climb, 0.0),
        group=np.zeros(message.size, np.int64) if group is None else group,
        covariance=np.full((message.size, 2, 2), np.nan) if covariance is None else covariance,
        label=np.full(message.size, "") if label is None else label,
        size=unknown(message.size, 3) if size is None else known_sizes(size),
        heading=unknown(message.size) if heading is None else np.where(np.isfinite(heading), heading, np.nan),
    )


NO_ROWS = rows_of(
    np.empty(0, np.int64),
    track_id=np.empty(0, np.str_),
    stamp_ns=np.empty(0, np.int64),
    frame_id=np.empty(0, np.str_),
    place=np.empty((0, 3)),
)
"""Nothing observed."""
