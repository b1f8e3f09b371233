"""Visits: a vehicle's runs through one cell each, which every statistic of motion counts once.

Rows are filled in to `STEP_S` by cubic Hermite splines of position, course and speed, so that a log of 2 Hz passes the
same cells as one of 10 Hz. A vehicle that stops in a cell makes three visits to it: it arrives, stands, and leaves.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.primitives._manoeuvres import STANDING_BELOW
from dirprim_filter.primitives.rows import TrackRows
from tessellation import Tessellation

STEP_S = 0.1
LONGEST_GAP_S = 1.5
"""Between two rows further apart a vehicle's way is not known."""
SHORTEST_STAND_S = 0.5
AHEAD_M = ((8.0, 2.0), (16.0, 3.0), (30.0, 5.0))
"""How far ahead visits are compared by place, and how far apart places are then alike, metres."""
AHEAD_S = ((1.5, 1.5), (3.0, 3.0))
"""How long ahead they are compared by speed, seconds, and how far apart speeds are then alike, m/s."""
GAINED_S = 1.5
LATERAL_M, COURSE_CHORD, LOG_PACE, GAINED_MPS = 1.0, 0.2, 0.25, 1.0
"""How far apart visits are alike: across the way, as a chord of the unit circle, in log(speed + 1), in speed gained."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Visits:
    """Instants of vehicles `STEP_S` apart, and their runs through one cell each.

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

    @classmethod
    def of(cls, rows: TrackRows, cells: Tessellation) -> Visits:
        """The visits of rows sorted by vehicle and time."""
        vehicle, segment, position, course, speed = filled_in(rows)
        cell = cells.cell_of(position)
        stands = _stands(segment, speed)
        changes = np.zeros(segment.size, np.bool_)
        for column in (segment, cell, stands):
            changes[1:] |= column[1:] != column[:-1]
        changes[:1] = True
        begin = np.flatnonzero(changes)
        end = np.append(begin[1:], segment.size)[: begin.size]
        return cls(
            vehicle=vehicle, segment=segment, position=position, course=course, speed=speed, begin=begin, end=end,
            cell=cell[begin], stands=stands[begin],
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
        return np.asarray((self.end - self.begin) * STEP_S)

    def follows(self) -> BoolArray:
        """(v,) whether the next visit is of the same vehicle, without a gap."""
        same = self.segment[self.begin[1:]] == self.segment[self.begin[:-1]]
        return np.append(same, np.zeros(min(len(self), 1), np.bool_))

    def later(self, seconds: float) -> IntArray:
        """(n,) the instant so much later of the same segment, -1 where there is none."""
        lag, n = round(seconds / STEP_S), self.segment.size
        found = np.full(n, -1, np.int64)
        if lag < n:
            found[: n - lag] = np.where(self.segment[: n - lag] == self.segment[lag:], np.arange(lag, n), -1)
        return found

    def features(self, centers: FloatArray) -> FloatArray:
        """What distinguishes visits of one cell: how they enter and continue. (v, f), NaN where not observed.

        Each is in units of the distance within which two visits are similar. The manoeuvre of a vehicle is seen
        later: where it is 8, 16 and 30 m on, and how fast 1.5 and 3 s on.
        """
        first, last, middle = self.begin, self.end - 1, (self.begin + self.end - 1) // 2
        cosine, sine, log_pace = np.cos(self.course), np.sin(self.course), np.log(self.speed + 1.0)
        offset = self.position[middle] - centers[self.cell]
        columns = [(cosine[middle] * offset[:, 1] - sine[middle] * offset[:, 0]) / LATERAL_M]
        for at in (first, last):
            columns += [cosine[at] / COURSE_CHORD, sine[at] / COURSE_CHORD, log_pace[at] / LOG_PACE]
        way = np.hypot(*np.diff(self.position, axis=0, prepend=self.position[:1]).T)
        way[np.diff(self.segment, prepend=-1) != 0] = 0.0
        driven = np.cumsum(way)
        beyond = 2.0 * (driven[-1] if driven.size else 0.0) + 1e3  # from segment to segment, so that all is sorted
        sorted_way = driven + beyond * self.segment
        for metres, alike in AHEAD_M:
            there = np.searchsorted(sorted_way, sorted_way[first] + metres)
            known = (there < way.size) & (self.segment[np.minimum(there, way.size - 1)] == self.segment[first])
            place = self.position[np.minimum(there, way.size - 1)] / alike
            columns += list(np.where(known[:, None], place, np.nan).T)
        for seconds, alike in AHEAD_S:
            columns.append(self._seen_later(self.speed, seconds) / alike)
        columns.append((self._seen_later(self.speed, GAINED_S) - self.speed[first]) / GAINED_MPS)
        return np.column_stack(columns)

    def _seen_later(self, column: FloatArray, seconds: float) -> FloatArray:
        """(v,) a column so long after each visit begins; NaN where that is not seen."""
        at = self.later(seconds)[self.begin]
        return np.where(at >= 0, column[at], np.nan)


def filled_in(rows: TrackRows) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray]:
    """Vehicle, segment, position, course and speed every `STEP_S` from each segment's first row on."""
    time_s = (rows.time_ns - rows.time_ns[:1].sum()) * 1e-9
    breaks = np.flatnonzero((np.diff(rows.vehicle) != 0) | (np.diff(time_s) > LONGEST_GAP_S)) + 1
    bounds = np.concatenate([[0], breaks, [len(rows)]])
    vehicle, index, share, width, segment = [], [], [], [], []
    for number, (a, b) in enumerate(pairwise(bounds.tolist())):
        if b - a < 2:
            continue
        instants = np.arange(time_s[a], time_s[b - 1] + 1e-6, STEP_S)
        before = np.clip(np.searchsorted(time_s[a:b], instants + 1e-9) - 1, 0, b - a - 2) + a
        step = np.maximum(time_s[before + 1] - time_s[before], 1e-9)
        index.append(before)
        share.append(np.minimum((instants - time_s[before]) / step, 1.0))
        width.append(step)
        vehicle.append(rows.vehicle[before])
        segment.append(np.full(before.size, number))
    if not index:
        none, nothing = np.empty(0, np.int64), np.empty(0)
        return none, none, np.empty((0, 2)), nothing, nothing
    i, u, h = np.concatenate(index), np.concatenate(share), np.concatenate(width)
    position, course, speed = between(rows, i, i + 1, u, h)
    return np.concatenate(vehicle), np.concatenate(segment), position, course, speed


class MovingRows(Protocol):
    """Rows of vehicles."""

    @property
    def position(self) -> FloatArray:
        """(n, 2) metres."""
        ...

    @property
    def direction(self) -> FloatArray:
        """(n,) radians."""
        ...

    @property
    def speed(self) -> FloatArray:
        """(n,) m/s."""
        ...


def between(
    rows: MovingRows, before: IntArray, after: IntArray, share: FloatArray, width_s: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position, course and speed between rows of a vehicle, by cubic Hermite splines. -> (n, 2), (n,), (n,).

    Args:
        rows: observations.
        before: (n,) a row before each instant, or at it.
        after: (n,) a row after it.
        share: (n,) of the time between the two that has gone by.
        width_s: (n,) seconds between the two.
    """
    u, h = share[:, None], width_s[:, None]
    position, direction, speed = rows.position, rows.direction, rows.speed
    velocity = speed[:, None] * np.column_stack([np.cos(direction), np.sin(direction)])
    place = (
        (1 + 2 * u) * (1 - u) ** 2 * position[before] + u * (1 - u) ** 2 * h * velocity[before]
        + u * u * (3 - 2 * u) * position[after] + u * u * (u - 1) * h * velocity[after]
    )  # fmt: skip
    turned = (direction[after] - direction[before] + np.pi) % (2.0 * np.pi) - np.pi
    course = (direction[before] + share * turned + np.pi) % (2.0 * np.pi) - np.pi
    return place, course, (1 - share) * speed[before] + share * speed[after]


def _stands(segment: IntArray, speed: FloatArray) -> BoolArray:
    """(n,) where a vehicle stands, for `SHORTEST_STAND_S` at least."""
    slow = speed < STANDING_BELOW
    change = np.ones(slow.size, np.bool_)
    change[1:] = (slow[1:] != slow[:-1]) | (segment[1:] != segment[:-1])
    run = np.cumsum(change) - 1
    length = np.bincount(run, minlength=1)
    return np.asarray(slow & (length[run] * STEP_S >= SHORTEST_STAND_S - 1e-9))
