"""Rows of objects, as the messages of logs and the lines of tables report them, and the tracks that they make."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from dirprim_filter.arrays import AnyArray, ArrayValue, BoolArray, FloatArray, IntArray
from dirprim_filter.columns import column_fields
from dirprim_filter.distributions.angles import wrap
from dirprim_filter.recording.decoding.field_columns import NO_TIME
from dirprim_filter.recording.losses import ALONE, Losses
from dirprim_filter.track_ids import Numbers, as_track_ids, numbered, stand_for_none, vehicle_numbers
from dirprim_filter.tracks import Tracks

LEFT_OUT: Any = None
"""Stands for a column that nothing is known of: one row then stands for all."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rows(ArrayValue):
    """Objects, those of a message together and in its order. Of most columns many sources know nothing.

    Attributes:
        position: (n, 2) metres; not finite where unknown.
        track_id: (n,) str, empty where the source knows the object by no name; or int64, the place of its name among
            `names`: a column of text is as wide as its longest.
        names: (m,) str, of the vehicles; those of several groups may share one. Left out where `track_id` is of text.
        message: (n,) which message of the batch each is of, ascending.
        stamp_ns: (n,) the time that the message itself carries, nanoseconds; `NO_TIME` where it carries none.
        time_ns: (n,) the time that counts; `NO_TIME` until it is known.
        frame_id: (n,) str, in whose axes position and direction are; empty where unknown, so the map's.
        height: (n,) metres, the third coordinate; 0 where unknown.
        direction: (n,) course over ground, radians; NaN where unknown.
        speed: (n,) over ground, m/s; NaN where unknown.
        climb: (n,) velocity along the third axis, m/s; 0 where unknown.
        other_axes: (n,) by how much the course turns, radians, if the velocity is not in the axes that its schema says,
            the body's or the frame's, but in the other ones; NaN where this cannot be.
        group: (n,) int64; 0 where the source knows no groups.
        covariance: (n, 2, 2) of the position's error, square metres; NaN where unknown.
        label: (n,) str, what the object is in the words of its source; empty where unknown.
        size: (n, 3) length, width and height of the body, metres; NaN where unknown.
        heading: (n,) yaw of the body, radians; NaN where unknown.
        cue: (n, 2) what it signals of its next turn, as in `Detections`; NaN where it signals nothing.
        confidence: (n,) probability that there is such an object, as stated; NaN where unknown.
    """

    position: FloatArray
    track_id: AnyArray = LEFT_OUT
    names: AnyArray = LEFT_OUT
    message: IntArray = LEFT_OUT
    stamp_ns: IntArray = LEFT_OUT
    time_ns: IntArray = LEFT_OUT
    frame_id: AnyArray = LEFT_OUT
    height: FloatArray = LEFT_OUT
    direction: FloatArray = LEFT_OUT
    speed: FloatArray = LEFT_OUT
    climb: FloatArray = LEFT_OUT
    other_axes: FloatArray = LEFT_OUT
    group: IntArray = LEFT_OUT
    covariance: FloatArray = LEFT_OUT
    label: AnyArray = LEFT_OUT
    size: FloatArray = LEFT_OUT
    heading: FloatArray = LEFT_OUT
    cue: FloatArray = LEFT_OUT
    confidence: FloatArray = LEFT_OUT

    NOTHING: ClassVar[Mapping[str, Any]] = {
        "track_id": "", "message": np.int64(0), "stamp_ns": np.int64(NO_TIME), "time_ns": np.int64(NO_TIME),
        "frame_id": "", "height": 0.0, "direction": np.nan, "speed": np.nan, "climb": 0.0, "other_axes": np.nan,
        "group": np.int64(0), "covariance": [[np.nan] * 2] * 2, "label": "", "size": [np.nan] * 3, "heading": np.nan,
        "cue": [np.nan] * 2, "confidence": np.nan,
    }  # fmt: skip

    def __post_init__(self) -> None:
        for name, nothing in self.NOTHING.items():
            if getattr(self, name) is LEFT_OUT:
                object.__setattr__(self, name, np.broadcast_to(nothing, (len(self), *np.shape(nothing))))

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, rows: BoolArray | IntArray) -> Rows:
        """The rows of a mask or of indices; the same rows where a mask leaves out none."""
        if rows.dtype == np.bool_ and rows.all():
            return self
        position = self.position[rows]
        chosen: dict[str, AnyArray] = {"position": position}
        for name, column in ((name, getattr(self, name)) for name in self.NOTHING):
            alike = column.strides[0] == 0 and len(self) > 0  # one row stands for all, and so it stays
            chosen[name] = np.broadcast_to(column[0], (len(position), *column.shape[1:])) if alike else column[rows]
        return replace(self, **chosen)

    @classmethod
    def concatenate(cls, parts: Iterable[Rows], names: AnyArray = LEFT_OUT, but: Sequence[str] = ()) -> Rows:
        """All rows of all parts, `but` for some columns; `names` are those of all their vehicles."""
        whole = [*parts] or [cls(position=np.empty((0, 2)))]
        held = [name for name in ("position", *cls.NOTHING) if name not in but]
        return cls(names=names, **{name: np.concatenate([getattr(part, name) for part in whole]) for name in held})

    @classmethod
    def of_tracks(cls, tracks: Tracks) -> Rows:
        """Tracks as rows, to be joined with others."""
        columns = {f.name: getattr(tracks, f.name) for f in column_fields(type(tracks))}
        names, columns["track_id"] = numbered(tracks.track_id)
        return cls(names=np.array(names, np.str_), **columns)

    def by_group(self) -> Rows:
        """The same, of which an id that stands in several groups is a vehicle in each."""
        vehicle = vehicle_numbers(self.track_id, self.group)
        _, first = np.unique(vehicle, return_index=True)
        return replace(self, names=self.names[self.track_id[first]], track_id=vehicle)

    def has_motion(self) -> BoolArray:
        """(n,) where both course and speed are known."""
        return np.asarray(np.isfinite(self.direction) & np.isfinite(self.speed))

    def is_known_throughout(self) -> BoolArray:
        """(n,) rows of vehicles, by number, of which all rows have motion."""
        of_vehicle = np.ones(int(self.track_id.max(initial=-1)) + 1, np.bool_)
        of_vehicle[self.track_id[~self.has_motion()]] = False
        return of_vehicle[self.track_id]

    def to_tracks(self, losses: Losses) -> Tracks:
        """The tracks of rows with `names`; those that are alone in time are left out, and noted.

        Direction and speed are taken where all rows of a vehicle have them, and else derived from its positions. Where
        only the speed is known, or the heading of the body, both stay, and the direction is derived.
        """
        whole, ids = self.is_known_throughout(), as_track_ids(self.names)
        known, rest = self[whole], self[~whole]
        taken, derived = (
            make(
                track_id=ids[rows.track_id], time_ns=rows.time_ns, position=rows.position, group=rows.group,
                size=rows.size, heading=wrap(rows.heading), **motion,
            )
            for make, rows, motion in (
                (Tracks, known, dict[str, Any](direction=wrap(known.direction), speed=known.speed)),
                (Tracks.from_positions, rest, dict[str, Any](speed=rest.speed)),
            )
        )  # fmt: skip
        losses.note(ALONE, len(rest) - len(derived))
        return Tracks.concatenate([part for part in (taken, derived) if len(part)] or [taken])


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackResult:
    """Tracks of one or more logs, and what was lost on the way.

    Attributes:
        tracks: what was read.
        losses: what was damaged, left out or odd.
        frame: of the last log's positions: a frame's name, or "plane at LATITUDE,LONGITUDE"; empty where none is named.
        labels: what vehicles are, in the words of their log, by id as text; of those that have a label.
    """

    tracks: Tracks
    losses: Losses
    frame: str = ""
    labels: Mapping[str, str] = field(default_factory=dict)


OF_MESSAGES = tuple(Rows.NOTHING.keys() - {column.name for column in column_fields(Tracks)})
"""Columns that tracks do not hold."""


def rows_of_log(parts: Iterable[Rows]) -> Rows:
    """The rows of all batches, one after the other.

    An object without a name gets one of its own, "time/number": nothing is taken for the same vehicle at two
    times, and what such a row says of its motion is kept. An id that stands in several groups is a vehicle in each.
    """
    numbers, without = Numbers(), dict.fromkeys(OF_MESSAGES, LEFT_OUT)
    read = [replace(rows, track_id=numbers.of(rows.track_id.tolist()), **without) for rows in parts]
    read = read or [Rows(track_id=numbers.of(()), position=np.empty((0, 2)))]
    whole = Rows.concatenate(read, names=np.array(list(numbers), dtype=np.str_), but=OF_MESSAGES)
    if (is_none := stand_for_none(whole.names, whole.track_id, whole.time_ns)[whole.track_id]).any():
        made = [f"{time}/{i}" for i, time in enumerate(whole.time_ns[is_none].tolist())]
        number = whole.track_id.copy()
        number[is_none] = whole.names.size + np.arange(len(made))
        whole = replace(whole, track_id=number, names=np.array([*whole.names.tolist(), *made], np.str_))
    return whole.by_group() if whole.group.any() else whole


def rows_of_logs(logs: Sequence[Rows], names: Sequence[str]) -> Rows:
    """The rows of several logs: groups numbered anew, ids that stand in more than one made different.

    Args:
        logs: at least one, with `names`.
        names: what each is called; of equal names all get their number in the sequence behind.
    """
    if len(logs) == 1:
        return logs[0]
    names = [f"{name}-{i}" if names.count(name) > 1 else name for i, name in enumerate(names)]
    own, n_logs = np.unique(np.concatenate([np.unique(log.names) for log in logs]), return_counts=True)
    parts, vehicles, n_vehicles, n_groups = [], [], 0, 0
    for log, name in zip(logs, names, strict=True):
        is_shared = np.isin(log.names, own[n_logs > 1])
        vehicles.append(np.where(is_shared, np.char.add(f"{name}/", log.names), log.names))
        known, group = np.unique(log.group, return_inverse=True)
        parts.append(replace(log, track_id=log.track_id + n_vehicles, group=group.astype(np.int64) + n_groups))
        n_vehicles += log.names.size
        n_groups += known.size
    return Rows.concatenate(parts, names=np.concatenate(vehicles))
