"""Observed motion: where each vehicle was, when, and how it moved."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from dirprim_filter.arrays import AnyArray, ArrayTable, FloatArray, IntArray, as_floats
from dirprim_filter.course import log_motion, motion_of
from dirprim_filter.distributions.angles import wrap
from dirprim_filter.optional_columns import chosen, is_held, joined, unknown
from dirprim_filter.sizes import as_sizes
from dirprim_filter.track_ids import as_texts, as_track_ids, check_not_repeated, vehicle_numbers

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
        group: (n,) int64; each group is a world of its own, recorded apart from the others, whose times may overlap:
            nothing compares rows across groups, and they are what to split by. Left out: all 0.
        size: (n, 3) length, width and height of the body, metres; NaN where unknown. Left out: nowhere known, which
            takes no memory.
        heading: (n,) yaw of the body, radians in (-pi, pi]; NaN where unknown. Left out: nowhere known, which takes no
            memory. On bends it is not the direction, and a vehicle that stands has a heading alone.

    Raises:
        ValueError: shapes that do not fit, NaN, negative speeds, sizes that are not positive, infinite headings, or a
            vehicle with two rows at one time.
    """

    track_id: AnyArray
    time_ns: IntArray
    position: FloatArray
    direction: FloatArray
    speed: FloatArray
    group: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    size: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    heading: FloatArray = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        n = len(np.atleast_1d(self.time_ns))
        columns = {
            "track_id": as_track_ids(self.track_id),
            "time_ns": as_times("time_ns", self.time_ns),
            "position": as_floats("position", self.position, "n 2"),
            "direction": wrap(as_floats("direction", self.direction, "n")),
            "speed": as_floats("speed", self.speed, "n"),
            "group": as_groups(self.group, n),
        }
        check_lengths(columns)
        speed = columns["speed"]
        if (speed < 0).any():
            row = int(np.argmax(speed < 0))
            raise ValueError(f"speed: expected at least 0 m/s, got {speed[row]} in row {row}")
        maybe = {"size": as_sizes(self.size, n), "heading": as_headings(self.heading, n)}
        if (columns["time_ns"][1:] < columns["time_ns"][:-1]).any():  # else long columns are not copied
            order = np.argsort(columns["time_ns"], kind="stable")
            columns = {name: column[order] for name, column in columns.items()}
            maybe = {name: chosen(column, order) for name, column in maybe.items()}
        for name, column in (columns | maybe).items():
            object.__setattr__(self, name, column)
        check_not_repeated(self.track_id, self.time_ns, self.group)

    def __len__(self) -> int:
        return int(self.time_ns.size)

    def __getitem__(self, rows: npt.NDArray[np.bool_] | IntArray | slice) -> Tracks:
        """The chosen rows, by mask, indices or slice."""
        return Tracks(
            track_id=self.track_id[rows],
            time_ns=self.time_ns[rows],
            position=self.position[rows],
            direction=self.direction[rows],
            speed=self.speed[rows],
            group=self.group[rows],
            size=chosen(self.size, rows),
            heading=chosen(self.heading, rows),
        )

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

    def worlds(self) -> Iterator[Tracks]:
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
        ids, times = as_track_ids(track_id), as_times("time_ns", time_ns)
        position = as_floats("position", position, "n 2")
        groups = as_groups(group, ids.size)
        check_lengths({"track_id": ids, "time_ns": times, "position": position, "group": groups})
        sizes, headings = as_sizes(size, ids.size), as_headings(heading, ids.size)
        check_not_repeated(ids, times, groups)
        vehicle = vehicle_numbers(ids, groups)
        motion = motion_of(vehicle, times, position, headings)
        measured = np.asarray(speed, dtype=np.float64)
        speeds = _where_complete(measured, motion.speed, vehicle) if measured.size else motion.speed
        known = np.isfinite(speeds) & (np.isfinite(motion.speed) | np.isfinite(headings))
        if ids.size:
            log_motion(motion, int(known.sum()))
        if not known.all():
            logger.warning(
                "%d of %d rows stand alone in time, so no velocity can be derived for them; dropped",
                int((~known).sum()),
                known.size,
            )
        return cls(
            track_id=ids[known], time_ns=times[known], position=position[known], direction=motion.direction[known],
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
        if len(parts) == 1:
            return parts[0]
        return cls(
            track_id=np.concatenate([as_texts(p.track_id) for p in parts])
            if len({p.track_id.dtype.kind for p in parts}) > 1
            else np.concatenate([p.track_id for p in parts]),
            time_ns=np.concatenate([p.time_ns for p in parts]),
            position=np.concatenate([p.position for p in parts]),
            direction=np.concatenate([p.direction for p in parts]),
            speed=np.concatenate([p.speed for p in parts]),
            group=np.concatenate([p.group for p in parts]),
            size=joined([p.size for p in parts]),
            heading=joined([p.heading for p in parts]),
        )


def _where_complete(measured: FloatArray, derived: FloatArray, vehicle: IntArray) -> FloatArray:
    """(n,) the measured values of vehicles that have them in all rows, the derived values of the others."""
    is_complete = np.ones(int(vehicle.max(initial=-1)) + 1, np.bool_)
    is_complete[vehicle[~np.isfinite(measured)]] = False
    return np.where(is_complete[vehicle], measured, derived)


def as_headings(value: npt.ArrayLike, n: int) -> FloatArray:
    """(n,) radians in (-pi, pi], NaN where unknown; no row known gives a column without memory.

    Raises:
        ValueError: another shape, or an infinite number.
    """
    heading = np.asarray(value, dtype=np.float64)
    if heading.shape == (0,):
        return unknown(n)
    if heading.shape != (n,):
        raise ValueError(f"heading: expected shape ({n},), got {heading.shape}")
    if not is_held(heading):
        return heading
    if np.isinf(heading).any():
        raise ValueError(f"heading: expected radians, or NaN where unknown, got {heading[np.isinf(heading)][0]}")
    return unknown(n) if np.isnan(heading).all() else wrap(heading)


def as_times(name: str, value: npt.ArrayLike) -> IntArray:
    """Times as int64 nanoseconds.

    Raises:
        ValueError: not whole numbers, as a float loses nanoseconds in silence; or beyond int64.
    """
    return _as_whole(name, value, "nanoseconds")


def as_groups(value: npt.ArrayLike, n: int) -> IntArray:
    """(n,) int64 groups; of none given all 0.

    Raises:
        ValueError: not whole numbers, or beyond int64.
    """
    group = _as_whole("group", value, "numbers")
    return group if group.size else np.zeros(n, np.int64)


def _as_whole(name: str, value: npt.ArrayLike, what: str) -> IntArray:
    array = np.asarray(value)
    is_whole = array.dtype.kind in "iu" or all(type(number) is int for number in array.flat)
    if not is_whole:
        raise ValueError(f"{name}: expected whole {what} (int64), got {array.dtype}")
    limits = np.iinfo(np.int64)
    if array.size and array.dtype.kind != "i" and not (array.min() >= limits.min and array.max() <= limits.max):
        raise ValueError(f"{name}: expected {what} within int64, got {array.min()} to {array.max()}")
    return array.astype(np.int64, copy=False)


def check_lengths(columns: dict[str, AnyArray]) -> None:
    """All columns are of one length.

    Raises:
        ValueError: they are not.
    """
    lengths = {name: column.shape[:1] for name, column in columns.items()}
    if len(set(lengths.values())) > 1 or any(c.ndim == 0 for c in columns.values()):
        shapes = ", ".join(f"{name} {columns[name].shape}" for name in lengths)
        raise ValueError(f"columns: expected one length n, got {shapes}")
