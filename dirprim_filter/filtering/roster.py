"""Who is being tracked: each track's slot in the filter, what is known beside its belief, and when it is due.

A frame without a vehicle is a miss only if its turn had come. Where one frame holds all vehicles, every frame without
one is a miss of it. Where each vehicle reports itself, in messages with times of their own, the frames of others say
nothing of it. And a sensor that looks at a vehicle each ten seconds needs beliefs that last longer than that.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import NO_ID
from dirprim_filter.filtering import existence
from dirprim_filter.filtering.particle_filter import ParticleFilter
from dirprim_filter.filtering.protocols import BayesFilter
from dirprim_filter.primitives.cues import Cue

FIRST_CAPACITY = 8
GAP_INTERVALS = 3.0
"""Of the usual intervals between detections of a vehicle so many may pass without one before its belief ends."""
SLOW_NS, USUAL_GAP_S = 1e9, FilterConfig().max_gap_s
"""A sensor that looks at a vehicle less often is for vehicles that stay longer: existence changes slower. So do those
with an id whose beliefs shall last for longer than usual: else few would be reported until then."""
AGAIN = 3
"""How often in a row a vehicle is lost until its way says more than the map: one wrong measurement loses it there and
back."""
STEPS = 20
"""Of the motion in a usual interval, as many as its shortest allow, are enough."""
TENTATIVE = "\0"
"""Prefix of the names of tentative unlabelled tracks: no sensor's id begins with it."""
REMEMBERED = 9
DUE_FROM, JITTERS = 0.75, 2.0
"""Share of the usual time after which the next detection is due, as sensors are not exact; and how many deviations of
these times later."""
MOST_NS = 1_800_000_000_000
"""What passes for longer is a pause of the log or a vehicle that comes back, and no interval of a sensor."""
MOST_FORMER = 1000
"""Of so many labelled tracks that ended the intervals are kept."""
NO_GAPS: FloatArray = np.full(REMEMBERED, np.nan)
_EMPTY: dict[str, Any] = {
    "time_ns": np.int64(0), "existence_ns": np.int64(0), "measured_ns": np.int64(0), "counted_ns": np.int64(0),
    "seen_ns": np.int64(0), "name": None, "is_labelled": np.False_, "is_confirmed": np.False_, "existence": np.zeros(3),
    "outside": 0.0, "ends": 0.0, "n_unexplained": np.int64(0), "log_evidence": 0.0, "innovation": np.nan,
    "n_lost": np.int64(0), "expected": np.full(2, np.nan), "place": np.full(2, np.nan),
    "cue": np.full(2, np.nan), "cue_ns": np.int64(0), "gaps": NO_GAPS, "interval": np.full(2, np.nan),
    "size": np.full(3, np.nan), "stride": np.int64(1),
}  # fmt: skip
"""The columns, and what a track has in each before it begins."""


def remembered(gaps: FloatArray, gap_ns: AnyArray) -> FloatArray:
    """(n, 9), (n,) -> (n, 9) the last times between two detections, NaN for none, after one more; a pause is none."""
    is_gap = (gap_ns > 0) & (gap_ns <= MOST_NS)
    return np.where(is_gap[:, None], np.column_stack([gaps[:, 1:], gap_ns]).astype(np.float64), gaps)


def usual(gaps: FloatArray) -> FloatArray:
    """(n, 9) -> (n, 2) their lower median, and that of how far off it they are; NaN where there are none."""
    row, middle = np.arange(len(gaps)), np.maximum((~np.isnan(gaps)).sum(axis=1) - 1, 0) // 2
    median = np.sort(gaps, axis=1)[row, middle]
    return np.column_stack([median, np.sort(np.abs(gaps - median[:, None]), axis=1)[row, middle]])


class Roster:
    """Slots are given to tracks as they come and taken back when they go; when all are taken, their number doubles.

    As many slots again are for copies of the beliefs, at other times than their own.

    Args:
        bayes_filter: holds their beliefs.
        config: rates, and when a track is confirmed.
        moves: the shortest step of motion, and seconds without a measurement after which a track ends, where its
            sensor's intervals are not longer.

    Attributes:
        longest_gap_ns: nanoseconds without a measurement after which every track ends.
        tally: of the hits and misses so far.
    """

    time_ns: IntArray  # (slots,) the time each belief holds for
    existence_ns: IntArray  # (slots,) the time its existence holds for
    measured_ns: IntArray  # (slots,) the time of its last measurement
    counted_ns: IntArray  # (slots,) the time of the last frame that counted as a hit or a miss of it
    seen_ns: IntArray  # (slots,) the time of the last frame that had its label
    name: AnyArray  # (slots,) its sensor's id, its number, or while it is tentative what no id is
    is_labelled: BoolArray  # (slots,) whether its sensor gives it an id
    is_confirmed: BoolArray  # (slots,) whether it was ever confirmed
    existence: FloatArray  # (slots, 3) see `existence`
    outside: FloatArray  # (slots,) probability that it is outside of the map's cells
    ends: FloatArray  # (slots,) 1/s, rate at which trajectories end where it was at `existence_ns`
    n_unexplained: IntArray  # (slots,) consecutive measurements that its belief did not explain
    n_lost: IntArray  # (slots,) how often it was reinitialised since one was explained
    log_evidence: FloatArray  # (slots,) of its last measurement, 0 of its first
    innovation: FloatArray  # (slots,) of its last measurement, NaN of its first
    expected: FloatArray  # (slots, 2) metres, where that was expected
    place: FloatArray  # (slots, 2) metres, where it was measured
    cue: FloatArray  # (slots, 2) the last that its vehicle gave, as in `Detections`; NaN for none
    cue_ns: IntArray  # (slots,) the time of the last measurement that gave it
    gaps: FloatArray  # (slots, 9) ns, last times between two frames that had its label; NaN for none
    size: FloatArray  # (slots, 3) m, of its last detection with one, as in `Detections`
    stride: IntArray  # (slots,) how many of the motion's shortest steps a belief takes at once until it is measured
    interval: FloatArray  # (slots, 2) ns, usual time between two of its detections, and jitter; NaN while unknown

    def __init__(self, bayes_filter: BayesFilter, config: TrackingConfig, *, moves: FilterConfig) -> None:
        self._filter, self._config = bayes_filter, config
        self._on_map = bayes_filter if isinstance(bayes_filter, ParticleFilter) else None
        self._step_s, longest_s = moves.step_s, moves.step_s if self._on_map is None else self._on_map.longest_step_s
        self._longest_stride = int(longest_s / self._step_s + 1e-9)
        self._slot: dict[str, int] = {}
        self._n_tentative = self._n_numbered = 0
        self._former: dict[str, tuple[int, FloatArray]] = {}  # of labelled tracks that ended, `seen_ns` and `gaps`
        self._shared = np.array([NO_GAPS, NO_GAPS])  # gaps of frames, and of hits of unlabelled tracks
        self._max_gap_ns = self._least_gap_ns = moves.max_gap_s * 1e9
        self.longest_gap_ns = int(self._max_gap_ns)
        first = config.birth_density / (config.birth_density + config.clutter_density)  # existence of a first detection
        self._forget_below = config.forget_below * first
        self.tally = existence.Tally()
        self._n_slots = 0
        self._grow(FIRST_CAPACITY)

    def __len__(self) -> int:
        return len(self._slot)

    @property
    def slots(self) -> IntArray:
        """(v,) of all tracks, in the order they came."""
        return np.fromiter(self._slot.values(), np.int64, len(self._slot))

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

    def see(self, labels: Sequence[str], time_ns: int, *, passed_ns: int | None) -> IntArray:
        """(d,) the tracks of a frame's labels, -1 of one that has none. Those that its sensor has lost end.

        Args:
            labels: (d,) of the frame.
            time_ns: its time.
            passed_ns: nanoseconds since the frame before, from which intervals are learned; None where it is no frame.
        """
        found = np.array([self._slot.get(label, -1) for label in labels], dtype=np.int64)
        found[~self.is_labelled[found]] = -1  # such a name is one of ours
        slot = found[found >= 0]
        if passed_ns is not None:
            self._shared[:1] = remembered(self._shared[:1], np.array([passed_ns], np.float64))
            self.gaps[slot] = remembered(self.gaps[slot], time_ns - self.seen_ns[slot])
            self.seen_ns[slot] = time_ns
            interval = usual(np.vstack([self._shared, self.gaps[slot]]))
            self.interval[slot], self.interval[self.unlabelled] = interval[2:], [interval[1, 0], 0.0]
            self._least_gap_ns = float(np.fmax(self._max_gap_ns, GAP_INTERVALS * interval[0, 0]))
            self.longest_gap_ns = int(np.fmax.reduce(GAP_INTERVALS * self.interval[:, 0], initial=self._least_gap_ns))
        ended = self._end(time_ns)
        found[ended[found]] = -1
        return found

    def enter(self, names: Sequence[str], *, time_ns: int, exists: FloatArray) -> IntArray:
        """(v,) slots for tracks that have none yet; they begin with a detection at `time_ns`, and `exists` (v, 3)."""
        if len(self._slot) + len(names) > self._n_slots:
            self._grow(max(self._n_slots, len(names)))
        slot = np.setdiff1d(np.arange(self._n_slots), self.slots)[: len(names)]
        for name, empty in _EMPTY.items():
            getattr(self, name)[slot] = empty
        for column in (self.time_ns, self.existence_ns, self.measured_ns, self.counted_ns, self.seen_ns):
            column[slot] = time_ns
        self.existence[slot] = exists
        for one, name in zip(slot.tolist(), names, strict=True):
            if name in self._slot:  # one of ours: the sensor's come before them
                self._number(self._slot[name])
            self.is_labelled[one] = name != NO_ID
            if name in self._former:
                seen_ns, gaps = self._former.pop(name)
                self.gaps[one] = remembered(gaps[None], np.array([time_ns - seen_ns]))
                self.interval[one] = usual(self.gaps[one][None])
            self._name(one, name or f"{TENTATIVE}{self._n_tentative}")
            self._n_tentative += name == NO_ID
        return slot

    def by_cue(self, slot: IntArray, counts: BoolArray) -> Iterator[tuple[Cue | None, IntArray]]:
        """Rows of slots (v,) for each cue that their vehicles give, as far as it counts (v,), and of the others."""
        cue = self.cue[slot]
        counts = counts & ~np.isnan(cue[:, 0])
        yield None, np.flatnonzero(~counts)
        given = np.flatnonzero(counts)
        kinds, kind = np.unique(cue[given], axis=0, return_inverse=True) if given.size else ((), given)
        for i, (turn, concentration) in enumerate(kinds):
            yield Cue(turn=turn, concentration=concentration), given[kind == i]

    def aside(self, slot: IntArray) -> IntArray:
        """(v,) slots of copies of these, which last until the next frame; a copy stays where it is."""
        copy = np.where(slot < self._n_slots, slot + self._n_slots, slot)
        own = slot < self._n_slots
        self._filter.copy(slot[own], copy[own])
        for name in _EMPTY:
            getattr(self, name)[copy] = getattr(self, name)[slot]
        return copy

    def age(self, slot: IntArray, held: IntArray, time_ns: int) -> None:
        """Let existence (v,) come to a time, by where the beliefs in the slots `held` (v,) are then."""
        if slot.size == 0:
            return
        dt_s = np.asarray((time_ns - self.existence_ns[slot]) * 1e-9, np.float64)
        pace = 1.0 / np.fmax(self.interval[slot, 0] / SLOW_NS, 1.0)
        slower = np.where(self.is_labelled[slot], USUAL_GAP_S * 1e9 / self._max_gap_ns, 1.0)
        departs = np.minimum(pace, slower) * self._config.departure_rate
        if self._on_map is not None:
            passed, (self.outside[slot], _, self.ends[slot]) = self.ends[slot], self._on_map.places(held)
            departs = departs + 0.5 * (passed + self.ends[slot])  # on the way
        self.existence[slot] = existence.later(self.existence[slot], dt_s, self._config, departs=departs, pace=pace)
        self.existence_ns[slot] = time_ns

    def learn(
        self, hit: IntArray, log_density: FloatArray, is_explained: BoolArray, by_chance: FloatArray, time_ns: int, *,
        is_scan: bool,
    ) -> None:  # fmt: skip
        """Update existence by a frame's hits and misses. Unlabelled tracks that are confirmed by it are numbered.

        A track is missed that was due: some time after its last hit or miss; none while its sensor's interval is
        unknown. A measurement that a belief does not explain is a miss: it came from somewhere else.

        Args:
            hit: (h,) tracks that were measured.
            log_density: (h,) of the measurement under the belief.
            is_explained: (h,) whether the belief explains it.
            by_chance: (h,) density of others expected there, as `existence.after_hit`.
            time_ns: of the frame.
            is_scan: the sensor looked.
        """
        since_ns = (time_ns - self.measured_ns[hit])[~self.is_labelled[hit]]
        if since_ns.size:
            self._shared[1:] = remembered(self._shared[1:], np.trunc([np.median(since_ns)]))
        self.measured_ns[hit] = time_ns
        sparse = np.fmax(self.interval[hit, 0] * 1e-9 / (STEPS * self._step_s), 1.0)
        self.stride[hit] = np.minimum(sparse, self._longest_stride)
        due_ns = DUE_FROM * self.interval[:, 0] + JITTERS * self.interval[:, 1]
        is_missed = is_scan & (self.measured_ns < time_ns) & (time_ns - self.counted_ns >= due_ns)
        is_missed[hit] = ~is_explained
        seen, missed = hit[is_explained], self.slots[is_missed[self.slots]]
        self.n_lost[seen] = 0
        counted, is_hit = np.append(seen, missed), np.arange(seen.size + missed.size) < seen.size
        before = self.existence[counted]
        self.existence[seen] = existence.after_hit(
            self.existence[seen], log_density[is_explained], by_chance[is_explained], self._config
        )
        self.existence[missed] = existence.after_miss(self.existence[missed], self._config)
        self.tally.add(before, self.existence[counted], is_hit, self._config)
        self.counted_ns[counted] = time_ns
        sure, slot = self.probability >= self._config.confirm_above, self.unlabelled
        for one in slot[sure[slot] & ~self.is_confirmed[slot]].tolist():
            self._number(one)
        self.is_confirmed |= sure

    def lose(self, slot: IntArray) -> BoolArray:
        """Beliefs (v,) are to be reinitialised: whether by now their vehicles' ways say more than the map."""
        self.n_unexplained[slot], self.cue[slot] = 0, np.nan
        self.n_lost[slot] += 1
        return np.asarray(self.n_lost[slot] >= AGAIN)

    def _end(self, now_ns: int) -> BoolArray:
        """End tracks not measured for too long, and those that hardly exist. (slots,) which."""
        last_ns = self.measured_ns + np.fmax(self._least_gap_ns, GAP_INTERVALS * self.interval[:, 0])
        ended = (self.probability < self._forget_below) | (last_ns < now_ns)
        slot = self.slots
        for one in slot[ended[slot]].tolist():
            del self._slot[self.name[one]]
            if self.is_labelled[one]:
                self._former[self.name[one]] = int(self.seen_ns[one]), self.gaps[one].copy()
        while len(self._former) > MOST_FORMER:
            del self._former[next(iter(self._former))]
        return np.asarray(ended)

    def _number(self, slot: int) -> None:
        """Call a track by the next number that no sensor uses as an id."""
        del self._slot[self.name[slot]]
        self._n_numbered += 1
        while (name := f"track-{self._n_numbered}") in self._slot:
            self._n_numbered += 1
        self._name(slot, name)

    def _name(self, slot: int, name: str) -> None:
        self.name[slot], self._slot[name] = name, slot

    def _grow(self, n_more: int) -> None:
        n, self._n_slots = self._n_slots, self._n_slots + n_more
        for name, empty in _EMPTY.items():
            column = np.full((2 * self._n_slots, *np.shape(empty)), empty)
            column[:n] = getattr(self, name, column)[:n]
            setattr(self, name, column)
        self._filter.reserve(2 * self._n_slots)
