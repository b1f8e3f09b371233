"""Rows of vehicles as logs and tables hold them, and the tracks that they make."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.recording.losses import ALONE, Losses
from dirprim_filter.recording.rows import LEFT_OUT, Rows
from dirprim_filter.track_ids import as_track_ids, numbered
from dirprim_filter.tracks import Tracks


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VehicleRows(Rows):
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
        cue: (n, 2) turn signals, as in `Detections`; NaN where there are none.

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
    cue: FloatArray = LEFT_OUT

    NOTHING: ClassVar[Mapping[str, Any]] = {
        "direction": np.nan, "speed": np.nan, "group": np.int64(0), "size": [np.nan] * 3, "heading": np.nan,
        "cue": [np.nan] * 2,
    }  # fmt: skip
    OF_ALL: ClassVar[tuple[str, ...]] = ("names",)

    @classmethod
    def of(cls, track_id: AnyArray, **columns: Any) -> VehicleRows:
        """Rows by the (n,) ids of their vehicles."""
        names, vehicle = numbered(track_id)
        return cls(names=np.array(names, np.str_), vehicle=vehicle, **columns)

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
