"""Ids of vehicles: as logs hold them, as numbers, and as names that no two groups share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from dirprim_filter.arrays import AnyArray, BoolArray, IntArray

NO_NAMES = ("", "nan", "NaN", "NAN", "None", "null", "NULL", "N/A", "n/a", "<NA>")
"""What other tools write for no id."""
BLOCK_ROWS = 1 << 14
"""So many ids at a time are Python's own texts."""


class Numbers(dict[str, int]):
    """Names, numbered as they first come."""

    def __missing__(self, name: str) -> int:
        self[name] = len(self)
        return len(self) - 1

    def of(self, names: Sequence[str]) -> IntArray:
        """(n,) the number of each name; a new one for a new name."""
        return np.fromiter(map(self.__getitem__, names), np.int64, len(names))


def numbered(track_id: AnyArray) -> tuple[list[str], IntArray]:
    """The ids as text, each once, as they first come, and (n,) the place of each row's among them.

    Text is hashed block by block: sorting it would hold it twice, and take ten times as long.
    """
    numbers, place = Numbers(), np.empty(track_id.size, np.int64)
    for start in range(0, track_id.size, BLOCK_ROWS):
        rows = slice(start, start + BLOCK_ROWS)
        place[rows] = numbers.of(as_texts(track_id[rows]).tolist())
    return list(numbers), place


def rows_of_each(number: IntArray) -> list[IntArray]:
    """The rows of each of the (n,) numbers that come, ascending."""
    order = np.argsort(number, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(number[order])) + 1) if order.size else []


def stand_for_none(names: AnyArray, place: IntArray, time_ns: IntArray) -> BoolArray:
    """(m,) which of the (m,) str names mean that there is no id, as other tools write it.

    -1 does where all other ids are numbers of 0 or more, and two of its rows are of one time.

    Args:
        names: each once.
        place: (n,) of each row's name among them.
        time_ns: (n,) of the rows.
    """
    is_none = np.isin(np.strings.strip(names), NO_NAMES)
    minus = names == "-1"
    if minus.any() and all(name.rpartition("/")[2].isdecimal() for name in names[~(minus | is_none)].tolist()):
        times = time_ns[minus[place]]
        is_none |= minus & (np.unique(times).size < times.size)
    return np.asarray(is_none)


def as_track_ids(value: npt.ArrayLike) -> AnyArray:
    """Track ids as an array of int64, or of str where one of them is no canonical decimal int64.

    Logs hold ids as text; "7" and 7 are the same id, "07" and "7" are not.
    """
    array = np.asarray(value)
    if array.dtype.kind == "i" or (array.dtype.kind == "u" and array.dtype.itemsize < 8):
        return array.astype(np.int64, copy=False)
    text = as_texts(array)
    try:
        number = text.astype(np.int64)
    except (ValueError, OverflowError):
        return text
    return number if (number.astype(text.dtype) == text).all() else text


def as_texts(track_id: AnyArray) -> AnyArray:
    """Track ids as text, as logs hold them."""
    return track_id if track_id.dtype.kind == "U" else track_id.astype(np.str_)


def vehicle_numbers(track_id: AnyArray, group: IntArray) -> IntArray:
    """(n,) the number of each row's vehicle, in order of group and id: an id in two groups is two vehicles."""
    number = _numbers_of(track_id)
    if group.size and (group != group[0]).any():
        number = _numbers_of(_numbers_of(group) * (int(number.max()) + 1) + number)
    return number


def qualified_names(track_id: AnyArray, group: IntArray) -> AnyArray:
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
        return np.asarray(np.unique(np.array(names, np.str_), return_inverse=True)[1][place], np.int64)
    if key.size:
        low, high = int(key.min()), int(key.max())
        if high - low <= 4 * key.size:  # a table of all keys between costs less than sorting
            seen, at = np.zeros(high - low + 1, np.bool_), key - low if low else key
            seen[at] = True
            return np.asarray(at if seen.all() else (np.cumsum(seen) - 1)[at], np.int64)
    return np.asarray(np.unique(key, return_inverse=True)[1], np.int64)


def in_order(vehicle: IntArray, time_ns: IntArray) -> IntArray:
    """(n,) the rows by vehicle, numbered from 0, and time; of equal ones the first stays first."""
    if (time_ns[1:] < time_ns[:-1]).any():
        return np.lexsort((time_ns, vehicle))
    few = vehicle.max(initial=0) <= np.iinfo(np.uint16).max  # which are sorted ten times as fast
    return np.argsort(vehicle.astype(np.uint16) if few else vehicle, kind="stable")


def check_not_repeated(track_id: AnyArray, time_ns: IntArray, group: IntArray) -> None:
    """No vehicle has two rows at one time.

    Raises:
        ValueError: names the first that has.
    """
    repeated = repeated_rows(vehicle_numbers(track_id, group), time_ns)
    if repeated.any():
        row = int(np.argmax(repeated))
        raise ValueError(f"track_id, time_ns: vehicle {track_id[row]} has two rows at {time_ns[row]} ns; keep one")


def repeated_rows(track_id: AnyArray, time_ns: IntArray) -> BoolArray:
    """(n,) where a row repeats the vehicle and the time of an earlier row."""
    vehicle = _numbers_of(track_id)
    return repeated_in(in_order(vehicle, time_ns), vehicle, time_ns)


def repeated_in(order: IntArray, vehicle: IntArray, time_ns: IntArray) -> BoolArray:
    """The same of numbered vehicles, by the order that `in_order` says."""
    same = (np.diff(vehicle[order]) == 0) & (np.diff(time_ns[order]) == 0)
    repeated = np.zeros(len(time_ns), np.bool_)
    repeated[order[1:][same]] = True
    return repeated
