"""What a sensor reports: positions of vehicles and what it may know of their motion, as they come, frame by frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.columns import ArrayTable, ids, optional, required, whole
from dirprim_filter.origin import Origin
from dirprim_filter.track_ids import as_texts, qualified_names, rows_of_each
from dirprim_filter.tracks import Tracks

NO_TIME = -(1 << 63)
"""Nanoseconds before every frame's: how far a log has come before its first."""
NO_ID = ""
"""What a detection is called whose sensor gives it no name: it may be any vehicle's, or none's."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Detections(ArrayTable):
    """Reported positions, a row for each vehicle and instant, in the order they came.

    Attributes:
        track_id: (n,) str, the sensor's name for the vehicle; `NO_ID` where it gives none.
        time_ns: (n,) int64, nanoseconds since the log's epoch.
        position: (n, 2) metres, x east, y north.
        direction: (n,) measured course, radians; NaN where it is not measured. Left out: nowhere.
        speed: (n,) measured speed, m/s; NaN where it is not measured. Left out: nowhere.
        covariance: (n, 2, 2) of the position's error, square metres; NaN where the sensor does not report it, and the
            filter's own noise applies. Left out: nowhere.
        size: (n, 3) measured length, width and height of the body, metres; NaN where unknown. Left out: nowhere known.
        cue: (n, 2) what the vehicle signals of its next turn (p_t of Eq. 4): the mean turn relative to its heading,
            radians counter-clockwise, and its von Mises concentration; NaN where it signals nothing. Left out: nowhere.
        confidence: (n,) probability that there is such a vehicle, as the sensor states it; NaN or 0 where it does
            not. Left out: nowhere.
        group: (n,) int64, the recording that each row is of, as in `Tracks`. Left out: all 0.
        origin: latitude and longitude of the plane's origin, degrees; None where positions have none.

    Raises:
        ValueError: shapes that do not fit, a position that is not finite, a direction beyond a turn, a speed below 0, a
            covariance that is not positive definite, a size that is not positive, a concentration below 0, or a
            confidence beyond 0 to 1.
    """

    track_id: AnyArray = ids(as_texts)
    time_ns: IntArray = whole()
    position: FloatArray = required(2)
    direction: FloatArray = optional(checked=True)
    speed: FloatArray = optional(checked=True)
    covariance: FloatArray = optional(2, 2, checked=True)
    size: FloatArray = optional(3, checked=True)
    cue: FloatArray = optional(2, checked=True)
    confidence: FloatArray = optional(checked=True)
    group: IntArray = whole(missing=0)
    origin: Origin | None = None

    @classmethod
    def of(cls, tracks: Tracks) -> Detections:
        """The positions of tracks, without their direction and speed."""
        return cls(
            track_id=tracks.track_id, time_ns=tracks.time_ns, position=tracks.position, group=tracks.group,
            origin=tracks.origin,
        )  # fmt: skip

    def in_one_group(self) -> Detections:
        """The same rows as of no group, under the names that `qualified_names` gives them."""
        if not self.group.any():
            return self
        names = np.where(self.track_id == NO_ID, NO_ID, qualified_names(self.track_id, self.group))
        return replace(self, track_id=names, group=np.zeros(len(self), np.int64))

    def without_ids(self) -> Detections:
        """The same rows without ids."""
        return replace(self, track_id=np.full(len(self), NO_ID, np.str_))

    def instant(self) -> int:
        """The time of these rows, at least one, as a frame of a log.

        Raises:
            ValueError: several instants, several groups, or a repeated id.
        """
        named = [name for name in self.track_id.tolist() if name != NO_ID]
        if (self.time_ns != self.time_ns[0]).any() or len(set(named)) != len(named):
            raise ValueError("detections: expected one instant and each track id once; see Detections.frames")
        if (self.group != self.group[0]).any():
            raise ValueError(
                "detections: expected rows of one group, for each is tracked by itself; see filtering.GroupTracker"
            )
        return int(self.time_ns[0])

    def frames(self) -> Iterator[Detections]:
        """The rows of each instant, ascending in time."""
        for rows in rows_of_each(self.time_ns):
            yield self[rows]
