"""Visits: a vehicle's runs through one cell each, which every statistic of motion counts once.

Rows are filled in to .1 s, or a tenth of their interval, by cubic Hermite splines of position, course and speed, so
that a log of 2 Hz passes the same cells as one of 10 Hz. A vehicle that stops in a cell makes three visits to it: it
arrives, stands, and leaves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.distributions.angles import difference, wrap
from dirprim_filter.primitives._manoeuvres import STANDING_BELOW
from dirprim_filter.primitives.rows import Scale, TrackRows
from tessellation import Tessellation

STEP_S = 0.1
"""Of rows that are seen every second or more often."""
SHORTEST_STAND_S = 0.5
AHEAD_M = ((8.0, 2.0), (16.0, 3.0), (30.0, 5.0))
"""How far ahead visits are compared by place, and how far apart places are then alike, metres at `Scale.length` 1."""
FASTER_S = ((1.5, 1.5), (3.0, 3.0))
"""How long ahead they are compared by speed, seconds or intervals, and how far apart speeds are then alike, m/s."""
GAINED_S = 1.5
LATERAL_M, COURSE_CHORD, LOG_PACE, GAINED_MPS = 1.0, 0.2, 0.25, 1.0
"""How far visits may differ: across the course, as a chord of the unit circle, in log(speed + 1), in speed gained."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Visits:
    """Instants of vehicles `step_s` apart, and their runs through one cell each.

    Attributes:
        vehicle: (n,) of each instant.
        segment: (n,) a vehicle's rows without a long gap.
        position: (n, 2) metres.
        course: (n,) radians.
        speed: (n,) m/s.
        begin: (v,) first instant of each visit.
        end: (v,) the instant after its last.
        cell: (v,) `OUTSIDE` for none.
        stands: (v,) whether the vehicle stands.
        weight: (v,) how many vehicles its vehicle stands for, as many in all as say as much.
        scale: of the data.
    """

    vehicle: IntArray
    segment: IntArray
    position: FloatArray
    course: FloatArray
    speed: FloatArray
    begin: IntArray
    end: IntArray
    cell: IntArray
    stands: BoolArray
    weight: FloatArray
    scale: Scale

    @classmethod
    def of(cls, rows: TrackRows, cells: Tessellation) -> Visits:
        """The visits of rows sorted by vehicle and time."""
        vehicle, segment, position, course, speed = filled_in(rows)
        cell = cells.cell_of(position)
        stands = _stands(segment, speed, rows.scale.step_s)
        changes = np.zeros(segment.size, np.bool_)
        for column in (segment, cell, stands):
            changes[1:] |= column[1:] != column[:-1]
        changes[:1] = True
        begin = np.flatnonzero(changes)
        end = np.append(begin[1:], segment.size)[: begin.size]
        of_vehicle = np.ones(int(rows.vehicle.max(initial=-1)) + 1)
        of_vehicle[rows.vehicle] = rows.weight
        weight = of_vehicle[vehicle[begin]]
        return cls(
            vehicle=vehicle, segment=segment, position=position, course=course, speed=speed, begin=begin, end=end,
            cell=cell[begin], stands=stands[begin], scale=rows.scale,
            weight=weight * (weight.sum() / max((weight**2).sum(), 1e-300)),
        )  # fmt: skip

    def __len__(self) -> int:
        return self.begin.size

    @property
    def of_instant(self) -> IntArray:
        """(n,) the visit that each instant belongs to."""
        return np.repeat(np.arange(len(self)), self.end - self.begin)

    @property
    def seconds(self) -> FloatArray:
        """(v,) how long each lasts."""
        return np.asarray((self.end - self.begin) * self.scale.step_s)

    def follows(self) -> BoolArray:
        """(v,) whether the next visit is of the same vehicle, without a gap."""
        same = self.segment[self.begin[1:]] == self.segment[self.begin[:-1]]
        return np.append(same, np.zeros(min(len(self), 1), np.bool_))

    def later(self, seconds: float) -> IntArray:
        """(n,) the instant so much later of the same segment, at least the next; -1 where there is none."""
        lag, n = self._lag(seconds), self.segment.size
        found = np.full(n, -1, np.int64)
        if lag < n:
            found[: n - lag] = np.where(self.segment[: n - lag] == self.segment[lag:], np.arange(lag, n), -1)
        return found

    def _lag(self, seconds: float) -> int:
        return max(round(seconds / self.scale.step_s), 1)

    def lag_s(self, seconds: float) -> float:
        """Seconds from an instant to that of `later`."""
        return self._lag(seconds) * self.scale.step_s

    def features(self, centers: FloatArray) -> FloatArray:
        """What distinguishes visits of one cell: how they enter and continue. (v, f), NaN where not observed.

        Each is in units of the distance within which two visits are similar. The manoeuvre of a vehicle is seen
        later: where it is 8, 16 and 30 m on, and how fast 1.5 and 3 s on.
        """
        first, last, middle = self.begin, self.end - 1, (self.begin + self.end - 1) // 2
        cosine, sine, log_pace = np.cos(self.course), np.sin(self.course), np.log(self.speed + 1.0)
        offset = self.position[middle] - centers[self.cell]
        length, time = self.scale.length, max(self.scale.interval_s, 1.0)
        columns = [(cosine[middle] * offset[:, 1] - sine[middle] * offset[:, 0]) / (LATERAL_M * length)]
        for at in (first, last):
            columns += [cosine[at] / COURSE_CHORD, sine[at] / COURSE_CHORD, log_pace[at] / LOG_PACE]
        way = np.hypot(*np.diff(self.position, axis=0, prepend=self.position[:1]).T)
        way[np.diff(self.segment, prepend=-1) != 0] = 0.0
        driven = np.cumsum(way)
        beyond = 2.0 * (driven[-1] if driven.size else 0.0) + 1e3  # from segment to segment, so that all is sorted
        sorted_way = driven + beyond * self.segment
        for metres, alike in AHEAD_M:
            there = np.searchsorted(sorted_way, sorted_way[first] + length * metres)
            known = (there < way.size) & (self.segment[np.minimum(there, way.size - 1)] == self.segment[first])
            place = self.position[np.minimum(there, way.size - 1)] / (length * alike)
            columns += list(np.where(known[:, None], place, np.nan).T)
        for seconds, alike in FASTER_S:
            columns.append(self._seen_later(self.speed, time * seconds) / alike)
        columns.append((self._seen_later(self.speed, time * GAINED_S) - self.speed[first]) / GAINED_MPS)
        return np.column_stack(columns)

    def _seen_later(self, column: FloatArray, seconds: float) -> FloatArray:
        """(v,) a column so long after each visit begins; NaN where that is not seen."""
        at = self.later(seconds)[self.begin]
        return np.where(at >= 0, column[at], np.nan)


def filled_in(rows: TrackRows) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray]:
    """Vehicle, segment, position, course and speed every `step_s` from each segment's first row on.

    By cubic Hermite splines; a segment is a vehicle's rows without a long gap, and a row by itself says nothing.
    """
    step, longest = round(rows.scale.step_s * 1e9), round(rows.scale.longest_gap_s * 1e9)
    joined = (np.diff(rows.vehicle) == 0) & (np.diff(rows.time_ns) <= longest)
    kept = np.flatnonzero((np.append(False, joined) | np.append(joined, False))[: len(rows)])
    begins, time = ~np.append(False, joined)[kept], rows.time_ns[kept]
    first, segment = np.flatnonzero(begins), np.cumsum(begins) - 1
    last = np.append(first[1:], kept.size)[: first.size] - 1
    lasts = time[last] - time[first]
    n_steps = lasts // step + 1
    of = np.repeat(np.arange(first.size), n_steps)
    at = time[first][of] + step * (np.arange(of.size) - np.repeat(np.cumsum(n_steps) - n_steps, n_steps))
    shift = np.cumsum(lasts + 1) - lasts - time[first]  # segments end to end, so that one search serves all
    i = np.searchsorted(time + shift[segment], at + shift[of], side="right") - 1
    j = np.minimum(i + 1, last[of])
    h = (time[j] - time[i]) * 1e-9
    u, i, j = (at - time[i]) * 1e-9 / np.maximum(h, 1e-9), kept[i], kept[j]
    velocity = rows.speed[:, None] * np.column_stack([np.cos(rows.direction), np.sin(rows.direction)])
    start, end = 1.0 - u, u
    position = (
        ((1 + 2 * u) * start**2)[:, None] * rows.position[i] + (u * start**2 * h)[:, None] * velocity[i]
        + (end**2 * (3 - 2 * u))[:, None] * rows.position[j] + (end**2 * (u - 1) * h)[:, None] * velocity[j]
    )  # fmt: skip
    course = wrap(rows.direction[i] + u * difference(rows.direction[j], rows.direction[i]))
    return rows.vehicle[i], of, position, course, start * rows.speed[i] + end * rows.speed[j]


def _stands(segment: IntArray, speed: FloatArray, step_s: float) -> BoolArray:
    """(n,) where a vehicle stands, for `SHORTEST_STAND_S` at least."""
    slow = speed < STANDING_BELOW
    change = np.ones(slow.size, np.bool_)
    change[1:] = (slow[1:] != slow[:-1]) | (segment[1:] != segment[:-1])
    run = np.cumsum(change) - 1
    length = np.bincount(run, minlength=1)
    return np.asarray(slow & (length[run] * step_s >= SHORTEST_STAND_S - 1e-9))
