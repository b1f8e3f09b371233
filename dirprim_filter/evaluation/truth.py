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
        truth: where vehicles were; each group is a scene of its own.
        results: what is to be judged, all together; none: whatever has rows at the truth's own instants.
    """
    numbers = instant_numbers(truth, *results)
    number, own = np.concatenate(numbers), numbers[0]
    n_instants = 1 + int(number.max(initial=-1))
    time_ns, group = np.empty((2, n_instants), np.int64)
    time_ns[number] = np.concatenate([truth.time_ns, *(rows.time_ns for rows in results)])
    group[number] = np.concatenate([truth.group, *(rows.group for rows in results)])
    asked = np.unique(number[len(truth) :])
    longest_gap_s = _longest_gap_s(truth)
    found = known_at(truth, group[asked], time_ns[asked], longest_gap_s=longest_gap_s)
    at_results = not np.isin(asked[found.instant], own).all()
    if not at_results:
        asked = np.unique(own)
        found = known_at(truth, group[asked], time_ns[asked], longest_gap_s=longest_gap_s)
    when = time_ns[asked[found.instant]]
    order = np.lexsort((found.before, found.before != found.after, when))
    _, before, after = (column[order] for column in found)
    is_all = before.size == len(truth) and not (before != after).any()
    tracks = truth if is_all else interpolated(truth, before, after, when[order])
    return JudgedTruth(tracks, before, after, at_results, longest_gap_s)


class Known(NamedTuple):
    """Where vehicles are known. (m,) vehicles at instants.

    Attributes:
        instant: index of the instant.
        before: the row of the truth before it,
        after: and the one after it; the same where it is the row's own.
    """

    instant: IntArray
    before: IntArray
    after: IntArray


def known_at(truth: Tracks, group: IntArray, time_ns: IntArray, *, longest_gap_s: float) -> Known:
    """Each vehicle at each instant of its group that is a row's own, or between two rows near enough.

    Args:
        truth: where vehicles were.
        group: (n,) of the instants,
        time_ns: (n,) and their times.
        longest_gap_s: seconds between two rows of a vehicle that are near enough.
    """
    sorted_rows, sorted_instants = np.lexsort((truth.time_ns, truth.vehicle)), np.argsort(time_ns, kind="stable")
    nothing = np.empty(0, np.int64)
    parts = [Known(nothing, nothing, nothing)]
    for one in np.unique(group):
        row, asked = sorted_rows[truth.group[sorted_rows] == one], sorted_instants[group[sorted_instants] == one]
        time, times = truth.time_ns[row], time_ns[asked]
        begin, end = (np.searchsorted(times, time, side=side) for side in ("left", "right"))
        near = np.diff(truth.vehicle[row]) == 0
        near &= np.diff(time) <= longest_gap_s * 1e9
        step = np.flatnonzero(near)
        for first, last, before, after in (
            (begin, end, row, row), (end[:-1][step], begin[1:][step], row[:-1][step], row[1:][step]),
        ):  # fmt: skip
            n = np.maximum(last - first, 0)
            at = np.repeat(first - np.cumsum(n) + n, n) + np.arange(n.sum())
            parts.append(Known(asked[at], np.repeat(before, n), np.repeat(after, n)))
    return Known(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _longest_gap_s(truth: Tracks) -> float:
    vehicle = truth.vehicle
    order = np.lexsort((truth.time_ns, vehicle))
    step_ns = np.diff(truth.time_ns[order])[np.diff(vehicle[order]) == 0]
    return max(LEAST_GAP_S, INTERVALS * float(np.median(step_ns)) * 1e-9) if step_ns.size else LEAST_GAP_S


def interpolated(truth: Tracks, before: IntArray, after: IntArray, time_ns: IntArray) -> Tracks:
    """Rows at ascending times (m,) between rows of the truth, or at them; direction turns the shorter way round."""
    step_ns = truth.time_ns[after] - truth.time_ns[before]
    share = (time_ns - truth.time_ns[before]) / np.maximum(step_ns, 1)
    turn = difference(truth.direction[after], truth.direction[before])
    return Tracks(
        track_id=truth.track_id[before], time_ns=time_ns, group=truth.group[before],
        position=truth.position[before] + share[:, None] * (truth.position[after] - truth.position[before]),
        direction=wrap(truth.direction[before] + share * turn),
        speed=truth.speed[before] + share * (truth.speed[after] - truth.speed[before]),
        origin=truth.origin,
    )  # fmt: skip
