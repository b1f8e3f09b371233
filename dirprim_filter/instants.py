"""Who is where at an instant: the vehicles of a log side by side, each as it was last seen."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.tracks import Tracks

LONGEST_UNSEEN_S = 0.25
"""Who was last seen longer ago may have gone."""


class Instants(NamedTuple):
    """The vehicles of some instants, one instant after the other."""

    state: FloatArray  # (n, 4) metres east and north, radians, m/s
    vehicle: IntArray  # (n,) number of the vehicle, (group, id), among the log's
    first: IntArray  # (i + 1,) instant i has the rows from first[i] to first[i + 1], ascending by vehicle

    @classmethod
    def of(cls, tracks: Tracks, group: IntArray, time_ns: IntArray) -> Instants:
        """All vehicles of a group at its instants, moved straight on from where each was last seen.

        Nothing is used that was seen after an instant. (i,) groups, (i,) times.
        """
        order = np.argsort(tracks.group, kind="stable")  # each group's rows are in order of time
        of_group, seen_ns = tracks.group[order], tracks.time_ns[order]
        begin, count = np.zeros((2, time_ns.size), np.int64)
        for one in np.unique(group).tolist():
            wanted, start = group == one, int(np.searchsorted(of_group, one))
            asked_ns, own_ns = time_ns[wanted], seen_ns[start : np.searchsorted(of_group, one, side="right")]
            begin[wanted] = start + np.searchsorted(own_ns, asked_ns - int(LONGEST_UNSEEN_S * 1e9))
            count[wanted] = start + np.searchsorted(own_ns, asked_ns, side="right") - begin[wanted]
        at = np.repeat(np.arange(time_ns.size), count)
        row = order[np.arange(at.size) + np.repeat(begin - np.cumsum(count) + count, count)]
        vehicle = tracks.vehicle[row]
        key = np.lexsort((vehicle, at))  # of a vehicle's rows before an instant the last one stays
        is_last = np.append((np.diff(at[key]) != 0) | (np.diff(vehicle[key]) != 0), True)[: key.size]
        row, at = row[key[is_last]], at[key[is_last]]
        course, speed = tracks.direction[row], tracks.speed[row]
        way = speed * (time_ns[at] - tracks.time_ns[row]) * 1e-9
        place = tracks.position[row] + np.column_stack([way * np.cos(course), way * np.sin(course)])
        state = np.column_stack([place, course, speed])
        return cls(state, vehicle[key[is_last]], np.searchsorted(at, np.arange(time_ns.size + 1)))

    def rows_of(self, others: Instants) -> IntArray:
        """(m,) the row of each of the others' rows: of its vehicle at its instant, -1 where that is not there."""
        n = 1 + max(int(of.vehicle.max(initial=0)) for of in (self, others))
        own, wanted = (
            np.repeat(np.arange(of.first.size - 1), np.diff(of.first)) * n + of.vehicle for of in (self, others)
        )
        row = np.append(np.arange(own.size), -1)[np.searchsorted(own, wanted)]
        return np.where(np.append(own, -1)[row] == wanted, row, -1)
