"""Who is where at an instant: the vehicles of a log side by side, each as it was last seen."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.tracks import Tracks

LONGEST_UNSEEN_S = 0.25
"""Who was last seen longer ago may have gone."""


class Instants(NamedTuple):
    """The vehicles of some instants, one instant after the other.

    Attributes:
        state: (n, 4) metres east and north, radians, m/s.
        vehicle: (n,) number of the vehicle, (group, id), among the log's.
        first: (i + 1,) instant i has the rows from first[i] to first[i + 1], ascending by vehicle.
    """

    state: FloatArray
    vehicle: IntArray
    first: IntArray

    @classmethod
    def of(cls, tracks: Tracks, group: IntArray, time_ns: IntArray) -> Instants:
        """All vehicles of a group at its instants, moved straight on from where each was last seen.

        Nothing is used that was seen after an instant. (i,) groups, (i,) times.
        """
        vehicle, by_time = tracks.vehicle, np.lexsort((time_ns, group))
        order = np.lexsort((tracks.time_ns, vehicle))
        bounds = np.searchsorted(vehicle[order], np.arange(tracks.n_tracks + 1))
        wanted, unseen_ns = time_ns[by_time], int(LONGEST_UNSEEN_S * 1e9)
        rows, at = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
        for a, b in pairwise(bounds.tolist()):
            seen_ns, own_group = tracks.time_ns[order[a:b]], tracks.group[order[a]]
            low, high = np.searchsorted(group[by_time], [own_group, own_group + 1])
            begin, end = np.searchsorted(wanted[low:high], [seen_ns[0], seen_ns[-1] + unseen_ns + 1]) + low
            last = np.searchsorted(seen_ns, wanted[begin:end], side="right") - 1
            near = wanted[begin:end] - seen_ns[last] <= unseen_ns
            rows.append(order[a + last[near]])
            at.append(by_time[begin:end][near])
        row, instant = np.concatenate(rows), np.concatenate(at)
        by_instant = np.argsort(instant, kind="stable")
        row, instant = row[by_instant], instant[by_instant]
        course, speed = tracks.direction[row], tracks.speed[row]
        way = speed * (time_ns[instant] - tracks.time_ns[row]) * 1e-9
        place = tracks.position[row] + way[:, None] * np.column_stack([np.cos(course), np.sin(course)])
        first = np.searchsorted(instant, np.arange(time_ns.size + 1))
        return cls(np.column_stack([place, course, speed]), np.asarray(vehicle[row], np.int64), first)

    @property
    def instant(self) -> IntArray:
        """(n,) the instant of each row."""
        return np.repeat(np.arange(self.first.size - 1), np.diff(self.first))

    def rows_of(self, instant: IntArray, vehicle: IntArray) -> IntArray:
        """(m,) the row of each vehicle at each instant, -1 where it is not there. (m,), (m,)."""
        wide = 1 + max(int(self.vehicle.max(initial=0)), int(np.max(vehicle, initial=0)))
        own, wanted = self.instant * wide + self.vehicle, instant * wide + vehicle
        at = np.minimum(np.searchsorted(own, wanted), max(own.size - 1, 0))
        return np.where(own[at] == wanted, at, -1) if own.size else np.full(wanted.size, -1)
