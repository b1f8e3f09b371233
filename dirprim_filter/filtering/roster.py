"""Who is being tracked: each vehicle's slot in the filter, and what is known of it beside the belief."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress

import numpy as np

from dirprim_filter.filtering.existence import GONE
from dirprim_filter.filtering.protocols import BayesFilter
from tessellation.arrays import BoolArray, FloatArray, IntArray

FIRST_CAPACITY = 16


class Roster:
    """Slots are given to vehicles as they come and taken back when they go; when all are taken, their number doubles.

    Attributes:
        time_ns: (slots,) the time each belief holds for.
        measured_ns: (slots,) the time of its last measurement.
        is_named: (slots,) whether its sensor names it.
        is_confirmed: (slots,) whether a vehicle without an id has been told of.
        existence: (slots, 3) see `existence`.
        n_unexplained: (slots,) how many of its last measurements, in a row, it did not explain.
        log_evidence: (slots,) of its measurement in this frame; 0 where there is none.
    """

    def __init__(self, bayes_filter: BayesFilter) -> None:
        self._filter = bayes_filter
        self._slot: dict[str, int] = {}
        self._free: list[int] = []
        self._members: dict[bool, tuple[list[str], IntArray]] = {}  # until somebody comes or goes
        self.time_ns: IntArray = np.empty(0, np.int64)
        self.measured_ns: IntArray = np.empty(0, np.int64)
        self.is_named: BoolArray = np.empty(0, np.bool_)
        self.is_confirmed: BoolArray = np.empty(0, np.bool_)
        self.existence: FloatArray = np.empty((0, 3))
        self.n_unexplained: IntArray = np.empty(0, np.int64)
        self.log_evidence: FloatArray = np.empty(0)
        self._grow(FIRST_CAPACITY)

    def __len__(self) -> int:
        return len(self._slot)

    def __contains__(self, name: str) -> bool:
        return name in self._slot

    def enter(self, names: Sequence[str], *, is_named: bool, time_ns: IntArray) -> IntArray:
        """(v,) slots for vehicles that have none yet, first measured at `time_ns` (v,)."""
        if len(names) > len(self._free):
            self._grow(max(self.time_ns.size, len(names)))
        self._members.clear()
        slot = np.array([self._free.pop() for _ in names], dtype=np.int64)
        self._slot.update(zip(names, slot.tolist(), strict=True))
        self.time_ns[slot] = self.measured_ns[slot] = time_ns
        self.is_named[slot] = is_named
        self.is_confirmed[slot] = False
        self.existence[slot] = [1.0, 0.0, 0.0]
        self.n_unexplained[slot] = 0
        self.log_evidence[slot] = 0.0
        return slot

    def slots_of(self, names: Sequence[str]) -> IntArray:
        """(v,) the slots of vehicles that have one."""
        return np.array([self._slot[name] for name in names], dtype=np.int64)

    def names_of(self, slot: IntArray) -> list[str]:
        """The names of those who have the slots (v,)."""
        names = {place: name for name, place in self._slot.items()}
        return [names[place] for place in slot.tolist()]

    def members(self, *, is_named: bool) -> tuple[list[str], IntArray]:
        """Names and slots (v,) of those with, or without, a name of their sensor's; in the order they came."""
        if is_named not in self._members:
            slot = np.fromiter(self._slot.values(), np.int64, len(self._slot))
            chosen = self.is_named[slot] == is_named
            self._members[is_named] = list(compress(self._slot, chosen.tolist())), slot[chosen]
        return self._members[is_named]

    def spare(self, n: int) -> IntArray:
        """(n,) slots that nobody has: room to think in, until somebody enters."""
        if n > len(self._free):
            self._grow(max(self.time_ns.size, n))
        return np.array(self._free[len(self._free) - n :], dtype=np.int64)

    def forget(self, *, before_ns: int, forget_below: float) -> None:
        """End those not measured since `before_ns`, and of the nameless those that hardly exist."""
        doubtful = ~self.is_named & (1.0 - self.existence[:, GONE] < forget_below)
        ended = doubtful | (self.measured_ns < before_ns)
        for is_named in (True, False):
            names, slot = self.members(is_named=is_named)
            gone = list(compress(names, ended[slot].tolist()))
            if gone:
                self._members.clear()
                self._free += [self._slot.pop(name) for name in gone]

    def _grow(self, n_more: int) -> None:
        old = self.time_ns.size
        for name in ("time_ns", "measured_ns", "is_named", "is_confirmed", "existence", "n_unexplained",
                     "log_evidence"):  # fmt: skip
            column = getattr(self, name)
            more = np.zeros((n_more, *column.shape[1:]), column.dtype)
            setattr(self, name, np.concatenate([column, more]))
        self._free = [*range(old + n_more - 1, old - 1, -1), *self._free]
        self._filter.reserve(old + n_more)
