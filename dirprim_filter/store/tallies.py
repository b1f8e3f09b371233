"""Sums of whole numbers by key: they add, subtract, and come out the same in any order and grouping."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np

from dirprim_filter.arrays import AnyArray, ArrayValue, IntArray
from dirprim_filter.store._counting import as_they_come, summed

BLOCK_KEYS = 1 << 16
"""So many of a tally at a time are added to others."""
N_BITS = 63
MOST_CODES = (1 << N_BITS) - 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tally(ArrayValue):
    """Sums for each key; keys ascend, each stands once, and the first of its sums, which counts, is positive.

    Attributes:
        key: (n, k) whole numbers, in order of the first column, then of the next.
        value: (n, v) sums.
    """

    key: IntArray
    value: IntArray

    @classmethod
    def of(cls, key: IntArray, value: AnyArray) -> Self:
        """The sums of rows, in whatever order; keys that nothing is left of are left out.

        Args:
            key: (n, k) of each row.
            value: (n, v) of each row, whole numbers of any width.

        Raises:
            ValueError: more is taken away from a key than it has.
        """
        row, total = summed_by(key.T, value)
        key = key[row]
        kept = total[:, 0] != 0
        if (total[:, 0] < 0).any() or total[~kept].any():
            raise ValueError("other: expected a part of what it is taken from, got counts that are not in there")
        return cls(key=key[kept], value=total[kept]) if not kept.all() else cls(key=key, value=total)

    @classmethod
    def none(cls, n_keys: int, n_values: int) -> Self:
        """No key."""
        return cls(key=np.empty((0, n_keys), np.int64), value=np.empty((0, n_values), np.int64))

    @classmethod
    def total(cls, parts: list[Self]) -> Self:
        """The sums of all parts, of which there is at least one; some keys at a time, which takes little memory."""
        if len(parts) == 1:
            return parts[0]
        ahead = max(parts, key=len).key[::BLOCK_KEYS, 0]
        cuts = [[0, *np.searchsorted(part.key[:, 0], np.unique(ahead)[1:]).tolist(), len(part)] for part in parts]
        n, n_most = 0, sum(map(len, parts))
        key, value = (np.empty((n_most, of.shape[1]), np.int64) for of in (parts[0].key, parts[0].value))
        for bounds in zip(*map(pairwise, cuts), strict=True):
            some = [part[slice(*rows)] for part, rows in zip(parts, bounds, strict=True) if rows[0] < rows[1]]
            if len(some) > 1:
                some = [cls.of(np.concatenate([p.key for p in some]), np.concatenate([p.value for p in some]))]
            for piece in some:
                key[n : n + len(piece)], value[n : n + len(piece)] = piece.key, piece.value
                n += len(piece)
        return cls(key=key[:n], value=value[:n])

    def __len__(self) -> int:
        return len(self.key)

    def __getitem__(self, rows: slice) -> Self:
        """Some of the keys."""
        return type(self)(key=self.key[rows], value=self.value[rows])

    def __add__(self, other: Self) -> Self:
        return self.total([self, other])

    def __sub__(self, other: Self) -> Self:
        return self.of(np.concatenate([self.key, other.key]), np.concatenate([self.value, -other.value]))


def summed_by(columns: Sequence[IntArray] | IntArray, value: AnyArray) -> tuple[IntArray, IntArray]:
    """(m,) a row of each key, the keys ascending, and (m, v) the sums of its rows. k columns (n,), (n, v)."""
    code, order = _sorted(_codes(columns))
    first = np.flatnonzero(np.append(True, code[1:] != code[:-1])[: code.size])
    return order[first], summed(order, first, np.ascontiguousarray(value))


def _sorted(code: IntArray) -> tuple[IntArray, IntArray]:
    """(n,) numbers, none negative, ascending; and their order. With the row's number inside they sort twice as fast."""
    bits = code.size.bit_length()
    if int(code.max(initial=0)).bit_length() + bits > N_BITS:
        order = np.argsort(code)
        return code[order], order
    both = (code << bits) | np.arange(code.size)
    both.sort()
    return both >> bits, both & ((1 << bits) - 1)


def ranked(values: IntArray) -> IntArray:
    """(n,) the place of each value among the different ones, ascending."""
    number = np.empty(values.size, np.int64)
    different = as_they_come(np.ascontiguousarray(values), number)
    rank = np.empty(different.size, np.int64)
    rank[np.argsort(different)] = np.arange(different.size)
    return np.asarray(rank[number])


def _codes(columns: Sequence[IntArray] | IntArray) -> IntArray:
    """(n,) a number for each key, in the order of the keys: one column sorts many times as fast as several."""
    code, n = np.zeros(len(columns[0]), np.int64), 1
    for column in columns if code.size else ():
        low = int(column.min())
        m = int(column.max()) - low + 1
        if n * m > MOST_CODES and m > code.size:
            column = ranked(column)  # noqa: PLW2901
            low, m = 0, int(column.max()) + 1
        if n * m > MOST_CODES:
            code = ranked(code)
            n = int(code.max()) + 1
        code *= m
        code += column - low
        n *= m
    return code
