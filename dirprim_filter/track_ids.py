"""Ids of vehicles: as logs hold them, as numbers, and as names that no two groups share."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from dirprim_filter.arrays import AnyArray, BoolArray, IntArray

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
        place[start : start + BLOCK_ROWS] = numbers.of(block.tolist())
    return list(numbers), place


def as_track_ids(value: npt.ArrayLike) -> AnyArray:
    """Track ids as an array of int64, or of str where one of them is no canonical decimal int64.

    Logs hold ids as text; "7" and 7 are the same id, "07" and "7" are not.
    """
    array = np.asarray(value)
    if array.dtype.kind == "i" or (array.dtype.kind == "u" and array.dtype.itemsize < 8):
        return array.astype(np.int64, copy=False)
    text = as_texts(array)
    blocks = (set(text[start : start + BLOCK_ROWS].tolist()) for start in range(0, text.size, BLOCK_ROWS))
    return text.astype(np.int64) if all(_is_decimal_int64(name) for block in blocks for name in block) else text


@lru_cache(maxsize=1 << 16)
def _is_decimal_int64(name: str) -> bool:
    digits = name.removeprefix("-")
    if not (digits.isascii() and digits.isdigit() and len(digits) <= 19):
        return False
    number = int(name)
    return str(number) == name and -(1 << 63) <= number < 1 << 63


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
        order = np.empty(len(names), np.int64)
        order[np.argsort(np.array(names, dtype=np.str_))] = np.arange(len(names))
        return order[place]
    if key.size:
        low, high = int(key.min()), int(key.max())
        if high - low <= 4 * key.size:  # a table of all keys between costs less than sorting
            seen, at = np.zeros(high - low + 1, np.bool_), key - low if low else key
            seen[at] = True
            return np.asarray(at if seen.all() else (np.cumsum(seen) - 1)[at], np.int64)
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
    vehicle = _numbers_of(track_id)
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
