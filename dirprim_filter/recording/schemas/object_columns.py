"""The columns of a family's fields, which stand in tables of their own, as columns of the rows of its objects.

Bodies are turned by unit quaternions (x, y, z, w), which turn a vector of the body's axes into its frame's: x forward,
y left, z up (REP 103); the heading is the direction of x on the plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.columns import is_held
from dirprim_filter.recording.decoding.field_columns import FARTHEST_S, NO_TIME, FieldColumns

_DEG = np.pi / 180
UNITS = {
    "speed_kmh": ("speed", 1 / 3.6, 0.0), "direction_deg": ("direction", _DEG, 0.0),
    "course_deg": ("direction", -_DEG, np.pi / 2), "heading_deg": ("heading", _DEG, 0.0), "time_s": ("time", 1e9, 0.0),
}  # fmt: skip
"""What else may be given: for which name, by which factor, and what is added."""
GLOBE = ("longitude", "latitude")
"""Of an object's place, in the order of x and y; a family has these or x and y."""
OLDER = "|"
"""Between the paths of a name, newest first: the first that a schema has counts; and behind the names of older ones."""
_KNOWN_BY = {"heading": ("turned", "is_turned"), "motion": ("moves", "has_twist"), "covariance": ("is_measured",)}
"""Presence of a message, or a number: where it is not set, or 0, the quantity means nothing."""
UNLABELLED = -1
"""The number of an object whose class is unknown; as an index, the last of the names."""
STANDING_SPEED = 1e-3
"""Below this speed, m/s, the direction of a velocity is rounding error."""
NO_PROBABILITY = "confidences beyond 0 to 1 are no probabilities, and count as unknown; map them in a table of your own"


class ObjectColumns:
    """Columns of different tables, as columns of the rows of the place."""

    def __init__(self, columns: FieldColumns) -> None:
        self._columns = columns
        self._best: dict[str, tuple[IntArray, IntArray]] = {}
        for older in sorted((name for name in columns.fields if name.endswith(OLDER)), key=len, reverse=True):
            if older in columns.columns and columns.lacks(older[:-1]):
                columns.columns[older[:-1]] = columns.columns[older]
        self._place = next(columns.fields[name] for name in (GLOBE[0], "x") if name in columns.fields)
        self.message = columns.message_of(self._place.table)

    def __contains__(self, name: str) -> bool:
        """Whether the family asks for it."""
        return name in self._columns.fields

    def read(self, name: str, none: float | str = np.nan) -> Any:
        """(n,) floats, whole numbers or texts, as `none` is one, which stands where it is unknown."""
        if name in self:
            return self._spread(name, self._columns.read(name, none), none)
        for other, (same, factor, zero) in UNITS.items():
            if same == name and other in self:
                return zero + factor * self.read(other)
        return np.broadcast_to(none, self.message.shape)

    def vectors(self, names: Sequence[str]) -> FloatArray:
        """(n, k) beside each other."""
        if not any(name in self for name in names):
            return np.full((self.message.size, len(names)), np.nan)
        return np.stack([self.read(name) for name in names], axis=-1)

    def header(self) -> tuple[AnyArray, IntArray]:
        """(n,) the frame, and (n,) the stamp: the object's own where it states them, else those of its message.

        A frame in a header of its own that has no stamp was not filled in, unless the message's is empty.
        """
        frame, stamp_ns = self.read("frame", ""), self.times()
        if "own_frame" not in self:
            return frame, stamp_ns
        own, own_ns = self.read("own_frame", ""), self.times("own_time")
        has_stamp = (own_ns != NO_TIME) & (own_ns != 0)
        differs = (own != "") & (frame != "") & (own != frame)
        if (differs | (has_stamp & (stamp_ns != NO_TIME) & (stamp_ns != 0) & (own_ns != stamp_ns))).any():
            self._columns.notes.add("objects have another frame or stamp than their message; theirs counts if stamped")
        frame = np.where((own != "") & (has_stamp | ~differs), own, frame)
        return frame, np.where(has_stamp, own_ns, stamp_ns)

    def times(self, name: str = "time") -> IntArray:
        """(n,) the header's, `NO_TIME` where unknown."""
        if name in self:
            return np.asarray(self._spread(name, self._columns.read(name, NO_TIME), NO_TIME))
        seconds = self.read("time_s")
        fits = np.abs(seconds) < FARTHEST_S
        if (far := np.isfinite(seconds) & ~fits).any():
            why = f"expected seconds as time_s, got {seconds[far][0]:g}: are they ms, us or ns? time= takes whole ns"
            self._columns.fail(np.unique(self.message[far]), why)
        return np.where(fits, np.round(np.where(fits, seconds, 0.0) * 1e9).astype(np.int64), NO_TIME)

    def known(self, what: str, values: FloatArray) -> FloatArray:
        """The same, NaN where the message itself calls it unknown."""
        for name in filter(self._columns.columns.__contains__, _KNOWN_BY[what] if is_held(values) else ()):
            is_known = self.read(name, 0) > 0
            values = values if is_known.all() else np.where(is_known, values.T, np.nan).T
        return values

    def labels(self, words: Sequence[str]) -> AnyArray:
        """(n,) str; numbers by their words."""
        if not words:
            return np.asarray(self.read("label", ""))
        return np.asarray(self._spread("label", label_names(self._columns.read("label", UNLABELLED), words), ""))

    def confidence(self) -> FloatArray:
        """(n,) probabilities, as stated; NaN where unknown, as where an `existence` of ROS or protobuf is not set."""
        existence = self.read("existence")
        stated = np.where(existence == 0, np.nan, existence) if "existence" in self else self.read("confidence")
        if (wrong := (stated < 0) | (stated > 1)).any():
            self._columns.notes.add(NO_PROBABILITY)
            stated = np.where(wrong, np.nan, stated)
        return np.asarray(stated)

    def _guesses(self, table: str) -> tuple[IntArray, IntArray]:
        """Of guesses at objects, in a table below, the rows of the highest `score`, and of which object each is."""
        if table not in self._best:
            of = self._columns.parent_of(table)
            best = np.arange(of.size)
            if not (np.diff(of) > 0).all():  # else one guess at each, as is usual
                order = np.lexsort((-np.nan_to_num(self._columns.read("score")), of))
                of, first = np.unique(of[order], return_index=True)
                best = order[first]
            self._best[table] = of, best
        return self._best[table]

    def _spread(self, name: str, values: Any, none: object) -> Any:
        """Values of the name's table, one for each row of the place; messages where they do not fit fail."""
        one, columns = self._columns.fields[name], self._columns
        if one.table == self._place.table:
            return values
        if one.table == "":
            return values[self.message]
        if one.table.startswith(self._place.table) and "score" in self:
            of, best = self._guesses(one.table)
            out = np.full(self.message.size, none, dtype=values.dtype)
            out[of] = values[best]
            return out
        of = columns.message_of(one.table)
        if np.array_equal(of, self.message):
            return values
        n, has = (np.bincount(rows, minlength=columns.n_messages) for rows in (self.message, of))
        unlike = np.flatnonzero((n != has) & ((has > 0) | (not one.optional)))
        if unlike.size:
            columns.fail(unlike, f"{one.path}: expected as many as of {self._place.path}")
        out = np.full(self.message.size, none, dtype=values.dtype)
        out[(n == has)[self.message]] = values[(n == has)[of]]
        return out


def label_names(numbers: IntArray, words: Sequence[str]) -> AnyArray:
    """(n,) str: the words for (n,) classes, a number that has none in decimal; empty for `UNLABELLED`."""
    is_named = (numbers >= UNLABELLED) & (numbers < len(words))
    named = np.array([*words, ""])[np.where(is_named, numbers, UNLABELLED)]
    return named if is_named.all() else np.where(is_named, named, numbers.astype(np.str_))


def rotated(orientation: FloatArray, vector: FloatArray) -> FloatArray:
    """(n, 3) vectors of the bodies' axes in the axes of their frame.

    Args:
        orientation: (n, 4) quaternions of any length; one of length 0, which is not set, turns nothing.
        vector: (n, 3).
    """
    length = np.sqrt(np.square(orientation).sum(axis=-1))
    unset = length == 0
    x, y, z, w = orientation.T / np.where(unset, 1.0, length)
    w = np.where(unset, 1.0, w)
    a, b, c = vector.T
    # v + 2 u x (u x v + w v), written out: numpy's cross is slow
    p, q, r = y * c - z * b + w * a, z * a - x * c + w * b, x * b - y * a + w * c
    return np.stack([a + 2 * (y * r - z * q), b + 2 * (z * p - x * r), c + 2 * (x * q - y * p)], axis=-1)


def heading(orientation: FloatArray) -> FloatArray:
    """(n,) direction of the body's x axis, radians; NaN where the orientation is not set or points up."""
    x, y, z, w = orientation.T
    east, north = w * w + x * x - y * y - z * z, 2 * (x * y + w * z)
    return np.where((east == 0) & (north == 0), np.nan, np.arctan2(north, east))


def course(velocity: FloatArray, standing: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n,) direction and (n,) speed of velocities (n, 3); who stands has no course, `standing` stands in."""
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    direction = np.arctan2(velocity[:, 1], velocity[:, 0])
    return np.where(speed < STANDING_SPEED, standing, direction), speed
