"""Who is being tracked: each track's slot in the filter, and what is known of it beside the belief."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.config import TrackingConfig
from dirprim_filter.filtering import existence
from dirprim_filter.filtering.protocols import BayesFilter

FIRST_CAPACITY = 16
GAP_INTERVALS = 3.0
"""Of the usual intervals between detections of a vehicle so many may pass without one before its belief ends."""
TENTATIVE = "\0"
"""Prefix of the names of tentative unlabelled tracks: no sensor's id begins with it."""
_COLUMNS = (
    "time_ns", "existence_ns", "measured_ns", "counted_ns", "is_labelled", "is_confirmed", "existence",
    "outside", "in_sight", "ends", "n_unexplained", "log_evidence", "cue", "interval",
)  # fmt: skip


class Roster:
    """Slots are given to tracks as they come and taken back when they go; when all are taken, their number doubles.

    Attributes:
        time_ns: (slots,) the time each belief holds for.
        existence_ns: (slots,) the time its existence holds for.
        measured_ns: (slots,) the time of its last measurement.
        counted_ns: (slots,) the time of the last frame that counted as a hit or a miss of it.
        is_labelled: (slots,) whether its sensor gives it an id.
        is_confirmed: (slots,) whether it was ever confirmed.
        existence: (slots, 3) see `existence`.
        outside: (slots,) probability that it is outside of the map's cells.
        in_sight: (slots,) probability that it is where its sensor sees.
        ends: (slots,) 1/s, rate at which journeys end where it was when its existence was last moved on.
        n_unexplained: (slots,) consecutive measurements that its belief did not explain.
        least_gap_ns: nanoseconds without a measurement after which a track ends, where its intervals are not longer.
        log_evidence: (slots,) of its measurement in this frame; 0 where there is none.
        interval: (slots, 2) nanoseconds, usual time between two of its detections and jitter of that; 0 while unknown.
        cue: (slots, 2) what it is weighed by, as in `Detections`; NaN for nothing.
    """

    def __init__(self, bayes_filter: BayesFilter) -> None:
        self._filter = bayes_filter
        self._slot: dict[str, int] = {}
        self._free: list[int] = []
        self._members: dict[bool, tuple[list[str], IntArray]] = {}  # until a track begins or ends
        self._n_tentative = self._n_numbered = 0
        self.time_ns: IntArray = np.empty(0, np.int64)
        self.existence_ns: IntArray = np.empty(0, np.int64)
        self.measured_ns: IntArray = np.empty(0, np.int64)
        self.counted_ns: IntArray = np.empty(0, np.int64)
        self.is_labelled: BoolArray = np.empty(0, np.bool_)
        self.is_confirmed: BoolArray = np.empty(0, np.bool_)
        self.existence: FloatArray = np.empty((0, 3))
        self.outside: FloatArray = np.empty(0)
        self.in_sight: FloatArray = np.empty(0)
        self.ends: FloatArray = np.empty(0)
        self.n_unexplained: IntArray = np.empty(0, np.int64)
        self.log_evidence: FloatArray = np.empty(0)
        self.cue: FloatArray = np.empty((0, 2))
        self.interval: FloatArray = np.empty((0, 2))
        self.least_gap_ns = 0.0
        self._grow(FIRST_CAPACITY)

    def __len__(self) -> int:
        return len(self._slot)

    def __contains__(self, name: str) -> bool:
        return name in self._slot

    def enter(self, names: Sequence[str], *, is_labelled: bool, time_ns: int, exists: FloatArray) -> IntArray:
        """(v,) slots for tracks that have none yet; they begin with a detection at `time_ns`, and `exists` (v, 3)."""
        if len(names) > len(self._free):
            self._grow(max(self.time_ns.size, len(names)))
        self._members.clear()
        slot = np.array([self._free.pop() for _ in names], dtype=np.int64)
        self._slot.update(zip(names, slot.tolist(), strict=True))
        for column in (self.time_ns, self.existence_ns, self.measured_ns, self.counted_ns):
            column[slot] = time_ns
        self.is_labelled[slot] = is_labelled
        self.is_confirmed[slot] = False
        self.existence[slot] = exists
        self.outside[slot] = 0.0
        self.in_sight[slot] = 1.0
        self.ends[slot] = 0.0
        self.n_unexplained[slot] = 0
        self.log_evidence[slot] = 0.0
        self.cue[slot] = np.nan
        self.interval[slot] = 0.0
        return slot

    @property
    def probability(self) -> FloatArray:
        """(slots,) that there is such a vehicle."""
        return existence.probability(self.existence, self.outside, self.in_sight)

    def rename(self, old: str, new: str) -> None:
        """Call a track by another name."""
        self._members.clear()
        self._slot[new] = self._slot.pop(old)

    def tentative_names(self, n: int) -> list[str]:
        """Names of unlabelled tracks until they are confirmed; none was given before."""
        self._n_tentative += n
        return [f"{TENTATIVE}{i}" for i in range(self._n_tentative - n, self._n_tentative)]

    def number(self, name: str) -> None:
        """Call a track by the next number that no sensor uses as an id."""
        self._n_numbered += 1
        while (new := f"track-{self._n_numbered}") in self:
            self._n_numbered += 1
        self.rename(name, new)

    def confirm(self, *, above: float) -> None:
        """Note who exists with at least that probability, and number the unlabelled among them."""
        self.is_confirmed |= self.probability >= above
        names, slot = self.members(is_labelled=False)
        for name in compress(names, self.is_confirmed[slot].tolist()):
            if name.startswith(TENTATIVE):
                self.number(name)

    def slots_of(self, names: Sequence[str]) -> IntArray:
        """(v,) the slots of tracks that have one."""
        return np.array([self._slot[name] for name in names], dtype=np.int64)

    def names_of(self, slot: IntArray) -> list[str]:
        """The names of those who have the slots (v,)."""
        names = {place: name for name, place in self._slot.items()}
        return [names[place] for place in slot.tolist()]

    def members(self, *, is_labelled: bool) -> tuple[list[str], IntArray]:
        """Names and slots (v,) of those with, or without, an id of their sensor's; in the order they came."""
        if is_labelled not in self._members:
            slot = np.fromiter(self._slot.values(), np.int64, len(self._slot))
            chosen = self.is_labelled[slot] == is_labelled
            self._members[is_labelled] = list(compress(self._slot, chosen.tolist())), slot[chosen]
        return self._members[is_labelled]

    def spare(self, n: int) -> IntArray:
        """(n,) free slots, for temporary beliefs until a track takes them."""
        if n > len(self._free):
            self._grow(max(self.time_ns.size, n))
        return np.array(self._free[len(self._free) - n :], dtype=np.int64)

    @property
    def last_ns(self) -> FloatArray:
        """(slots,) when each track ends, unless it is measured before."""
        return np.asarray(self.measured_ns + np.maximum(self.least_gap_ns, GAP_INTERVALS * self.interval[:, 0]))

    def forget(self, *, now_ns: int, config: TrackingConfig) -> None:
        """End tracks not measured for too long, and those that hardly exist."""
        hopeless = (
            config.forget_below * existence.at_birth(np.array([config.birth_density]), config)[0, existence.VISIBLE]
        )
        ended = (self.probability < hopeless) | (self.last_ns < now_ns)
        for is_labelled in (True, False):
            names, slot = self.members(is_labelled=is_labelled)
            gone = list(compress(names, ended[slot].tolist()))
            if gone:
                self._members.clear()
                self._free += [self._slot.pop(name) for name in gone]

    def _grow(self, n_more: int) -> None:
        old = self.time_ns.size
        for name in _COLUMNS:
            column = getattr(self, name)
            more = np.zeros((n_more, *column.shape[1:]), column.dtype)
            setattr(self, name, np.concatenate([column, more]))
        self._free = [*range(old + n_more - 1, old - 1, -1), *self._free]
        self._filter.reserve(old + n_more)
