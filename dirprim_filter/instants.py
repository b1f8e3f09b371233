"""Who is where at an instant: the vehicles of a log side by side, each as it was last seen."""

from __future__ import annotations

from collections.abc import Iterator
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
        vehicle = tracks.vehicle
        row, at = _seen_before(tracks, group, time_ns)
        n = 1 + int(vehicle.max(initial=-1))
        key = at * n + vehicle[row]
        order = np.argsort(key, kind="stable")  # of a vehicle's rows before an instant the last one stays
        lasts = order[np.append(np.diff(key[order]) != 0, True)[: order.size]]
        row, at = row[lasts], at[lasts]
        state = np.empty((row.size, 4))
        state[:, 2], state[:, 3] = course, speed = tracks.direction[row], tracks.speed[row]
        way = speed * (time_ns[at] - tracks.time_ns[row]) * 1e-9
        state[:, 0] = tracks.position[row, 0] + way * np.cos(course)
        state[:, 1] = tracks.position[row, 1] + way * np.sin(course)
        first = np.searchsorted(at, np.arange(time_ns.size + 1))
        return cls(state, np.asarray(vehicle[row], np.int64), first)

    @property
    def instant(self) -> IntArray:
        """(n,) the instant of each row."""
        return np.repeat(np.arange(self.first.size - 1), np.diff(self.first))

    def some(self, instant: IntArray) -> Instants:
        """Those that are chosen, (m,), in their order."""
        count = np.diff(self.first)[instant]
        first = np.append(0, np.cumsum(count))
        row = np.repeat(self.first[instant] - first[:-1], count) + np.arange(first[-1])
        return Instants(self.state[row], self.vehicle[row], first)

    def rows_of(self, instant: IntArray, vehicle: IntArray) -> IntArray:
        """(m,) the row of each vehicle at each instant, -1 where it is not there. (m,), (m,)."""
        wide = 1 + max(int(self.vehicle.max(initial=0)), int(np.max(vehicle, initial=0)))
        own, wanted = self.instant * wide + self.vehicle, instant * wide + vehicle
        at = np.minimum(np.searchsorted(own, wanted), max(own.size - 1, 0))
        return np.where(own[at] == wanted, at, -1) if own.size else np.full(wanted.size, -1)


def _seen_before(tracks: Tracks, group: IntArray, time_ns: IntArray) -> tuple[IntArray, IntArray]:
    """Rows of an instant's group within `LONGEST_UNSEEN_S` before it, in order of time; and the instant of each."""
    unseen_ns = int(LONGEST_UNSEEN_S * 1e9)
    rows, instants = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    of_group = dict(rows_of_groups(tracks.group))
    for one, wanted in rows_of_groups(group):
        own = of_group.get(one, np.empty(0, np.int64))
        seen_ns, asked_ns = tracks.time_ns[own], time_ns[wanted]
        begin = np.searchsorted(seen_ns, asked_ns - unseen_ns)
        count = np.searchsorted(seen_ns, asked_ns, side="right") - begin
        row = np.repeat(begin, count) + np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        rows.append(row if isinstance(own, slice) else own[row])
        instants.append(np.repeat(np.arange(time_ns.size)[wanted], count))
    return np.concatenate(rows), np.concatenate(instants)


def rows_of_groups(group: IntArray) -> Iterator[tuple[int, IntArray | slice]]:
    """Each group, ascending, and its rows, (n,) of each row's group: most logs have one, of which nothing is copied."""
    if group.size == 0:
        return
    if (group == group[0]).all():
        yield int(group[0]), slice(None)
        return
    order = np.argsort(group, kind="stable")
    groups, first = np.unique(group[order], return_index=True)
    yield from zip(groups.tolist(), np.split(order, first[1:]), strict=True)
