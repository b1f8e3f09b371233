"""Which tracks are of vehicles that are there: the probabilities of a roster, by time, hits and misses."""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.config import TrackingConfig
from dirprim_filter.filtering import existence
from dirprim_filter.filtering.protocols import BayesFilter, KnowsPlaces
from dirprim_filter.filtering.roster import Roster
from dirprim_filter.filtering.scans import is_due
from dirprim_filter.sight import Sight

SLOW_NS = 1e9
"""A sensor that looks at a vehicle less often is for vehicles that stay longer: existence changes slower."""


class TrackExistence:
    """Keeps the roster's probabilities of existence.

    Args:
        roster: the tracks.
        bayes_filter: their beliefs.
        places: the same if it is on a map.
        tracking: rates, and when a track is confirmed.
        sight: where the sensor sees; None for everywhere.
    """

    def __init__(
        self, roster: Roster, bayes_filter: BayesFilter, places: KnowsPlaces | None, tracking: TrackingConfig,
        sight: Sight | None,
    ) -> None:  # fmt: skip
        self._roster, self._filter, self._places = roster, bayes_filter, places
        self._tracking, self._sight = tracking, sight

    def age(self, slot: IntArray, held: IntArray, time_ns: int) -> None:
        """Let existence (v,) come to a time, by where the beliefs in the slots `held` (v,) are then."""
        roster = self._roster
        dt_s = np.asarray((time_ns - roster.existence_ns[slot]) * 1e-9, np.float64)
        pace = 1.0 / np.maximum(roster.interval[slot, 0] / SLOW_NS, 1.0)
        ends = np.zeros(held.size) if self._places is None else self._places.rate_of_ends(held)
        passed = 0.5 * (roster.ends[slot] + ends)  # on the way
        roster.existence[slot] = existence.later(roster.existence[slot], dt_s, self._tracking, ends=passed, pace=pace)
        roster.ends[slot] = ends
        roster.outside[slot] = 0.0 if self._places is None else self._places.probability_outside(held)
        if self._sight is not None:
            m = self._filter.moments(held)
            roster.in_sight[slot] = self._sight.probability(m[:, :2], m[:, [2, 3, 3, 4]].reshape(-1, 2, 2))
        roster.existence_ns[slot] = time_ns

    def missed(self, hit: IntArray, time_ns: int, *, is_labelled: bool) -> IntArray:
        """Slots of the tracks of a kind that the frame ought to have shown and did not; those it did are `hit`."""
        roster = self._roster
        _, slot = roster.members(is_labelled=is_labelled)
        slot = slot[~np.isin(slot, hit)]
        due = is_due(time_ns - roster.counted_ns[slot], roster.interval[slot])
        return slot[due & (roster.measured_ns[slot] < time_ns)]

    def learn(self, hit: IntArray, by_chance: FloatArray, missed: IntArray) -> None:
        """Update existence by a frame's hits, others expected so densely there, (h,) as `after_hit`, and misses."""
        roster, tracking = self._roster, self._tracking
        roster.existence[hit] = existence.after_hit(
            roster.existence[hit], roster.log_evidence[hit], by_chance, tracking
        )
        roster.existence[missed] = existence.after_miss(roster.existence[missed], tracking, roster.in_sight[missed])
        roster.confirm(above=tracking.confirm_above)
