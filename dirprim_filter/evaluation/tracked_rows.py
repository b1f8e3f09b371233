"""What a tracker says, ours or another: only as much as is needed to judge it, and as much as is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.columns import ArrayTable, ids, optional, required, whole
from dirprim_filter.estimates import Estimates
from dirprim_filter.track_ids import as_texts, as_track_ids, check_not_repeated, vehicle_numbers
from dirprim_filter.tracks import Tracks


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackedRows(ArrayTable):
    """Where a tracker says that vehicles are, a row for each track and instant.

    Attributes:
        track_id: (n,) int64 or str; in another group it is another track.
        time_ns: (n,) int64, nanoseconds.
        position: (n, 2) metres.
        group: (n,) int64. Left out: all 0.
        covariance: (n, 2, 2) square metres; NaN where unknown, as in the next three. Left out: nowhere known, likewise.
        direction: (n,) course over ground, radians.
        speed: (n,) m/s.
        unseen_s: (n,) seconds since the vehicle was last measured.

    Raises:
        ValueError: shapes that do not fit, or a track with two rows at one time.
    """

    track_id: AnyArray = ids(as_track_ids)
    time_ns: IntArray = whole()
    position: FloatArray = required(2)
    group: IntArray = whole(missing=0)
    covariance: FloatArray = optional(2, 2)
    direction: FloatArray = optional()
    speed: FloatArray = optional()
    unseen_s: FloatArray = optional()

    def __post_init__(self) -> None:
        ArrayTable.__post_init__(self)
        check_not_repeated(self.track_id, self.time_ns, self.group)

    @property
    def vehicle(self) -> IntArray:
        """(n,) which track each row is of, as a number."""
        return vehicle_numbers(self.track_id, self.group)

    @property
    def n_tracks(self) -> int:
        """Number of tracks."""
        return int(self.vehicle.max(initial=-1)) + 1

    @classmethod
    def of(cls, estimates: Estimates, *, group: IntArray | int = 0) -> TrackedRows:
        """The rows of estimates, of the groups that are given.

        Bare detections know no motion: they have a direction without a resultant and a speed without a deviation.
        """
        is_known = (estimates.direction_resultant > 0.0) | (estimates.speed_std > 0.0)
        return cls(
            track_id=estimates.track_id, time_ns=estimates.time_ns, position=estimates.position,
            group=np.broadcast_to(np.asarray(group, np.int64), len(estimates)), covariance=estimates.covariance,
            direction=np.where(is_known, estimates.direction, np.nan),
            speed=np.where(is_known, estimates.speed, np.nan), unseen_s=estimates.unseen_s,
        )  # fmt: skip


def instant_numbers(*rows: Tracks | TrackedRows) -> list[IntArray]:
    """(n,) of each, the instant of each row as a number among those of all, in order of group and time."""
    number = vehicle_numbers(np.concatenate([of.time_ns for of in rows]), np.concatenate([of.group for of in rows]))
    return np.split(number, np.cumsum([len(of) for of in rows])[:-1])


def names_in_group(track_id: AnyArray, group: IntArray) -> AnyArray:
    """(n,) str, ids as their own group calls them: `group/id` is id."""
    names = as_texts(track_id)
    prefix = np.char.add(as_texts(group), "/")
    own = np.char.startswith(names, prefix)
    if not own.any():
        return names
    return np.where(own, [name.partition("/")[2] for name in names.tolist()], names)
