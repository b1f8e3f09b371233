"""Observed motion: where each vehicle was, when, and how it moved."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.columns import ArrayTable, column_fields, ids, is_held, optional, required, whole
from dirprim_filter.course import log_motion, motion_of
from dirprim_filter.distributions.angles import wrap
from dirprim_filter.origin import Origin
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
        origin: latitude and longitude of the plane's origin, degrees; None where positions have none.

    Raises:
        ValueError: shapes that do not fit, NaN, negative speeds, angles beyond a turn, sizes that are not positive, or
            a vehicle with two rows at one time.
    """

    track_id: AnyArray = ids(as_track_ids)
    time_ns: IntArray = whole()
    position: FloatArray = required(2)
    direction: FloatArray = required(checked=True)
    speed: FloatArray = required(checked=True)
    group: IntArray = whole(missing=0)
    size: FloatArray = optional(3, checked=True)
    heading: FloatArray = optional(checked=True)
    origin: Origin | None = None

    def __post_init__(self) -> None:
        super(Tracks, self).__post_init__()
        heading = wrap(self.heading) if is_held(self.heading) else self.heading
        self._set({"direction": wrap(self.direction), "heading": heading})
        if (self.time_ns[1:] < self.time_ns[:-1]).any():  # else long columns are not copied
            order = np.argsort(self.time_ns, kind="stable")
            self._set({f.name: getattr(self, f.name)[order] for f in column_fields(type(self))})
        check_not_repeated(self.track_id, self.time_ns, self.group)

    def __getitem__(self, rows: BoolArray | IntArray | slice) -> Tracks:
        """The chosen rows, by mask, indices or slice."""
        return replace(super(Tracks, self).__getitem__(rows))

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
        return np.unique(self.vehicle, return_index=True)[1]

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
        given: dict[str, Any] = {"track_id": track_id, "time_ns": time_ns, "position": position, "group": group}
        standing = np.zeros(np.shape(time_ns))
        seen = cls(**given, size=np.asarray(size), heading=np.asarray(heading), direction=standing, speed=standing)
        vehicle = seen.vehicle
        motion = motion_of(vehicle, seen.time_ns, seen.position, seen.heading)
        speeds, measured = motion.speed, np.asarray(speed, dtype=np.float64)
        if measured.size:
            measured = measured[np.argsort(time_ns, kind="stable")]
            is_complete = np.ones(seen.n_tracks, np.bool_)
            is_complete[vehicle[~np.isfinite(measured)]] = False
            speeds = np.where(is_complete[vehicle], measured, speeds)
        known = np.isfinite(speeds) & (np.isfinite(motion.speed) | np.isfinite(seen.heading))
        if known.size:
            log_motion(motion, int(known.sum()))
        if not known.all():
            logger.info("%d of %d rows stand alone in time: no velocity", int((~known).sum()), known.size)
        return replace(seen[known], direction=motion.direction[known], speed=speeds[known])
