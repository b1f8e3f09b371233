"""Families of schemas as data: where in a message each quantity of an object stands, under names alike in all.

A path is such as `.objects[].pose.position.x`. Paths through a repeated field all go through the same one, or stand
in messages beside each other at equal lengths (`.x[]` and `.y[]`); a path without `[]` holds for all objects of its
message.

Sources: std_msgs/Header.msg; geometry_msgs/PoseWithCovariance.msg (6 x 6, in the axes that the pose is given in);
sensor_msgs/NavSatFix.msg (3 x 3, east, north and up).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, Literal

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.columns import NO_COVARIANCE, is_broken_covariance, known_sizes
from dirprim_filter.recording.decoding.field_columns import Field, FieldColumns, Kind, steps_of
from dirprim_filter.recording.name_patterns import named_values
from dirprim_filter.recording.rows import LEFT_OUT, Rows
from dirprim_filter.recording.schemas.object_columns import GLOBE, OLDER, UNITS, ObjectColumns, course, heading, rotated

NAMES = (
    "x", "y", "z", "latitude", "longitude", "id", "time", "time_s", "frame", "vx", "vy", "vz", "speed", "speed_kmh",
    "direction", "direction_deg", "course_deg", "heading", "heading_deg", "qx", "qy", "qz", "qw", "cxx", "cxy", "cyy",
    "group", "label", "length", "width", "height", "confidence",
)  # fmt: skip
"""What `--fields` may name.

x, y, z are metres in the axes of `frame`, latitude and longitude degrees on WGS 84, to be projected to a plane. The
`time` is the header's, seconds and nanoseconds or whole nanoseconds. vx, vy, vz are the velocity over ground in that
frame, m/s; the direction is the course, the heading the yaw of the body, radians counter-clockwise from x unless the
name ends in `_deg`; course_deg is clockwise from north, the y axis; qx to qw are the quaternion that turns the body;
cxx, cxy, cyy the covariance of x and y; the confidence is a probability.
"""
GROUPS: dict[str, dict[str, str]] = {
    "header": {"time": ".stamp", "frame": ".frame_id"},
    "own": {"own_time": ".stamp", "own_frame": ".frame_id"},
    "foxglove": {"time": ".timestamp", "frame": ".frame_id"},
    "position": {"x": ".x", "y": ".y", "z": ".z"},
    "quaternion": {"qx": ".x", "qy": ".y", "qz": ".z", "qw": ".w"},
    "pose": {f"{axis}": f".position.{axis}" for axis in "xyz"}
    | {f"q{axis}": f".orientation.{axis}" for axis in "xyzw"},
    "velocity": {"vx": ".x", "vy": ".y", "vz": ".z"},
    "size": {"length": ".x", "width": ".y", "height": ".z"},
    "covariance6": {"cxx": "[0]", "cxy": "[1]", "cyy": "[7]"},
    "covariance3": {"cxx": "[0]", "cxy": "[1]", "cyy": "[4]"},
    "covariance2": {"cxx": "[0]", "cxy": "[1]", "cyy": "[3]"},
}
"""Names that stand for several below one path."""
GROUPS["guess"] = {f"guess_{name}": path for name, path in GROUPS["pose"].items()}
_KINDS: dict[str, Kind] = {
    **dict.fromkeys(("id", "frame", "own_frame", "axes", "label", "space", "key", "value", "host", "mover"), "name"),
    **dict.fromkeys(("time", "own_time", "measured"), "time"),
    **dict.fromkeys(("placed", "moves", "turned", "faces", "cube", "second", "cylinder", "model"), "presence"),
}  # fmt: skip
REQUIRED = frozenset({"x", "y", "longitude", "latitude", "time", "frame", "placed"})
"""Without these a schema of a known name is not read; a `frame` that is missing would be taken for the map's."""
SIZE, QUATERNION, VELOCITY = ("length", "width", "height"), ("qx", "qy", "qz", "qw"), ("vx", "vy", "vz")
COVARIANCE, CUE = ("cxx", "cxy", "cyy"), ("cue_turn", "cue_concentration")
GEODETIC = "WGS 84"
"""The frame of positions (longitude, latitude) in degrees and a height above the ellipsoid in metres."""
BY_PLACE = (
    "objects have no ids: each place in the message is taken for a vehicle; where vehicles change places, `dirprim "
    "track --no-ids` tracks them"
)
HIGHEST_M = 1e8
"""A fix that is higher is none; one whose height is unknown, NaN, is one."""
Shape = tuple[tuple[int, int, int], tuple[float, float, float]]
"""Of which of three numbers length, width and height are made, -1 for none, and by which factors."""
AS_BOX: Shape = ((0, 1, 2), (1.0, 1.0, 1.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """Schemas that say the same in the same fields, and how their objects are read.

    Attributes:
        schemas: names, of whatever encoding.
        fields: what is wanted of a message, by the names of `NAMES` and some more.
        in_body: the velocity is in the axes of the body, else in those of the frame; as where the frame that `axes`
            names is that of the position.
        names: where an object's name is: in `id` alone; the topic, where that is empty; or the topic and the place of
            the object in its message.
        labels: the words for the numbers in `label`.
        only: values of fields that the rows must have to be objects.
        shapes: what the three numbers of the size mean, by the number in `shape`; of others the size is unknown.
        amend: changes what was read, from the rows' (n,) messages and the columns of `Rows` by name, with `place`
            (n, 3) for the position; the rows of which it returns False are no objects.
    """

    schemas: tuple[str, ...]
    fields: Mapping[str, Field]
    in_body: bool = False
    names: Literal["id", "topic", "place"] = "id"
    labels: Sequence[str] = ()
    only: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    shapes: Mapping[int, Shape] = field(default_factory=dict)
    amend: Callable[[FieldColumns, IntArray, dict[str, Any]], BoolArray] | None = None

    def objects(self, columns: FieldColumns, topics: AnyArray) -> Rows:
        """The objects of the fields' columns and (n_messages,) topics; may mark messages as failed.

        A size that is not positive is unknown, as a field that was not set reads as 0.
        """
        of = ObjectColumns(columns)
        is_geodetic, size, (frame, stamp_ns) = GLOBE[0] in of, of.vectors(SIZE), of.header()
        facing = of.known("heading", heading(of.vectors(QUATERNION)) if "qw" in of else of.read("heading"))
        known: dict[str, Any] = {
            "place": of.vectors((*GLOBE, "z") if is_geodetic else ("x", "y", "z")),
            "track_id": self._names(of, topics),
            "stamp_ns": stamp_ns,
            "frame_id": np.full(of.message.size, GEODETIC) if is_geodetic else frame,
            "group": of.read("group", 0),
            "covariance": of.known("covariance", matrices(of.vectors(COVARIANCE))) if "cxx" in of else LEFT_OUT,
            "label": of.labels(self.labels) if "label" in of else LEFT_OUT,
            "size": shaped(size, of.read("shape", 0), self.shapes) if self.shapes else size,
            "cue": of.vectors(CUE),
            "confidence": of.confidence(),
            "heading": facing,
            **self._motion(of, facing, frame),
        }
        if "guess_x" in of:
            _fill_in(known, of)
        if is_geodetic:
            _forget_no_fixes(known["place"], of.read("status", 0))
        kept = np.ones(of.message.size, np.bool_) if self.amend is None else self.amend(columns, of.message, known)
        for name, values in self.only.items():
            kept = kept & np.isin(of.read(name, 0), values)
        if self.names == "place" and (np.diff(of.message) == 0).any():
            columns.notes.add(BY_PLACE)
        if "cxx" in of and is_broken_covariance(known["covariance"]).any():
            columns.notes.add(NO_COVARIANCE)
        place = known.pop("place")
        known["size"] = known_sizes(known["size"])
        known |= {name: finite(known[name], none) for name, none in (("climb", 0.0), ("heading", np.nan))}
        rows = Rows(message=of.message, position=place[:, :2].copy(), height=finite(place[:, 2], 0.0), **known)
        return rows[kept]

    def _motion(self, of: ObjectColumns, facing: FloatArray, frame: AnyArray) -> dict[str, FloatArray]:
        """Stated course and speed go before those of the velocity; the heading is the course of who stands."""
        direction, speed, climb = of.read("direction"), of.read("speed"), np.broadcast_to(0.0, of.message.shape)
        other = np.broadcast_to(np.nan, of.message.shape)
        if "vx" in of:
            velocity, in_body = of.vectors(VELOCITY), np.full(of.message.size, self.in_body)
            if "axes" in of:
                axes = np.strings.lstrip(of.read("axes", ""), "/")
                in_body &= (axes == "") | (axes != np.strings.lstrip(frame, "/"))
            if in_body.any():
                velocity = np.where(in_body[:, None], rotated(of.vectors(QUATERNION), velocity), velocity)
            moving, over_ground = course(velocity, facing)
            other = np.where(np.isnan(direction), np.where(in_body, -facing, facing), np.nan)
            speed = np.where(np.isfinite(speed), speed, over_ground)
            direction, climb = np.where(np.isfinite(direction), direction, moving), velocity[:, 2]
        motion = {"direction": direction, "speed": speed, "climb": climb, "other_axes": other}
        return {name: of.known("motion", values) for name, values in motion.items()}

    def _names(self, of: ObjectColumns, topics: AnyArray) -> AnyArray:
        if self.names == "place":
            place = np.arange(of.message.size) - np.searchsorted(of.message, of.message)
            return np.strings.add(np.strings.add(topics[of.message], "/"), place.astype(np.str_))
        own = of.read("id", "")
        if "space" in of:
            own = np.strings.add(np.strings.add(of.read("space", ""), "/"), own)
        return np.where(own == "", topics[of.message], own) if self.names == "topic" else own


def family(schemas: str, paths: str, *, at: str = "", required: bool = False, **more: Any) -> Family:
    """A family by the paths of its fields.

    Args:
        schemas: names, with spaces between.
        paths: `name=path`, with spaces between, by `NAMES`, `GROUPS` and what else a family asks for.
        at: what `@` stands for in a path.
        required: a schema must have all of them; else only those of `REQUIRED`.
        more: fields of `Family`.
    """
    kinds = _KINDS | ({"label": "number"} if more.get("labels") else {})
    fields = {}
    for part in paths.split():
        group, _, all_paths = part.partition("=")
        for name, below in GROUPS.get(group, {group: ""}).items():
            optional, kind = not (required or name in REQUIRED), kinds.get(name, "number")
            for i, path in enumerate(all_paths.replace("@", at).split(OLDER)):
                fields[name + i * OLDER] = Field(path=path + below, kind=kind, optional=optional)
    return Family(schemas=tuple(schemas.split()), fields=fields, **more)


@dataclass(frozen=True, slots=True)
class FieldMapping:
    """Objects of any schema, by the paths of their fields: `id=.objects[].id,x=.objects[].pose.position.x,...`.

    Args:
        paths: by the names of `NAMES`; or of `GROUPS`, as `pose` for position and quaternion.

    Raises:
        ValueError: a path is none, or names that do not go together.
    """

    paths: Mapping[str, str]

    def __post_init__(self) -> None:
        for path in self.paths.values():
            steps_of(path)
        names = self.family().fields.keys()
        for one, other in combinations(names, 2):
            if UNITS.get(one, (one,))[0] == UNITS.get(other, (other,))[0]:
                raise ValueError(f"fields: expected one of {one} and {other}, got both")
        for whole in ({"vx", "vy"}, {*QUATERNION}, {*COVARIANCE}):
            if names & whole not in (set(), whole):
                raise ValueError(f"fields: expected {' and '.join(sorted(whole))} together, got {self}")
        if {"x", "y", *GLOBE} & names not in ({"x", "y"}, {*GLOBE}):
            raise ValueError(f"fields: expected x= and y= at least, or latitude= and longitude=, got {self}")

    @classmethod
    def parse(cls, text: str) -> FieldMapping:
        """Of `name=path,name=path,...`.

        Raises:
            ValueError: names the part that is none.
        """
        return cls(named_values(text, [*NAMES, *GROUPS], of="fields"))

    def __str__(self) -> str:
        return ",".join(f"{name}={path}" for name, path in self.paths.items())

    def family(self) -> Family:
        """What reads such objects, of whatever schema: objects of their own messages are named after the topic."""
        is_alone = not any("[]" in self.paths.get(name, "") for name in (*GLOBE, "x", "position", "pose"))
        paths = " ".join(f"{name}={path}" for name, path in self.paths.items())
        return family("", paths, required=True, names="topic" if is_alone else "id")


def _fill_in(known: dict[str, Any], of: ObjectColumns) -> None:
    """A box that was not filled in is at (0, 0, 0) and has no size: the likeliest guess then says where it is."""
    empty = np.flatnonzero(~known["place"].any(axis=1) & ~(known["size"] > 0).any(axis=1))
    if empty.size:
        guess = of.vectors([f"guess_{name}" for name in ("x", "y", "z", *QUATERNION)])[empty]
        here = np.isfinite(guess[:, :3]).all(axis=1)
        known["place"][empty[here]] = guess[here, :3]
        known["heading"] = known["heading"].copy()
        known["heading"][empty[here]] = heading(guess[here, 3:])


def _forget_no_fixes(place: FloatArray, status: IntArray) -> None:
    """A receiver without a fix says so by a status below 0, by places that do not exist, or by unset fields."""
    longitude, latitude, height = place.T
    is_set = ((latitude != 0) | (longitude != 0)) & ~(np.abs(height) > HIGHEST_M)
    place[~((status >= 0) & is_set & (np.abs(latitude) <= 90) & (np.abs(longitude) <= 360))] = np.nan


def finite(column: FloatArray, none: float) -> FloatArray:
    """The column, (n,), with `none` where it is not finite."""
    return np.where(np.isfinite(column), column, none)


def matrices(upper: FloatArray) -> FloatArray:
    """(n, 2, 2) symmetric, of (n, 3) xx, xy and yy."""
    return upper[:, [0, 1, 1, 2]].reshape(-1, 2, 2)


def shaped(numbers: FloatArray, kind: IntArray, shapes: Mapping[int, Shape]) -> FloatArray:
    """(n, 3) metres of bodies of (n,) kinds, by the (n, 3) numbers that describe them."""
    found = np.full(numbers.shape, np.nan)
    for shape, (places, factors) in shapes.items():
        here = kind == shape
        if here.any():
            made = numbers[here][:, places] * factors
            made[:, np.array(places) < 0] = np.nan
            found[here] = made
    return found
