"""The truth at the instants that are judged: as its rows hold it, and between them.

Vehicles are often not measured at the same instants: each has a clock of its own (GNSS receivers, tags on people), or
the truth's clock is not the tracker's. An estimate is compared with where its vehicle was at that very instant.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray, IntArray
from dirprim_filter.distributions.angles import difference, wrap
from dirprim_filter.evaluation.tracked_rows import TrackedRows, instant_numbers
from dirprim_filter.tracks import Tracks

LEAST_GAP_S = 1.0
INTERVALS = 2.5
"""So many median intervals: one lost row of a slow truth is bridged, two are not."""


class JudgedTruth(NamedTuple):
    """The truth at the instants that are judged.

    Attributes:
        tracks: (m,) its rows there, and those interpolated, which know no size and no heading.
        before: (m,) the row of the given truth that each was made of,
        after: and the other one; the same where it is the row itself.
        at_results: whether the instants are those of the results, else the truth's own.
        longest_gap_s: seconds between two rows of a vehicle, above which nothing is interpolated.
    """

    tracks: Tracks
    before: IntArray
    after: IntArray
    at_results: bool
    longest_gap_s: float

    @property
    def n_interpolated(self) -> int:
        """How many rows the given truth did not have."""
        return int((self.before != self.after).sum())

    def both(self, mark: BoolArray) -> BoolArray:
        """(m,) a mark of the given rows (n,): an interpolated row has it where both its neighbours have."""
        return mark[self.before] & mark[self.after]


def judged_truth(truth: Tracks, results: Sequence[TrackedRows] = ()) -> JudgedTruth:
    """The truth as the results are judged by it.

    Where a vehicle has no row at an instant, but one before and one after it that are at most `longest_gap_s` apart,
    its position, direction (the shorter way round) and speed are interpolated linearly; never extrapolated.
    `longest_gap_s` is the larger of 1 s and 2.5 times the median interval between a vehicle's rows.

    The truth's own instants are judged, at which a missing estimate is a miss, unless a result has rows at others at
    which some vehicle is known so. Then the instants of all results together are judged. A truth in frames, of which
    every vehicle has a row at every instant, and results at these instants: that is judged as it is, row by row.

    Args:
        truth: where vehicles were; each group is a world.
        results: what is to be judged, all together; none: whatever has rows at the truth's own instants.
    """
    numbers = instant_numbers(truth, *results)
    own, number = numbers[0], np.concatenate(numbers)
    n_instants = 1 + int(number.max(initial=-1))
    time_ns = np.empty(n_instants, np.int64)
    time_ns[number] = np.concatenate([truth.time_ns, *(rows.time_ns for rows in results)])
    is_own, is_asked = np.zeros((2, n_instants), np.bool_)
    is_own[own] = True
    is_asked[number[len(truth) :]] = True

    before, after, longest_gap_s = _steps(truth)
    start, end = own[before], own[after]
    begun, ended = (np.bincount(at, minlength=n_instants + 1) for at in (start + 1, end))
    is_known = is_own | (np.cumsum(begun - ended)[:-1] > 0)
    at_results = bool((is_asked & is_known & ~is_own).any())
    judged = is_asked if at_results else is_own

    n_until = np.cumsum(judged)
    n_between: IntArray = n_until[end - 1] - n_until[start]
    first: IntArray = n_until[start] - (np.cumsum(n_between) - n_between)
    between = np.flatnonzero(judged)[np.repeat(first, n_between) + np.arange(n_between.sum())]
    kept = np.flatnonzero(judged[own])
    when = np.concatenate([truth.time_ns[kept], time_ns[between]])
    order = np.argsort(when, kind="stable")
    before, after = (np.concatenate([kept, np.repeat(rows, n_between)])[order] for rows in (before, after))
    is_all = between.size == 0 and kept.size == len(truth)
    tracks = truth if is_all else _interpolated(truth, before, after, when[order])
    return JudgedTruth(tracks, before, after, at_results, longest_gap_s)


def _steps(truth: Tracks) -> tuple[IntArray, IntArray, float]:
    """Rows of a vehicle and the next ones, near enough to interpolate between, and how near that is in seconds."""
    vehicle = truth.vehicle
    order = np.lexsort((truth.time_ns, vehicle))
    goes_on = vehicle[order[1:]] == vehicle[order[:-1]]
    before, after = order[:-1][goes_on], order[1:][goes_on]
    interval_s = (truth.time_ns[after] - truth.time_ns[before]) * 1e-9
    longest_s = max(LEAST_GAP_S, INTERVALS * float(np.median(interval_s))) if interval_s.size else LEAST_GAP_S
    is_near = interval_s <= longest_s
    return before[is_near], after[is_near], longest_s


def _interpolated(truth: Tracks, before: IntArray, after: IntArray, time_ns: IntArray) -> Tracks:
    """Rows at times (m,) between rows of the truth, or at them."""
    step_ns = truth.time_ns[after] - truth.time_ns[before]
    share = (time_ns - truth.time_ns[before]) / np.maximum(step_ns, 1)
    turn = difference(truth.direction[after], truth.direction[before])
    return Tracks(
        track_id=truth.track_id[before], time_ns=time_ns, group=truth.group[before],
        position=truth.position[before] + share[:, None] * (truth.position[after] - truth.position[before]),
        direction=wrap(truth.direction[before] + share * turn),
        speed=truth.speed[before] + share * (truth.speed[after] - truth.speed[before]),
    )  # fmt: skip
