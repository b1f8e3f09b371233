"""Observed motion: where each vehicle was, when, and how it moved."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from dirprim_filter.distributions.angles import wrap
from dirprim_filter.sizes import as_sizes, chosen_sizes, joined_sizes
from tessellation.arrays import AnyArray, ArrayValue, BoolArray, FloatArray, IntArray, as_floats

logger = logging.getLogger(__name__)

DIFFERENCE_HALF_WINDOW_S = 0.25
"""Velocity is differenced over this time to either side: two rows of 10 Hz data, which halves their jitter."""
MAX_DIFFERENCE_GAP_S = 2.0
"""Across a longer gap nothing is differenced: the vehicle may have turned and come back."""
BLOCK_ROWS = 1 << 14
"""So many ids at a time are Python's own texts."""


class Numbers(dict[str, int]):
    """Names, numbered as they first come."""

    def __missing__(self, name: str) -> int:
        self[name] = len(self)
        return len(self) - 1


def numbered(track_id: AnyArray) -> tuple[list[str], IntArray]:
    """The ids as text, each once, and (n,) the place of each row's among them.

    Text is hashed block by block: sorting it would hold it twice, and take ten times as long.
    """
    if track_id.dtype.kind != "U":
        ids, place = np.unique(track_id, return_inverse=True)
        return as_texts(ids).tolist(), place
    numbers = Numbers()
    place = np.empty(track_id.size, np.int64)
    for start in range(0, track_id.size, BLOCK_ROWS):
        block = track_id[start : start + BLOCK_ROWS]
        place[start : start + BLOCK_ROWS] = np.fromiter(map(numbers.__getitem__, block.tolist()), np.int64, block.size)
    return list(numbers), place


def as_track_ids(value: npt.ArrayLike) -> AnyArray:
    """Track ids as an array of int64, or of str where one of them is no canonical decimal int64.

    Logs hold ids as text; "7" and 7 are the same id, "07" and "7" are not.
    """
    array = np.asarray(value)
    if array.dtype.kind == "i" or (array.dtype.kind == "u" and array.dtype.itemsize < 8):
        return array.astype(np.int64, copy=False)
    text = as_texts(array)
    if all(map(_is_decimal_int64, numbered(text)[0])):
        return text.astype(np.int64)
    return text


@lru_cache(maxsize=1 << 16)
@lru_cache(maxsize=1 << 16)
def _is_decimal_int64(name: str) -> bool:
    digits = name.removeprefix("-")
    if not (digits.isascii() and digits.isdigit() and len(digits) <= 19):
        return False
    number = int(name)
    return str(number) == name and -(1 << 63) <= number < 1 << 63


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tracks(ArrayValue):
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

    Raises:
        ValueError: shapes that do not fit, NaN, negative speeds, sizes that are not positive, or a vehicle with two
            rows at one time.
    """

    track_id: AnyArray
    time_ns: IntArray
    position: FloatArray
    direction: FloatArray
    speed: FloatArray
    group: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    size: FloatArray = field(default_factory=lambda: np.empty((0, 3)))

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
        size = as_sizes(self.size, n)
        if (columns["time_ns"][1:] < columns["time_ns"][:-1]).any():  # else long columns are not copied
            order = np.argsort(columns["time_ns"], kind="stable")
            columns = {name: column[order] for name, column in columns.items()}
            size = chosen_sizes(size, order)
        columns["size"] = size
        for name, column in columns.items():
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
            size=chosen_sizes(self.size, rows),
        )

    @property
    def n_tracks(self) -> int:
        """Number of vehicles."""
        return int(self.vehicle.max(initial=-1)) + 1

    @property
    def vehicle(self) -> IntArray:
        """(n,) the number of each row's vehicle, 0 to n_tracks - 1, in order of group and id."""
        return vehicle_numbers(self.track_id, self.group)

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
    ) -> Tracks:
        """Tracks whose direction and speed are central differences of the positions of each vehicle.

        Rows of a vehicle that no other row stands near enough in time to difference with are dropped, and logged.

        Args:
            track_id: (n,) ids.
            time_ns: (n,) nanoseconds.
            position: (n, 2) metres.
            group: (n,) optional groups.
            size: (n, 3) optional sizes, metres.

        Raises:
            ValueError: as the constructor.
        """
        ids, times = as_track_ids(track_id), as_times("time_ns", time_ns)
        position = as_floats("position", position, "n 2")
        groups = as_groups(group, ids.size)
        check_lengths({"track_id": ids, "time_ns": times, "position": position, "group": groups})
        sizes = as_sizes(size, ids.size)
        check_not_repeated(ids, times, groups)
        velocity = differenced_velocity(vehicle_numbers(ids, groups), times, position)
        known = np.isfinite(velocity[:, 0])
        if not known.all():
            logger.warning(
                "%d of %d rows stand alone in time, so no velocity can be derived for them; dropped",
                int((~known).sum()),
                known.size,
            )
        return cls(
            track_id=ids[known],
            time_ns=times[known],
            position=position[known],
            direction=np.arctan2(velocity[known, 1], velocity[known, 0]),
            speed=np.hypot(velocity[known, 0], velocity[known, 1]),
            group=groups[known],
            size=chosen_sizes(sizes, known),
        )

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
            size=joined_sizes([p.size for p in parts]),
        )


def as_texts(track_id: AnyArray) -> AnyArray:
    """Track ids as text, as logs hold them."""
    return track_id if track_id.dtype.kind == "U" else track_id.astype(np.str_)


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
        told = ", ".join(f"{name} {columns[name].shape}" for name in lengths)
        raise ValueError(f"columns: expected one length n, got {told}")


def vehicle_numbers(track_id: AnyArray, group: IntArray) -> IntArray:
    """(n,) the number of each row's vehicle, in order of group and id: an id in two groups is two vehicles."""
    number = _numbers_of(track_id)
    if group.size and (group != group[0]).any():
        number = _numbers_of(_numbers_of(group) * (int(number.max()) + 1) + number)
    return number


def world_names(track_id: AnyArray, group: IntArray) -> AnyArray:
    """(n,) str, ids that no two groups share: `group/id`, and in group 0, of logs without groups, the id alone."""
    names = as_texts(track_id)
    if not group.any():
        return names
    prefix = np.char.add(as_texts(group), "/")
    return np.where((group == 0) | np.char.startswith(names, prefix), names, np.char.add(prefix, names))


def _numbers_of(key: AnyArray) -> IntArray:
    """(n,) each key's place among all keys in order, each counted once."""
    if key.dtype.kind == "U":
        names, place = numbered(key)
        order = np.empty(len(names), np.int64)
        order[np.argsort(np.array(names, dtype=np.str_))] = np.arange(len(names))
        return order[place]
    if key.size:
        low, high = int(key.min()), int(key.max())
        if high - low <= 4 * key.size:  # a table of all keys between costs less than sorting
            seen = np.zeros(high - low + 1, np.bool_)
            seen[key - low] = True
            return np.asarray((np.cumsum(seen) - 1)[key - low], np.int64)
    return np.asarray(np.unique(key, return_inverse=True)[1], np.int64)


def check_not_repeated(track_id: AnyArray, time_ns: IntArray, group: IntArray) -> None:
    """No vehicle has two rows at one time.

    Raises:
        ValueError: names the first that has.
    """
    has_groups = group.size > 0 and (group != group[0]).any()
    repeated = repeated_rows(vehicle_numbers(track_id, group) if has_groups else track_id, time_ns)
    if repeated.any():
        row = int(np.argmax(repeated))
        raise ValueError(f"track_id, time_ns: vehicle {track_id[row]} has two rows at {time_ns[row]} ns; keep one")


def repeated_rows(track_id: AnyArray, time_ns: IntArray) -> BoolArray:
    """(n,) where a row repeats the vehicle and the time of an earlier row."""
    _, vehicle = numbered(track_id)
    n = len(time_ns)
    cuts = np.array([0, n])
    if not (time_ns[1:] < time_ns[:-1]).any():  # then in pieces, so that no more is needed than a piece
        cuts = np.unique(np.append(np.searchsorted(time_ns, time_ns[::BLOCK_ROWS]), n))
    repeated = np.zeros(n, np.bool_)
    for start, end in pairwise(cuts.tolist()):
        who, when = vehicle[start:end], time_ns[start:end]
        order = np.lexsort((when, who))  # stable, so the first of equals stays first
        same = (np.diff(who[order]) == 0) & (np.diff(when[order]) == 0)
        repeated[start + order[1:][same]] = True
    return repeated


def differenced_velocity(track_id: AnyArray, time_ns: IntArray, position: FloatArray) -> FloatArray:
    """(n, 2) velocity by central differences per vehicle, m/s; NaN where a row has no neighbour in time.

    Differences reach `DIFFERENCE_HALF_WINDOW_S` to either side, at least to the next row, and never across a gap of
    more than `MAX_DIFFERENCE_GAP_S`; at the ends of a track they are one-sided.
    """
    _, vehicle = numbered(track_id)
    order = np.lexsort((time_ns, vehicle))
    time = time_ns[order]
    gap_ns = int(MAX_DIFFERENCE_GAP_S * 1e9)
    half_ns = int(DIFFERENCE_HALF_WINDOW_S * 1e9)
    breaks = (np.diff(vehicle[order]) != 0) | (np.diff(time) > gap_ns)
    piece = np.concatenate([[0], np.cumsum(breaks)]) if time.size else np.empty(0, np.int64)
    # Pieces end to end on one axis, further apart than the window, so one search serves all of them.
    first = np.flatnonzero(np.concatenate([[True], breaks])) if time.size else np.empty(0, np.int64)
    last = np.concatenate([first[1:], [time.size]]) - 1 if time.size else first
    length = time[last] - time[first] + 2 * half_ns + 1
    start = np.cumsum(length) - length
    axis = time - time[first][piece] + start[piece]
    row = np.arange(time.size)
    before = np.searchsorted(axis, axis - half_ns, side="left")
    after = np.searchsorted(axis, axis + half_ns, side="right") - 1
    before = np.where(before == row, np.maximum(row - 1, first[piece]), before)
    after = np.where(after == row, np.minimum(row + 1, last[piece]), after)
    span_s = (time[after] - time[before]) * 1e-9
    velocity = np.full((time.size, 2), np.nan)
    moved = position[order][after] - position[order][before]
    np.divide(moved, span_s[:, None], out=velocity, where=span_s[:, None] > 0)
    result = np.empty_like(velocity)
    result[order] = velocity
    return result
