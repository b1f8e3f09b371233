"""Rows of vehicles as logs and tables hold them, and the tracks that they make."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from dirprim_filter.arrays import AnyArray, ArrayValue, BoolArray, FloatArray, IntArray
from dirprim_filter.optional_columns import chosen, joined, unknown
from dirprim_filter.recording.losses import ALONE, Losses
from dirprim_filter.track_ids import as_track_ids, numbered
from dirprim_filter.tracks import Tracks

OPTIONAL: dict[str, tuple[int, ...]] = {"direction": (), "speed": (), "size": (3,), "heading": ()}
"""The shape of a row of each; `optional_columns.unknown` may stand for a column without any value."""
LEFT_OUT: Any = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VehicleRows(ArrayValue):
    """Rows that are not yet tracks.

    Attributes:
        names: (m,) str, of the vehicles; those of several groups may share one.
        vehicle: (n,) int64, the place of each row's vehicle among them: a column of text is as wide as its longest.
        time_ns: (n,) int64; `NO_TIME` where unknown.
        position: (n, 2) metres; not finite where unknown.
        direction: (n,) course over ground, radians; NaN where unknown.
        speed: (n,) m/s; NaN where unknown.
        group: (n,) int64; left out: all 0.
        size: (n, 3) length, width and height, metres; NaN where unknown.
        heading: (n,) yaw of the body, radians; NaN where unknown.

    Columns of which nothing is known are left out.
    """

    names: AnyArray
    vehicle: IntArray
    time_ns: IntArray
    position: FloatArray
    direction: FloatArray = LEFT_OUT
    speed: FloatArray = LEFT_OUT
    group: IntArray = LEFT_OUT
    size: FloatArray = LEFT_OUT
    heading: FloatArray = LEFT_OUT

    def __post_init__(self) -> None:
        for name, shape in OPTIONAL.items():
            if getattr(self, name) is LEFT_OUT:
                object.__setattr__(self, name, unknown(len(self), *shape))
        if self.group is LEFT_OUT:
            object.__setattr__(self, "group", np.zeros(len(self), np.int64))

    def __len__(self) -> int:
        return int(self.vehicle.size)

    def __getitem__(self, rows: BoolArray | IntArray) -> VehicleRows:
        """The rows of a mask or of indices; the same rows where a mask leaves out none."""
        if rows.dtype == np.bool_ and rows.all():
            return self
        columns: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self)[1:]}
        columns = {name: chosen(column, rows) if name in OPTIONAL else column[rows] for name, column in columns.items()}
        return replace(self, **columns)

    @classmethod
    def of(cls, track_id: AnyArray, **columns: Any) -> VehicleRows:
        """Rows by the (n,) ids of their vehicles."""
        names, vehicle = numbered(track_id)
        return cls(names=np.array(names, np.str_), vehicle=vehicle, **columns)

    @classmethod
    def concatenate(cls, parts: Sequence[VehicleRows], names: AnyArray) -> VehicleRows:
        """All rows of all parts, of which there is at least one; their vehicles are among `names`."""
        columns: dict[str, Any] = {}
        for f in fields(cls)[1:]:
            join = joined if f.name in OPTIONAL else np.concatenate
            columns[f.name] = join([getattr(part, f.name) for part in parts])
        return cls(names=names, **columns)

    def has_motion(self) -> BoolArray:
        """(n,) where both course and speed are known."""
        return np.asarray(np.isfinite(self.direction) & np.isfinite(self.speed) & (self.speed >= 0))

    def is_known_throughout(self) -> BoolArray:
        """(n,) rows of vehicles of which all rows have motion."""
        of_vehicle = np.ones(self.names.size, np.bool_)
        of_vehicle[self.vehicle[~self.has_motion()]] = False
        return of_vehicle[self.vehicle]

    def to_tracks(self, losses: Losses) -> Tracks:
        """The tracks; rows that are alone in time are left out, and added to the losses.

        Direction and speed are taken where all rows of a vehicle have them, and else derived from its positions. Where
        only the speed is known, or the heading of the body, both stay, and the direction is derived.
        """
        whole = self.is_known_throughout()
        known, rest = self[whole], self[~whole]
        ids = as_track_ids(self.names)
        taken, derived = (
            make(
                track_id=ids[rows.vehicle], time_ns=rows.time_ns, position=rows.position, group=rows.group,
                size=rows.size, heading=rows.heading, **motion,
            )
            for make, rows, motion in (
                (Tracks, known, {"direction": known.direction, "speed": known.speed}),
                (Tracks.from_positions, rest, {"speed": np.where(rest.speed >= 0, rest.speed, np.nan)}),
            )
        )  # fmt: skip
        tracks = Tracks.concatenate([part for part in (taken, derived) if len(part)] or [taken])
        losses.drop(ALONE, len(rest) - len(derived))
        return tracks
