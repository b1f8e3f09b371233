"""Objects of any schema, by the paths of their fields: `id=.objects[].id,x=.objects[].pose.position.x,...`."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.recording.decoding.field_columns import NANOSECONDS, NO_TIME, FieldColumns
from dirprim_filter.recording.decoding.fields import Field, Kind, steps_of
from dirprim_filter.recording.schemas.attitude import course
from dirprim_filter.recording.schemas.location import GEODETIC
from dirprim_filter.recording.schemas.object_rows import Family, ObjectRows, rows_of

_KINDS: dict[str, Kind] = {"id": "name", "frame": "name", "label": "name", "time": "time"}
SIZE = ("length", "width", "height")
KMH = 3.6
FARTHEST_S = float(1 << 63) / NANOSECONDS
"""Seconds from here on do not fit into int64 nanoseconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldMapping:
    """Paths of what is to be read, such as `.objects[].pose.position.x`; None for what a schema does not contain.

    Paths through a repeated field all go through the same one, or stand in messages beside each other at equal
    lengths (`.x[]` and `.y[]`); a path without `[]` holds for all objects of its message. The time is a message of
    seconds and nanoseconds, or whole nanoseconds.

    Attributes:
        x: metres; or longitude and latitude in its place and that of y.
        y: metres.
        latitude: degrees on WGS 84, to be projected to a plane.
        longitude: likewise.
        z: metres.
        id: the vehicle's name; left out: the topic's, of single objects.
        time: the time of the header.
        time_s: the same in seconds.
        frame: name of the frame that x and y are in.
        vx: velocity over ground in that frame, m/s.
        vy: the same along y.
        speed: m/s.
        speed_kmh: km/h.
        direction: course over ground, radians counter-clockwise from x.
        direction_deg: the same in degrees.
        heading: yaw of the body, radians; the course is derived from positions.
        heading_deg: the same in degrees.
        group: a whole number.
        label: what the object is.
        length: of the body, metres.
        width: the same across.
        height: the same upwards.
    """

    x: str | None = None
    y: str | None = None
    latitude: str | None = None
    longitude: str | None = None
    z: str | None = None
    id: str | None = None
    time: str | None = None
    time_s: str | None = None
    frame: str | None = None
    vx: str | None = None
    vy: str | None = None
    speed: str | None = None
    speed_kmh: str | None = None
    direction: str | None = None
    direction_deg: str | None = None
    heading: str | None = None
    heading_deg: str | None = None
    group: str | None = None
    label: str | None = None
    length: str | None = None
    width: str | None = None
    height: str | None = None

    def __post_init__(self) -> None:
        paths = self._paths()
        for path in paths.values():
            steps_of(path)
        for one, other in (
            ("time", "time_s"), ("speed", "speed_kmh"), ("direction", "direction_deg"), ("heading", "heading_deg")
        ):  # fmt: skip
            if one in paths and other in paths:
                raise ValueError(f"fields: expected one of {one} and {other}, got both")
        if ("vx" in paths) != ("vy" in paths):
            raise ValueError("fields: expected vx and vy together, got one of them")
        if {"x", "y", "latitude", "longitude"} & set(paths) not in ({"x", "y"}, {"latitude", "longitude"}):
            raise ValueError(f"fields: expected x= and y= at least, or latitude= and longitude=, got {self}")

    @classmethod
    def parse(cls, text: str) -> FieldMapping:
        """Of `name=path,name=path,...`.

        Raises:
            ValueError: names the part that is none.
        """
        known = [f.name for f in fields(cls)]
        paths: dict[str, str] = {}
        for part in text.split(","):
            name, _, path = (word.strip() for word in part.partition("="))
            if name not in known or not path or name in paths:
                raise ValueError(f"fields: expected name=path, each of {', '.join(known)} once, got {part!r}")
            paths[name] = path
        return cls(**paths)

    def __str__(self) -> str:
        return ",".join(f"{name}={path}" for name, path in self._paths().items())

    def _paths(self) -> dict[str, str]:
        paths = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: path for name, path in paths.items() if path is not None}

    def family(self) -> Family:
        """What reads such objects, of whatever schema."""
        wanted = {name: Field(path=path, kind=_KINDS.get(name, "number")) for name, path in self._paths().items()}
        return Family(schemas=(), fields=wanted, objects=_objects)


class _Rows:
    """Columns of different tables, as columns of the rows of the place."""

    def __init__(self, columns: FieldColumns) -> None:
        self._columns = columns
        self.is_geodetic = "longitude" in columns.fields
        self._place = columns.fields["longitude" if self.is_geodetic else "x"]
        self._table = self._place.table
        self.message = columns.message_of(self._table)

    @property
    def is_alone(self) -> bool:
        """Whether a message holds one object."""
        return self._table == ""

    def has(self, label: str) -> bool:
        """Whether the mapping asks for it."""
        return label in self._columns.fields

    def spread(self, label: str, values: AnyArray, none: object) -> AnyArray:
        """Values of the label's table, one for each row of the place; messages where they do not fit fail."""
        table = self._columns.fields[label].table
        if table == self._table:
            return values
        if table == "":
            return values[self.message]
        of = self._columns.message_of(table)
        n = np.bincount(self.message, minlength=self._columns.n_messages)
        has = np.bincount(of, minlength=self._columns.n_messages)
        unlike = np.flatnonzero(n != has)
        if unlike.size:
            path = self._columns.fields[label].path
            self._columns.fail(unlike, f"expected as many of {path} as of {self._place.path}")
        out = np.full(self.message.size, none, dtype=values.dtype)
        out[~np.isin(self.message, unlike)] = values[~np.isin(of, unlike)]
        return out

    def number(self, label: str, factor: float = 1.0) -> FloatArray:
        """A column of numbers, NaN where the mapping does not ask for it."""
        if not self.has(label):
            return np.full(self.message.size, np.nan)
        return np.asarray(self.spread(label, self._columns.numbers(label), np.nan) * factor, np.float64)

    def name(self, label: str, otherwise: AnyArray) -> AnyArray:
        """A column of names."""
        return self.spread(label, self._columns.names(label), "") if self.has(label) else otherwise

    def time_ns(self) -> IntArray:
        """The times of the header."""
        if self.has("time"):
            return self.spread("time", self._columns.times("time"), NO_TIME)
        seconds = self.number("time_s")
        fits = np.abs(seconds) < FARTHEST_S
        return np.where(fits, np.round(np.where(fits, seconds, 0.0) * 1e9).astype(np.int64), NO_TIME)


def _objects(columns: FieldColumns, topics: AnyArray) -> ObjectRows:
    rows = _Rows(columns)
    either = {
        "speed": np.where(rows.has("speed"), rows.number("speed"), rows.number("speed_kmh", 1 / KMH)),
        "direction": np.where(
            rows.has("direction"), rows.number("direction"), rows.number("direction_deg", np.pi / 180)
        ),
        "heading": np.where(rows.has("heading"), rows.number("heading"), rows.number("heading_deg", np.pi / 180)),
    }
    direction, speed = either["direction"], either["speed"]
    if rows.has("vx"):
        moving, over_ground = course(np.column_stack([rows.number("vx"), rows.number("vy")]), either["heading"])
        speed = np.where(np.isfinite(speed), speed, over_ground)
        direction = np.where(np.isfinite(direction), direction, moving)
    alone = topics[rows.message] if rows.is_alone else np.full(rows.message.size, "")
    place = ("longitude", "latitude", "z") if rows.is_geodetic else ("x", "y", "z")
    nowhere = np.full(rows.message.size, GEODETIC if rows.is_geodetic else "")
    group = rows.number("group")
    return rows_of(
        rows.message,
        track_id=rows.name("id", alone),
        stamp_ns=rows.time_ns(),
        frame_id=nowhere if rows.is_geodetic else rows.name("frame", nowhere),
        place=np.column_stack([rows.number(name) for name in place]),
        direction=direction,
        speed=speed,
        group=np.where(np.isfinite(group), group, 0).astype(np.int64),
        label=rows.name("label", np.full(rows.message.size, "")),
        size=np.column_stack([rows.number(name) for name in SIZE]) if any(map(rows.has, SIZE)) else None,
        heading=either["heading"],
    )
