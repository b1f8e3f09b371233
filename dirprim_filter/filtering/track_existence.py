"""Which tracks are of vehicles that are there: the probabilities of a roster, by time, hits and misses."""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.config import TrackingConfig
from dirprim_filter.filtering import existence
from dirprim_filter.filtering.protocols import BayesFilter
from dirprim_filter.filtering.roster import Roster
from dirprim_filter.filtering.scans import RevisitTime
from dirprim_filter.sight import Sight


class TrackExistence:
    """Keeps the roster's probabilities of existence.

    Args:
        roster: the tracks.
        bayes_filter: their beliefs.
        tracking: rates, and when a track is confirmed.
        sight: where the sensor sees; None for everywhere.
    """

    def __init__(
        self, roster: Roster, bayes_filter: BayesFilter, tracking: TrackingConfig, sight: Sight | None
    ) -> None:
        self._roster, self._filter, self._tracking, self._sight = roster, bayes_filter, tracking, sight
        self._revisits = {is_labelled: RevisitTime() for is_labelled in (True, False)}

    def age(self, slot: IntArray, held: IntArray, time_ns: int) -> None:
        """Let existence (v,) come to a time, by where the beliefs in the slots `held` (v,) are then."""
        roster = self._roster
        dt_s = np.asarray((time_ns - roster.existence_ns[slot]) * 1e-9, np.float64)
        ends = self._filter.rate_of_ends(held)
        passed = 0.5 * (roster.ends[slot] + ends)  # on the way
        roster.existence[slot] = existence.later(roster.existence[slot], dt_s, self._tracking, ends=passed)
        roster.ends[slot] = ends
        roster.outside[slot] = self._filter.probability_outside(held)
        if self._sight is not None:
            m = self._filter.moments(held)
            roster.in_sight[slot] = self._sight.probability(m[:, :2], m[:, [2, 3, 3, 4]].reshape(-1, 2, 2))
        roster.existence_ns[slot] = time_ns

    def missed(self, hit: IntArray, time_ns: int, *, is_labelled: bool) -> IntArray:
        """Slots of the tracks of a kind that the frame ought to have shown and did not; those it did are `hit`."""
        roster = self._roster
        usual = self._revisits[is_labelled]
        usual.see(time_ns - roster.measured_ns[hit[roster.is_labelled[hit] == is_labelled]])
        _, slot = roster.members(is_labelled=is_labelled)
        slot = slot[~np.isin(slot, hit)]
        return slot[usual.is_due(time_ns - roster.counted_ns[slot]) & (roster.measured_ns[slot] < time_ns)]

    def learn(self, hit: IntArray, first: FloatArray, missed: IntArray) -> None:
        """Update existence by a frame's hits, where first detections were expected so densely, (h,), and its misses."""
        roster, tracking = self._roster, self._tracking
        roster.existence[hit] = existence.after_hit(roster.existence[hit], roster.log_evidence[hit], first, tracking)
        roster.existence[missed] = existence.after_miss(roster.existence[missed], tracking, roster.in_sight[missed])
        roster.confirm(above=tracking.confirm_above)
