"""The truth and a tracker's rows at the instants that are judged, the truth's own: as they are there, and between.

Vehicles are often not measured at the same instants: each has a clock of its own (GNSS receivers, tags on people), or
the tracker's clock or rate is not the truth's. Both are taken at the same instant, so that a tracker's figures depend
neither on its rate nor on the trackers beside it; where it is silent it has no estimate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray, IntArray
from dirprim_filter.distributions.angles import difference, wrap
from dirprim_filter.evaluation.tracked_rows import TrackedRows, instant_numbers
from dirprim_filter.track_ids import repeated_rows
from dirprim_filter.tracks import Tracks

LEAST_GAP_S = 1.0
INTERVALS = 2.5
"""So many median intervals: one lost row of a slow truth is bridged, two are not."""
OWN_INTERVALS = 1.5
"""The same of a tracker, which is silent where it left out a row."""
ROUNDING_NS, ROUNDING_SHARE = 1_000_000, 0.25
"""Times of a tracker, which may be rounded, are the truth's when so near; at most this share of its interval."""


class JudgedTruth(NamedTuple):
    """The truth at the instants that are judged.

    Attributes:
        tracks: (m,) its rows there, and those interpolated, which know no size and no heading.
        before: (m,) the row of the given truth that each was made of,
        after: and the other one; the same where it is the row itself.
        longest_gap_s: seconds between two rows of a vehicle, above which nothing is interpolated.
    """

    tracks: Tracks
    before: IntArray
    after: IntArray
    longest_gap_s: float

    @property
    def n_interpolated(self) -> int:
        """How many rows the given truth did not have."""
        return int((self.before != self.after).sum())

    def both(self, mark: BoolArray) -> BoolArray:
        """(m,) a mark of the given rows (n,): an interpolated row has it where both its neighbours have."""
        return mark[self.before] & mark[self.after]


def judged_truth(truth: Tracks) -> JudgedTruth:
    """The truth at its own instants, as whatever is judged is judged by it.

    Where a vehicle has no row at an instant, but one before and one after it that are at most `longest_gap_s` apart,
    its position, direction (the shorter way round) and speed are interpolated linearly; never extrapolated.
    `longest_gap_s` is the larger of 1 s and 2.5 times the median interval between a vehicle's rows. A truth in frames,
    of which every vehicle has a row at every instant, stays as it is.

    Args:
        truth: where vehicles were; each group is a scene of its own.
    """
    group, time_ns = _instants(truth)
    longest_gap_s = max(LEAST_GAP_S, INTERVALS * usual_interval_s(truth))
    found = known_at(truth, group, time_ns, longest_gap_s=longest_gap_s)
    when = time_ns[found.instant]
    order = np.lexsort((found.before, found.before != found.after, when))
    _, before, after = (column[order] for column in found)
    is_all = before.size == len(truth) and not (before != after).any()
    tracks = truth if is_all else interpolated(truth, before, after, when[order])
    return JudgedTruth(tracks, before, after, longest_gap_s)


class JudgedRows(NamedTuple):
    """A tracker's rows at the instants that are judged.

    Attributes:
        rows: (m,) those at these instants, and those interpolated.
        n_interpolated: how many the tracker did not have.
        left_out: how many of its rows are of groups or times without a truth.
        beyond: how many rows of the truth are before its first or after its last row, or of groups without one.
    """

    rows: TrackedRows
    n_interpolated: int
    left_out: int
    beyond: int


def judged_rows(rows: TrackedRows, truth: Tracks) -> JudgedRows:
    """What a tracker says at the instants of the truth.

    Between two rows of a track that are at most 1.5 of the tracker's own median intervals apart everything is
    interpolated linearly, direction the shorter way round; elsewhere it says nothing. The covariance is too, which is
    an upper bound: of errors of any correlation the mean has at most the mean covariance. So NEES is not flattered.

    Args:
        rows: what it says, at any instants.
        truth: as of `judged_truth`.
    """
    group, time_ns = _instants(truth)
    interval_s = usual_interval_s(rows)
    rows = _unrounded(rows, np.unique(time_ns), min(ROUNDING_NS, ROUNDING_SHARE * interval_s * 1e9))
    _, before, after = found = known_at(rows, group, time_ns, longest_gap_s=OWN_INTERVALS * interval_s)
    order = np.lexsort((found.instant, before))
    before, after, when = before[order], after[order], time_ns[found.instant[order]]
    left_out, beyond = len(rows), len(truth)
    for one in np.unique(group):
        own, there = rows.time_ns[rows.group == one], truth.time_ns[truth.group == one]
        left_out -= int(((own >= there.min()) & (own <= there.max())).sum())
        beyond -= int(((there >= own.min()) & (there <= own.max())).sum()) if own.size else 0
    at, is_between = rows[before], before != after
    if is_between.any():
        names = ("position", "covariance", "direction", "speed", "unseen_s")
        at = replace(at, time_ns=when, **_between(rows, before, after, when, names))
    return JudgedRows(at, int(is_between.sum()), left_out, beyond)


def _instants(rows: Tracks) -> tuple[IntArray, IntArray]:
    """(k,) the group and the time of each instant."""
    _, first = np.unique(instant_numbers(rows)[0], return_index=True)
    return rows.group[first], rows.time_ns[first]


def _unrounded(rows: TrackedRows, time_ns: IntArray, most_ns: float) -> TrackedRows:
    """The rows, at the nearest of ascending times where that is near; but for two of a track at one of them."""
    if not time_ns.size:
        return rows
    after = np.clip(np.searchsorted(time_ns, rows.time_ns), 1, max(time_ns.size - 1, 1))
    one, other = time_ns[after - 1], time_ns[np.minimum(after, time_ns.size - 1)]
    nearest = np.where(np.abs(one - rows.time_ns) <= np.abs(other - rows.time_ns), one, other)
    is_near = np.abs(nearest - rows.time_ns) <= most_ns
    moved = np.where(is_near, nearest, rows.time_ns)
    return replace(rows, time_ns=np.where(repeated_rows(rows.vehicle, moved), rows.time_ns, moved))


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


def known_at(truth: Tracks | TrackedRows, group: IntArray, time_ns: IntArray, *, longest_gap_s: float) -> Known:
    """Each vehicle at each instant of its group that is a row's own, or between two rows near enough.

    Args:
        truth: where vehicles were, or a tracker says that they were.
        group: (n,) of the instants,
        time_ns: (n,) and their times.
        longest_gap_s: seconds between two rows of a vehicle that are near enough.
    """
    vehicle, sorted_instants = truth.vehicle, np.argsort(time_ns, kind="stable")
    sorted_rows = np.lexsort((truth.time_ns, vehicle))
    nothing = np.empty(0, np.int64)
    parts = [Known(nothing, nothing, nothing)]
    for one in np.unique(group):
        row, asked = sorted_rows[truth.group[sorted_rows] == one], sorted_instants[group[sorted_instants] == one]
        time, times = truth.time_ns[row], time_ns[asked]
        begin, end = (np.searchsorted(times, time, side=side) for side in ("left", "right"))
        near = np.diff(vehicle[row]) == 0
        near &= np.diff(time) <= longest_gap_s * 1e9
        step = np.flatnonzero(near)
        for first, last, before, after in (
            (begin, end, row, row), (end[:-1][step], begin[1:][step], row[:-1][step], row[1:][step]),
        ):  # fmt: skip
            n = np.maximum(last - first, 0)
            at = np.repeat(first - np.cumsum(n) + n, n) + np.arange(n.sum())
            parts.append(Known(asked[at], np.repeat(before, n), np.repeat(after, n)))
    return Known(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def usual_interval_s(rows: Tracks | TrackedRows) -> float:
    """Median seconds between two rows of a vehicle; 0 where none has two."""
    vehicle = rows.vehicle
    order = np.lexsort((rows.time_ns, vehicle))
    step_ns = np.diff(rows.time_ns[order])[np.diff(vehicle[order]) == 0]
    return float(np.median(step_ns)) * 1e-9 if step_ns.size else 0.0


def interpolated(truth: Tracks, before: IntArray, after: IntArray, time_ns: IntArray) -> Tracks:
    """Rows at ascending times (m,) between rows of the truth, or at them; direction turns the shorter way round."""
    return Tracks(
        track_id=truth.track_id[before], time_ns=time_ns, group=truth.group[before], origin=truth.origin,
        **_between(truth, before, after, time_ns, ("position", "direction", "speed")),
    )  # fmt: skip


def _between(
    rows: Tracks | TrackedRows, before: IntArray, after: IntArray, time_ns: IntArray, names: Sequence[str]
) -> dict[str, Any]:
    """Columns of these names at times (m,) between rows, linearly; a direction turns the shorter way round."""
    share = (time_ns - rows.time_ns[before]) / np.maximum(rows.time_ns[after] - rows.time_ns[before], 1)
    found: dict[str, Any] = {}
    for name in names:
        column = getattr(rows, name)
        step = (difference if name == "direction" else np.subtract)(column[after], column[before])
        found[name] = column[before] + share.reshape(-1, *[1] * (column.ndim - 1)) * step
    return found | {"direction": wrap(found["direction"])}
