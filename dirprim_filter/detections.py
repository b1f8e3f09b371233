"""What a sensor reports: positions of vehicles, as they come, frame by frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dirprim_filter.tracks import Tracks, as_texts, as_times, check_lengths
from tessellation.arrays import AnyArray, FloatArray, IntArray, as_floats

NO_TIME = -(1 << 63)
"""Nanoseconds before every frame's: how far a log has come before its first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Detections:
    """Reported positions, a row for each vehicle and instant, in the order they came.

    Attributes:
        track_id: (n,) str, the sensor's name for the vehicle.
        time_ns: (n,) int64, nanoseconds since the log's epoch.
        position: (n, 2) metres, x east, y north.

    Raises:
        ValueError: shapes that do not fit, or a position that is not finite.
    """

    track_id: AnyArray
    time_ns: IntArray
    position: FloatArray

    def __post_init__(self) -> None:
        columns = {
            "track_id": as_texts(np.asarray(self.track_id)),
            "time_ns": as_times("time_ns", self.time_ns),
            "position": as_floats("position", self.position, "n 2"),
        }
        check_lengths(columns)
        for name, column in columns.items():
            object.__setattr__(self, name, column)

    def __len__(self) -> int:
        return int(self.time_ns.size)

    @classmethod
    def of(cls, tracks: Tracks) -> Detections:
        """The positions of tracks, without their direction and speed."""
        return cls(track_id=tracks.track_id, time_ns=tracks.time_ns, position=tracks.position)

    @classmethod
    def none(cls) -> Detections:
        """No detection."""
        return cls(track_id=np.empty(0, np.str_), time_ns=np.empty(0, np.int64), position=np.empty((0, 2)))

    def instant(self, *, after_ns: int) -> int:
        """The time of these rows as the next frame of a log that has come to `after_ns`; `after_ns` if there are none.

        Raises:
            ValueError: several instants, a repeated id, or a time that is not after `after_ns`.
        """
        if len(self) == 0:
            return after_ns
        time_ns = int(self.time_ns[0])
        if (self.time_ns != time_ns).any() or np.unique(self.track_id).size != len(self):
            raise ValueError("detections: expected one instant and each track id once; see Detections.frames")
        if time_ns <= after_ns:
            raise ValueError(f"detections: expected times after {after_ns} ns, got {time_ns}")
        return time_ns

    def frames(self) -> Iterator[Detections]:
        """The rows of each instant, ascending in time."""
        order = np.argsort(self.time_ns, kind="stable")
        starts = np.flatnonzero(np.diff(self.time_ns[order], prepend=self.time_ns.min(initial=0) - 1))
        for rows in np.split(order, starts[1:]):
            if rows.size:
                yield Detections(track_id=self.track_id[rows], time_ns=self.time_ns[rows], position=self.position[rows])
