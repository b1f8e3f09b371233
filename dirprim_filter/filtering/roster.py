"""Who is being tracked: each track's slot in the filter, what is known beside its belief, and when it is due.

A frame without a vehicle is a miss only if its turn had come. Where one frame holds all vehicles, every frame without
one is a miss of it. Where each vehicle reports itself, in messages with times of their own, the frames of others say
nothing of it. And a sensor that looks at a vehicle each ten seconds needs beliefs that last longer than that.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterable, Sequence
from itertools import compress
from typing import Any

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.config import TrackingConfig
from dirprim_filter.filtering import existence
from dirprim_filter.filtering.protocols import BayesFilter, OnMap

FIRST_CAPACITY = 16
GAP_INTERVALS = 3.0
"""Of the usual intervals between detections of a vehicle so many may pass without one before its belief ends."""
SLOW_NS = 1e9
"""A sensor that looks at a vehicle less often is for vehicles that stay longer: existence changes slower."""
TENTATIVE = "\0"
"""Prefix of the names of tentative unlabelled tracks: no sensor's id begins with it."""
REMEMBERED = 9
DUE_FROM, JITTERS = 0.75, 2.0
"""Share of the usual time after which the next detection is due, as sensors are not exact; and how many deviations of
these times later."""
MOST_NS = 300_000_000_000
"""What passes for longer is a pause of the log or a vehicle that comes back, and no interval of a sensor."""
MOST_NAMES = 1000
"""Beyond so many names those are forgotten that were not seen for so long."""
_EMPTY: dict[str, Any] = {
    "time_ns": np.int64(0), "existence_ns": np.int64(0), "measured_ns": np.int64(0), "counted_ns": np.int64(0),
    "is_labelled": np.False_, "is_confirmed": np.False_, "existence": np.zeros(3), "outside": 0.0,
    "ends": 0.0, "n_unexplained": np.int64(0), "log_evidence": 0.0, "cue": np.full(2, np.nan), "interval": np.zeros(2),
}  # fmt: skip
"""The columns, and what a track has in each before it begins."""


class Gaps:
    """The last times between two of some events."""

    def __init__(self) -> None:
        self.seen_ns: int | None = None  # of the last event
        self._gaps: deque[int] = deque(maxlen=REMEMBERED)
        self.usual_ns = 0, 0  # lower median, and median of how far off it they are; 0 while unknown

    def add(self, gap_ns: int) -> None:
        """One more, unless it is a pause."""
        if gap_ns <= MOST_NS:
            is_same = len(self._gaps) == REMEMBERED and self._gaps[0] == gap_ns
            self._gaps.append(gap_ns)
            if not is_same:  # most sensors are regular
                usual = _median(list(self._gaps))
                self.usual_ns = usual, _median([abs(gap - usual) for gap in self._gaps])

    def see(self, time_ns: int) -> None:
        """One more event."""
        if self.seen_ns is not None:
            self.add(time_ns - self.seen_ns)
        self.seen_ns = time_ns


class Intervals:
    """How often a sensor looks: at each vehicle that it labels, by its own detections alone; at all others; at all."""

    def __init__(self) -> None:
        self.of_frames, self.of_others = Gaps(), Gaps()  # of others: from one detection to the next
        self._of: dict[str, Gaps] = defaultdict(Gaps)

    def see(self, names: Sequence[str], time_ns: int) -> None:
        """Take the labelled vehicles of a frame."""
        self.of_frames.see(time_ns)
        for name in names:
            self._of[name].see(time_ns)
        if len(self._of) > 2 * len(names) + MOST_NAMES:
            for name in [name for name, of in self._of.items() if time_ns - (of.seen_ns or 0) > MOST_NS]:
                del self._of[name]

    def of(self, names: Iterable[str]) -> FloatArray:
        """(n, 2) usual time and jitter of each, nanoseconds."""
        return np.array([self._of[name].usual_ns for name in names], np.float64).reshape(-1, 2)


def _median(times: Sequence[int]) -> int:
    return sorted(times)[(len(times) - 1) // 2]


class Roster:
    """Slots are given to tracks as they come and taken back when they go; when all are taken, their number doubles.

    Args:
        bayes_filter: holds their beliefs.
        config: rates, and when a track is confirmed.
        max_gap_s: seconds without a measurement after which a track ends, where its sensor's intervals are not longer.

    Attributes:
        longest_gap_ns: nanoseconds without a measurement after which every track ends.
    """

    time_ns: IntArray  # (slots,) the time each belief holds for
    existence_ns: IntArray  # (slots,) the time its existence holds for
    measured_ns: IntArray  # (slots,) the time of its last measurement
    counted_ns: IntArray  # (slots,) the time of the last frame that counted as a hit or a miss of it
    is_labelled: BoolArray  # (slots,) whether its sensor gives it an id
    is_confirmed: BoolArray  # (slots,) whether it was ever confirmed
    existence: FloatArray  # (slots, 3) see `existence`
    outside: FloatArray  # (slots,) probability that it is outside of the map's cells
    ends: FloatArray  # (slots,) 1/s, rate at which trajectories end where it was at `existence_ns`
    n_unexplained: IntArray  # (slots,) consecutive measurements that its belief did not explain
    log_evidence: FloatArray  # (slots,) of its measurement in this frame; 0 where there is none
    cue: FloatArray  # (slots, 2) what it is weighed by, as in `Detections`; NaN for nothing
    interval: FloatArray  # (slots, 2) ns, usual time between two of its detections, and jitter; 0 while unknown

    def __init__(self, bayes_filter: BayesFilter, config: TrackingConfig, *, max_gap_s: float) -> None:
        self._filter, self._config = bayes_filter, config
        self._on_map = bayes_filter if isinstance(bayes_filter, OnMap) else None
        self._slot: dict[str, int] = {}
        self._slots: IntArray | None = None  # of these, since they last changed
        self._name: dict[int, str] = {}
        self._free: list[int] = []
        self._n_tentative = self._n_numbered = 0
        self._intervals = Intervals()
        self._max_gap_ns = self._least_gap_ns = max_gap_s * 1e9
        self.longest_gap_ns = int(self._max_gap_ns)
        self._grow(FIRST_CAPACITY)

    def __len__(self) -> int:
        return len(self._slot)

    def __contains__(self, name: str) -> bool:
        return name in self._slot

    def enter(self, names: Sequence[str], *, is_labelled: BoolArray, time_ns: int, exists: FloatArray) -> IntArray:
        """(v,) slots for tracks that have none yet; they begin with a detection at `time_ns`, and `exists` (v, 3)."""
        if len(names) > len(self._free):
            self._grow(max(self.time_ns.size, len(names)))
        slot = np.array([self._free.pop() for _ in names], dtype=np.int64)
        self._slot.update(zip(names, slot.tolist(), strict=True))
        self._slots = None
        self._name.update(zip(slot.tolist(), names, strict=True))
        for name, empty in _EMPTY.items():
            getattr(self, name)[slot] = empty
        for column in (self.time_ns, self.existence_ns, self.measured_ns, self.counted_ns):
            column[slot] = time_ns
        self.is_labelled[slot], self.existence[slot] = is_labelled, exists
        self.interval[slot[is_labelled]] = self._intervals.of(compress(names, is_labelled.tolist()))
        return slot

    @property
    def slots(self) -> IntArray:
        """(v,) of all tracks, in the order they came."""
        if self._slots is None:
            self._slots = np.fromiter(self._slot.values(), np.int64, len(self._slot))
        return self._slots

    @property
    def labelled(self) -> IntArray:
        """(v,) slots of those with an id of their sensor's."""
        slot = self.slots
        return slot[self.is_labelled[slot]]

    @property
    def unlabelled(self) -> IntArray:
        """(v,) slots of the others."""
        slot = self.slots
        return slot[~self.is_labelled[slot]]

    @property
    def probability(self) -> FloatArray:
        """(slots,) that there is such a vehicle."""
        return existence.probability(self.existence, self.outside)

    def tentative_names(self, n: int) -> list[str]:
        """Names of unlabelled tracks until they are confirmed; none was given before."""
        self._n_tentative += n
        return [f"{TENTATIVE}{i}" for i in range(self._n_tentative - n, self._n_tentative)]

    def number(self, name: str) -> None:
        """Call a track by the next number that no sensor uses as an id."""
        self._n_numbered += 1
        while (new := f"track-{self._n_numbered}") in self:
            self._n_numbered += 1
        self._slot[new] = slot = self._slot.pop(name)
        self._slots = None
        self._name[slot] = new

    def give_way(self, names: Sequence[str]) -> None:
        """Number unlabelled tracks anew that have one of these ids: the sensor's come before ours."""
        slot = self.slots_of(names)
        for name in compress(names, ((slot >= 0) & ~self.is_labelled[slot]).tolist()):
            self.number(name)

    def slots_of(self, names: Sequence[str]) -> IntArray:
        """(v,) the slot of each track; -1 of a name that none has."""
        return np.array([self._slot.get(name, -1) for name in names], dtype=np.int64)

    def names_of(self, slot: IntArray) -> list[str]:
        """The names of those who have the slots (v,)."""
        return [self._name[place] for place in slot.tolist()]

    def without(self, slot: IntArray, others: IntArray) -> IntArray:
        """Those of the slots (v,) that are not among others."""
        is_other = np.zeros(self.time_ns.size, np.bool_)
        is_other[others] = True
        return slot[~is_other[slot]]

    def spare(self, n: int) -> IntArray:
        """(n,) free slots, for temporary beliefs until a track takes them."""
        if n > len(self._free):
            self._grow(max(self.time_ns.size, n))
        return np.array(self._free[len(self._free) - n :], dtype=np.int64)

    def see(self, labels: Sequence[str], time_ns: int) -> None:
        """Learn from a frame how often the sensor looks: at each vehicle it labels, at all others together, at any."""
        intervals = self._intervals
        intervals.see(labels, time_ns)
        slot = self.slots_of(labels)
        self.interval[slot[slot >= 0]] = intervals.of(labels)[slot >= 0]
        self.interval[self.unlabelled, 0] = intervals.of_others.usual_ns[0]
        self._least_gap_ns = max(self._max_gap_ns, GAP_INTERVALS * intervals.of_frames.usual_ns[0])
        self.longest_gap_ns = int(max(self._least_gap_ns, GAP_INTERVALS * self.interval[:, 0].max(initial=0.0)))

    def hit(self, slot: IntArray, time_ns: int) -> None:
        """Tracks (v,) were measured."""
        since_ns = (time_ns - self.measured_ns[slot])[~self.is_labelled[slot]]
        if since_ns.size:
            self._intervals.of_others.add(int(np.median(since_ns)))
        self.measured_ns[slot] = time_ns

    def forget(self, *, now_ns: int) -> None:
        """End tracks not measured for too long, and those that hardly exist."""
        config, slot = self._config, self.slots
        first = existence.at_birth(np.array([config.birth_density]), config)[0, existence.VISIBLE]
        last_ns = self.measured_ns + np.maximum(self._least_gap_ns, GAP_INTERVALS * self.interval[:, 0])
        ended = (self.probability < config.forget_below * first) | (last_ns < now_ns)
        if ended[slot].any():
            self._free += [self._slot.pop(self._name.pop(place)) for place in slot[ended[slot]].tolist()]
            self._slots = None

    def age(self, slot: IntArray, held: IntArray, time_ns: int) -> None:
        """Let existence (v,) come to a time, by where the beliefs in the slots `held` (v,) are then."""
        dt_s = np.asarray((time_ns - self.existence_ns[slot]) * 1e-9, np.float64)
        pace = 1.0 / np.maximum(self.interval[slot, 0] / SLOW_NS, 1.0)
        passed = self.ends[slot]
        if self._on_map is not None:
            self.outside[slot], _, self.ends[slot] = self._on_map.places(held)
            passed = 0.5 * (passed + self.ends[slot])  # on the way
        self.existence[slot] = existence.later(self.existence[slot], dt_s, self._config, ends=passed, pace=pace)
        self.existence_ns[slot] = time_ns

    def missed(self, hit: IntArray, time_ns: int) -> IntArray:
        """Slots of the tracks that a frame ought to have shown and did not; those it did are `hit`.

        One is due some time after its last hit or miss; not while its sensor's interval is unknown.
        """
        slot = self.without(self.slots, hit)
        slot = slot[(self.measured_ns[slot] < time_ns) & (self.interval[slot, 0] > 0)]
        due_ns = DUE_FROM * self.interval[slot, 0] + JITTERS * self.interval[slot, 1]
        return np.asarray(slot[time_ns - self.counted_ns[slot] >= due_ns])

    def learn(self, hit: IntArray, by_chance: FloatArray, missed: IntArray) -> None:
        """Update existence by a frame's hits, others expected so densely there, (h,) as `after_hit`, and misses.

        Unlabelled tracks that are confirmed by it are numbered.
        """
        config = self._config
        self.existence[hit] = existence.after_hit(self.existence[hit], self.log_evidence[hit], by_chance, config)
        self.existence[missed] = existence.after_miss(self.existence[missed], config)
        self.is_confirmed |= self.probability >= config.confirm_above
        for name in [name for name in self._slot if name.startswith(TENTATIVE)]:
            if self.is_confirmed[self._slot[name]]:
                self.number(name)

    def _grow(self, n_more: int) -> None:
        for name, empty in _EMPTY.items():
            more = np.full((n_more, *np.shape(empty)), empty)
            setattr(self, name, np.concatenate([getattr(self, name, more[:0]), more]))
        size = self.time_ns.size
        self._free = [*range(size - 1, size - n_more - 1, -1), *self._free]
        self._filter.reserve(size)
