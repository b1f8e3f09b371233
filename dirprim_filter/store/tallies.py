"""Sums of whole numbers by key: they add, subtract, and come out the same in any order and grouping."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from dirprim_filter.arrays import ArrayValue, IntArray


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
    def of(cls, key: IntArray, value: IntArray) -> Self:
        """The sums of rows, in whatever order; keys that nothing is left of are left out.

        Args:
            key: (n, k) of each row.
            value: (n, v) of each row.

        Raises:
            ValueError: more is taken away from a key than it has.
        """
        order = np.lexsort(key.T[::-1])
        key, value = key[order], value[order]
        first = np.flatnonzero(np.append(True, (key[1:] != key[:-1]).any(axis=1))[: len(key)])
        if first.size == len(key):
            total = value
        else:
            key, total = key[first], np.add.reduceat(value, first, axis=0)
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
        """The sums of all parts, of which there is at least one."""
        if len(parts) == 1:
            return parts[0]
        return cls.of(np.concatenate([p.key for p in parts]), np.concatenate([p.value for p in parts]))

    def __len__(self) -> int:
        return len(self.key)

    def __getitem__(self, rows: slice) -> Self:
        """Some of the keys."""
        return type(self)(key=self.key[rows], value=self.value[rows])

    def __add__(self, other: Self) -> Self:
        return self.total([self, other])

    def __sub__(self, other: Self) -> Self:
        return self.of(np.concatenate([self.key, other.key]), np.concatenate([self.value, -other.value]))
