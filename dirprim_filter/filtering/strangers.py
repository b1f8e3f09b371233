"""Vehicles that no sensor names: which detection is whose, who is new, and who is gone.

Two detections of frames that follow each other, near enough for one vehicle, begin a belief; whether it is a vehicle
then shows in how well it foresees the next ones.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import NO_TIME, Detections
from dirprim_filter.filtering import existence
from dirprim_filter.filtering.association import best_assignment, gated, within
from dirprim_filter.filtering.belief import birth_key
from dirprim_filter.filtering.existence import GONE, VISIBLE
from dirprim_filter.filtering.measurements import measured_covariance
from dirprim_filter.filtering.protocols import BayesFilter
from dirprim_filter.filtering.roster import Roster
from tessellation.arrays import FloatArray, IntArray

FRAMES_REMEMBERED = 2
"""How long a detection that is nobody's waits for a second one: a vehicle may be missed once in between."""
LONGEST_WAIT_S = 2.0


class Measured(NamedTuple):
    """Slots (v,) of vehicles, and the rows (v,) of the frame that are theirs."""

    slot: IntArray
    row: IntArray


class Strangers:
    """The tracks without a name of their sensor's.

    Args:
        bayes_filter: holds their beliefs.
        roster: gives them slots.
        filter_config: the noise of measurements that tell none.
        config: the knobs.
        seed: what all random numbers follow from, together with a track's number.
    """

    def __init__(
        self, bayes_filter: BayesFilter, roster: Roster, *, filter_config: FilterConfig, config: TrackingConfig,
        seed: int,
    ) -> None:  # fmt: skip
        self._filter = bayes_filter
        self._roster = roster
        self._filter_config, self._config = filter_config, config
        self._seed = seed
        self._n_begun = 0
        self._waiting = Detections.none()  # what nobody claimed
        self._frames_ns = [NO_TIME] * FRAMES_REMEMBERED
        self._time_ns = NO_TIME

    def predict(self, detections: Detections, rows: IntArray, *, time_ns: int) -> Measured:
        """Move all tracks to the frame's time, give them its detections, and begin new ones.

        Args:
            detections: the frame.
            rows: (d,) those of its rows that bear no id. A frame of named rows alone says nothing of strangers.
            time_ns: the frame's time.
        """
        if rows.size == 0 and len(detections):
            return Measured(rows, rows)
        seen = detections[rows]
        _, slot = self._roster.members(is_named=False)
        if slot.size:
            dt_s = np.asarray((time_ns - self._roster.time_ns[slot]) * 1e-9, dtype=np.float64)
            self._filter.predict(slot, dt_s)
            self._roster.time_ns[slot] = time_ns
            self._roster.existence[slot] = existence.later(self._roster.existence[slot], float(dt_s[0]), self._config)
            self._roster.log_evidence[slot] = 0.0
        self._time_ns = time_ns
        found = self._claim(slot, seen)
        begun = self._begin(seen, np.setdiff1d(np.arange(len(seen)), found.row))
        missed = np.setdiff1d(slot, found.slot)
        if missed.size:
            self._roster.existence[missed] = existence.after_miss(self._roster.existence[missed], self._config)
        return Measured(
            np.concatenate([found.slot, begun.slot]), rows[np.concatenate([found.row, begun.row]).astype(np.int64)]
        )

    def judge(self, slot: IntArray, log_density: FloatArray) -> None:
        """Learn from how well beliefs foresaw their detections whether they are of vehicles. (v,), (v,)."""
        roster, config = self._roster, self._config
        roster.existence[slot] = existence.after_hit(roster.existence[slot], log_density, config)
        roster.is_confirmed[slot] |= 1.0 - roster.existence[slot, GONE] >= config.confirm_above

    def told_of(self, time_ns: int) -> tuple[list[str], IntArray]:
        """Names and slots (v,) of the tracks that are vehicles, as far as is known; only in frames of strangers."""
        names, slot = self._roster.members(is_named=False)
        if slot.size == 0 or time_ns != self._time_ns:
            return [], slot[:0]
        told = self._roster.is_confirmed[slot]
        told &= 1.0 - self._roster.existence[slot, GONE] >= self._config.report_above
        return [name for name, is_told in zip(names, told, strict=True) if is_told], slot[told]

    def _claim(self, slot: IntArray, seen: Detections) -> Measured:
        """The detections of the tracks there are: rows of `seen`."""
        if slot.size == 0:
            return Measured(slot, slot)
        config = self._config
        m = self._filter.moments(slot)
        noise = measured_covariance(seen, self._filter_config)
        pairs = gated(m[:, :2], m[:, [2, 3, 3, 4]].reshape(-1, 2, 2), seen.position, noise, gate=config.gate)
        fit = self._filter.log_likelihood(slot[pairs.one], seen[pairs.other])
        expected = config.detection_probability * self._roster.existence[slot[pairs.one], VISIBLE]
        by_chance = np.log(config.clutter_density + config.birth_density)
        best = best_assignment(pairs, np.log(expected) - np.log1p(-expected) + fit - by_chance)
        return Measured(slot[best.one], best.other)

    def _begin(self, seen: Detections, unclaimed: IntArray) -> Measured:
        """Tracks of detections that waited and of others that follow them; the rows of `seen` are to be weighed."""
        waiting = self._waiting
        dt_s = np.asarray((self._time_ns - waiting.time_ns) * 1e-9, dtype=np.float64)
        width = np.sqrt(np.linalg.eigvalsh(measured_covariance(waiting, self._filter_config))[:, -1])
        reach = self._config.max_speed * dt_s + np.sqrt(2.0 * self._config.gate) * width
        pairs = within(waiting.position, seen.position[unclaimed], reach=reach)
        distance = np.linalg.norm(waiting.position[pairs.one] - seen.position[unclaimed[pairs.other]], axis=1)
        best = best_assignment(pairs, 1.0 - distance / (reach[pairs.one] * (1.0 + 1e-9)))
        first = waiting[best.one]
        names = [self._new_name() for _ in best.one]
        slot = self._roster.enter(names, is_named=False, time_ns=first.time_ns)
        key = [birth_key(self._seed, name, int(t)) for name, t in zip(names, first.time_ns, strict=True)]
        self._filter.begin(slot, np.array(key, dtype=np.uint64), first)
        self._filter.predict(slot, dt_s[best.one])
        self._roster.time_ns[slot] = self._time_ns
        self._roster.existence[slot] = existence.at_birth(slot.size, self._config)
        self._wait(np.delete(np.arange(len(waiting)), best.one), seen[np.delete(unclaimed, best.other)])
        return Measured(slot, unclaimed[best.other])

    def _wait(self, still: IntArray, left: Detections) -> None:
        """Remember what nobody claimed in this frame, and what `still` waits of the one before."""
        self._frames_ns = [*self._frames_ns[1:], self._time_ns]
        oldest_ns = max(self._frames_ns[0], self._time_ns - int(LONGEST_WAIT_S * 1e9))
        waited = self._waiting[still]
        self._waiting = Detections.concatenate([waited[waited.time_ns >= oldest_ns], left])

    def _new_name(self) -> str:
        self._n_begun += 1
        while (name := f"track-{self._n_begun}") in self._roster:
            self._n_begun += 1
        return name
