"""What the messages of a log say about objects, whatever their schema."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.columns import known_sizes
from dirprim_filter.recording.decoding.field_columns import NO_TIME
from dirprim_filter.recording.rows import LEFT_OUT, Rows


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ObjectRows(Rows):
    """The objects of a batch of messages, those of a message together and in its order.

    Attributes:
        message: (n,) which message of the batch each is of, ascending.
        track_id: (n,) str; empty where the message knows the object by no name.
        stamp_ns: (n,) the time that the message itself carries, nanoseconds; `NO_TIME` where it carries none.
        time_ns: (n,) the time that counts; `NO_TIME` until it is known.
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
    time_ns: IntArray = LEFT_OUT
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
        "time_ns": np.int64(NO_TIME), "direction": np.nan, "speed": np.nan, "climb": 0.0, "group": np.int64(0),
        "covariance": [[np.nan] * 2] * 2, "label": "", "size": [np.nan] * 3, "heading": np.nan, "cue": [np.nan] * 2,
    }  # fmt: skip


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
