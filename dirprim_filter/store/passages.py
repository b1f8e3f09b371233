"""Passages: visits of ways to cells, from which it follows which manoeuvre went before which."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple, Self

import numpy as np
from scipy.sparse import csr_array

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.primitives.visits import STEP_S

STEP_NS = round(STEP_S * 1e9)
ADJACENT_NS = STEP_NS + STEP_NS // 2
"""From the last instant of a visit to the first of the next. A half more, as ways may be filled in from other rows."""
WEIGHT_UNIT = 2.0**-12
"""Weights are whole multiples of it, so that sums do not depend on order."""


class Passages(NamedTuple):
    """Visits to cells, as ways tell them."""

    way: IntArray  # (v,)
    begin_ns: IntArray  # (v,) since the way began
    end_ns: IntArray  # (v,) its last instant
    manoeuvre: IntArray  # (v,) a number; -1 where it was withheld
    share: FloatArray  # (v,) of the vehicles of that age, those that are left where the cell is

    @classmethod
    def together(cls, parts: Iterable[Self]) -> Self:
        """All of them."""
        none = cls(*np.empty((len(cls._fields), 0), np.int64))
        return cls(*(np.concatenate(column) for column in zip(none, *parts, strict=True)))

    def at_ends(self) -> Self:
        """Those that none of these comes before or after: vehicles may come from elsewhere there, or go on."""
        order, follows = self._in_order()
        between = np.append(False, follows)[: order.size] & np.append(follows, False)[: order.size]
        return type(self)(*(column[order[~between]] for column in self))

    def _in_order(self) -> tuple[IntArray, BoolArray]:
        """(v,) by ways and times, and (v - 1,) whether each is followed by the next."""
        order = np.lexsort((self.begin_ns, self.way))
        way, begin, end = self.way[order], self.begin_ns[order], self.end_ns[order]
        return order, (way[1:] == way[:-1]) & (begin[1:] - end[:-1] <= ADJACENT_NS)

    def followed(self) -> Followed:
        """Which manoeuvre followed which."""
        order, follows = self._in_order()
        number, share = self.manoeuvre[order], self.share[order]
        follows &= (number[1:] >= 0) & (number[:-1] >= 0)
        before, after = share[:-1][follows], share[1:][follows]
        # Of the ways that are left here, those that are left there as well are seen to go on.
        weight = np.round(before / np.minimum(before, after) / WEIGHT_UNIT) * WEIGHT_UNIT
        return Followed(number[:-1][follows], number[1:][follows], weight)


class Followed(NamedTuple):
    """One manoeuvre after the other."""

    one: IntArray  # (n,)
    other: IntArray  # (n,)
    weight: FloatArray  # (n,) of how many it stands for

    def some(self, rows: BoolArray) -> Followed:
        """Those that are chosen, (n,)."""
        return Followed(*(column[rows] for column in self))  # type: ignore[arg-type]

    def counted(self, z: int, least: int) -> csr_array:
        """(z, z) how often one followed the other, where it was seen at least so often."""
        pair, row, n = np.unique(self.one * z + self.other, return_inverse=True, return_counts=True)
        often = n >= least
        one, other = np.divmod(pair[often], max(z, 1))
        total = np.bincount(row, self.weight, pair.size)[often].astype(np.float64)  # whole numbers where there are none
        return csr_array((total, (one, other)), shape=(z, z))
