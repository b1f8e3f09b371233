"""Observed motion: where each vehicle was, when, and how it moved."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray, as_floats
from dirprim_filter.columns import (
    ArrayTable,
    as_groups,
    as_optional,
    as_times,
    check_lengths,
    chosen,
    groups,
    ids,
    is_held,
    optional,
    required,
)
from dirprim_filter.course import log_motion, motion_of
from dirprim_filter.distributions.angles import wrap
from dirprim_filter.track_ids import as_track_ids, check_not_repeated, vehicle_numbers

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tracks(ArrayTable):
    """Observed motion of vehicles, a row for each vehicle and instant; rows are kept in order of time.

    Attributes:
        track_id: (n,) int64 or str; an id in a group is a vehicle: in another group it is another.
        time_ns: (n,) int64, nanoseconds since the log's epoch.
        position: (n, 2) metres, x east, y north.
        direction: (n,) course over ground, radians counter-clockwise from east in (-pi, pi].
        speed: (n,) metres per second, not negative.
        group: (n,) int64; each group is a scene of its own, recorded apart from the others, whose times may overlap:
            nothing compares rows across groups, and they are what to split by. Left out: all 0.
        size: (n, 3) length, width and height of the body, metres; NaN where unknown. Left out: nowhere known, which
            takes no memory.
        heading: (n,) yaw of the body, radians in (-pi, pi]; NaN where unknown. Left out: nowhere known, which takes no
            memory. On bends it is not the direction, and a vehicle that stands has a heading alone.

    Raises:
        ValueError: shapes that do not fit, NaN, negative speeds, angles beyond a turn, sizes that are not positive, or
            a vehicle with two rows at one time.
    """

    track_id: AnyArray = ids(as_track_ids)
    time_ns: IntArray
    position: FloatArray = required(2)
    direction: FloatArray = required(checked=True)
    speed: FloatArray = required(checked=True)
    group: IntArray = groups()
    size: FloatArray = optional(3, checked=True)
    heading: FloatArray = optional(checked=True)

    def __post_init__(self) -> None:
        super(Tracks, self).__post_init__()
        heading = wrap(self.heading) if is_held(self.heading) else self.heading
        self._set({"direction": wrap(self.direction), "heading": heading})
        if (self.time_ns[1:] < self.time_ns[:-1]).any():  # else long columns are not copied
            order = np.argsort(self.time_ns, kind="stable")
            self._set({f.name: chosen(getattr(self, f.name), order) for f in fields(self)})
        check_not_repeated(self.track_id, self.time_ns, self.group)

    @property
    def body_direction(self) -> FloatArray:
        """(n,) where each body points, radians: its heading where known, else its course."""
        return np.where(np.isnan(self.heading), self.direction, self.heading)

    @property
    def n_tracks(self) -> int:
        """Number of vehicles."""
        return int(self.vehicle.max(initial=-1)) + 1

    @property
    def vehicle(self) -> IntArray:
        """(n,) the number of each row's vehicle, 0 to n_tracks - 1, in order of group and id."""
        return vehicle_numbers(self.track_id, self.group)

    @property
    def first_rows(self) -> IntArray:
        """(n_tracks,) the first row of each vehicle."""
        vehicle = self.vehicle
        row = np.empty(int(vehicle.max(initial=-1)) + 1, np.int64)
        row[vehicle[::-1]] = np.arange(vehicle.size)[::-1]
        return row

    def by_group(self) -> Iterator[Tracks]:
        """The rows of each group, in order of the groups."""
        groups = np.unique(self.group)
        for group in groups.tolist():
            yield self if groups.size == 1 else self[self.group == group]

    @classmethod
    def from_positions(
        cls,
        *,
        track_id: npt.ArrayLike,
        time_ns: npt.ArrayLike,
        position: npt.ArrayLike,
        group: npt.ArrayLike = (),
        size: npt.ArrayLike = (),
        heading: npt.ArrayLike = (),
        speed: npt.ArrayLike = (),
    ) -> Tracks:
        """Tracks with the course derived from the positions of each vehicle: `course.motion_of`.

        Rows without another row of the vehicle near in time take their heading and their known speed; if either is
        missing the row is dropped, and logged.

        Args:
            track_id: (n,) ids.
            time_ns: (n,) nanoseconds.
            position: (n, 2) metres.
            group: (n,) optional groups.
            size: (n, 3) optional sizes, metres.
            heading: (n,) optional yaw of the bodies, radians; NaN where unknown.
            speed: (n,) optional, m/s; NaN where unknown. Vehicles with unknown rows take the speed of their positions.

        Raises:
            ValueError: as the constructor.
        """
        names, times = as_track_ids(np.asarray(track_id)), as_times("time_ns", time_ns)
        position = as_floats("position", position, "n 2")
        groups = as_groups(group, names.size)
        check_lengths({"track_id": names, "time_ns": times, "position": position, "group": groups})
        sizes, headings = as_optional("size", size, names.size, 3), as_optional("heading", heading, names.size)
        check_not_repeated(names, times, groups)
        vehicle = vehicle_numbers(names, groups)
        motion = motion_of(vehicle, times, position, headings)
        speeds, measured = motion.speed, np.asarray(speed, dtype=np.float64)
        if measured.size:
            is_complete = np.ones(int(vehicle.max(initial=-1)) + 1, np.bool_)
            is_complete[vehicle[~np.isfinite(measured)]] = False
            speeds = np.where(is_complete[vehicle], measured, speeds)
        known = np.isfinite(speeds) & (np.isfinite(motion.speed) | np.isfinite(headings))
        if names.size:
            log_motion(motion, int(known.sum()))
        if not known.all():
            alone = "%d of %d rows stand alone in time, so no velocity can be derived for them; dropped"
            logger.warning(alone, int((~known).sum()), known.size)
        return cls(
            track_id=names[known], time_ns=times[known], position=position[known], direction=motion.direction[known],
            speed=speeds[known], group=groups[known], size=chosen(sizes, known), heading=chosen(headings, known),
        )  # fmt: skip

    @classmethod
    def concatenate(cls, parts: Iterable[Tracks]) -> Tracks:
        """All rows of all parts.

        Raises:
            ValueError: there is no part, or two parts hold one vehicle at one time.
        """
        parts = list(parts)
        if not parts:
            raise ValueError("parts: expected at least one Tracks, got none")
        return super(Tracks, cls).concatenate(parts)
