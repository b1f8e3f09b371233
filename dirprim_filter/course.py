"""Course over ground and speed, from where vehicles were: central differences, or a smoother where these are too noisy.

A body's yaw is no course: on bends they differ by the slip angle, .1 to .25 rad in simulators and for detectors' boxes.
White noise of standard deviation sigma in each coordinate puts a course, differenced over a span T at a speed v, wrong
by sqrt(2) sigma / (v T) radians. Third differences kill all motion of constant acceleration, so what is left of them is
that noise. Where it is too much, or rows come too seldom to show it so, velocities are a smoother's.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.distributions.angles import wrap
from dirprim_filter.smoothed_motion import SmoothedMotion
from dirprim_filter.track_ids import in_order

logger = logging.getLogger(__name__)

MOVING_FROM = 0.5
"""m/s, as in the paper: a slower vehicle has no course to measure or to be wrong about, only its body's heading."""
HALF_WINDOWS_S = (0.25, 0.5, 1.0)
"""Positions are differenced over one of these times to either side: the shortest is two rows of 10 Hz data."""
MAX_COURSE_ERROR = 0.03
"""Radians, at the median speed of what moves: a fifth of what yaw and course differ by on a bend."""
HEADING_ERROR = 0.1
"""Radians: a course less certain is worth less than the heading of a body, which differs by as much on a bend."""
MAX_GAP_S = 2.0
"""Across a longer gap nothing is differenced: the vehicle may have turned and come back; of rows that come seldom,"""
INTERVALS_IN_GAP, LONGEST_GAP_S = 3.0, 60.0
"""across so many median intervals between a vehicle's rows, up to a minute."""
STANDING_M = 0.3
"""A vehicle that moves less over the window stands: its motion may be the rocking of a body, or rounding."""
STANDING_NOISE, SMOOTHED_NOISE = 4.0, 2.0
"""A displacement below so many standard deviations of its noise counts as none, or below so many of a smoother's."""
NOISE_SPAN_S = 1.0
"""Third differences of rows farther apart show braking and turning, not noise."""
NOISE_SAMPLES = 100_000
"""The most positions that the noise is estimated from: enough for a third of a percent."""
STANDARD_DEVIATION_OF_MEDIAN = 0.6744897501960817
"""The median of the absolute value of a standard normal."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DerivedMotion:
    """Derived from positions, row by row."""

    direction: FloatArray  # (n,) course over ground, radians; the body's heading where positions do not determine it
    speed: FloatArray  # (n,) m/s; NaN where a row has no neighbour in time
    noise: float  # metres, standard deviation of each coordinate's white noise
    half_window_s: float | None  # positions were differenced over this time to either side; None: a smoother's
    median_speed: float  # m/s, of moving rows; NaN if none move
    keeps_heading: bool  # the positions are so noisy that headings estimate the course better


def motion_of(
    vehicle: IntArray, time_ns: IntArray, position: FloatArray, heading: FloatArray | None = None,
    longest_gap_s: float = LONGEST_GAP_S,
) -> DerivedMotion:  # fmt: skip
    """The motion of vehicles by their positions, each vehicle by itself.

    Where a vehicle stands its course is that of its row nearest in time that moves, with no long gap between; where
    there is none it is the heading, and of a body of unknown heading what little it moves.

    Args:
        vehicle: (n,) the number of each row's vehicle.
        time_ns: (n,) nanoseconds; each vehicle has one row at a time.
        position: (n, 2) metres.
        heading: (n,) yaw of the body, radians; NaN where unknown. Left out: nowhere known.
        longest_gap_s: across a longer one nothing is followed, however seldom rows come.
    """
    ways = Ways.of(vehicle, time_ns, position, longest_gap_s=longest_gap_s)
    yaw = (np.full(len(time_ns), np.nan) if heading is None else heading)[ways.order]
    moved, span_s = ways.differences(HALF_WINDOWS_S[-1])
    metres = np.hypot(*moved.T)
    noise = ways.noise(metres > STANDING_M)
    least_m = np.full(span_s.shape, max(STANDING_M, STANDING_NOISE * math.sqrt(2.0) * noise))
    moves = metres > least_m
    speed = float(np.median(metres[moves] / span_s[moves])) if moves.any() else math.nan
    needed_s = math.sqrt(2.0) * noise / (MAX_COURSE_ERROR * speed) if speed > 0 else 0.0
    half_window_s = next((half for half in HALF_WINDOWS_S if 2 * half >= needed_s), None)
    smoothed = ways.smoothed(metres > STANDING_M) if ways.are_seldom or half_window_s is None else None
    keeps_heading = False
    if smoothed is None:
        moved, span_s = ways.differences(half_window_s or HALF_WINDOWS_S[-1])
    else:
        noise, moved = smoothed.noise, smoothed.velocity * span_s[:, None]
        least_m = np.maximum(STANDING_M, SMOOTHED_NOISE * smoothed.spread * span_s)
        keeps_heading = bool(np.isfinite(yaw).any() and smoothed.spread > HEADING_ERROR * speed)
    direction = ways.course(moved, least_m, yaw)
    if keeps_heading:
        direction = np.where(np.isnan(yaw), direction, yaw)
    along = np.full(span_s.shape, np.nan)
    np.divide(np.hypot(*moved.T), span_s, out=along, where=span_s > 0)
    given = np.empty((2, len(time_ns)))  # in the order of the rows given
    given[:, ways.order] = direction, along
    return DerivedMotion(
        direction=wrap(given[0]), speed=given[1], noise=noise, median_speed=speed,
        half_window_s=None if smoothed else half_window_s or HALF_WINDOWS_S[-1], keeps_heading=keeps_heading,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Ways:
    """Rows in order of vehicle and time, in pieces without a gap."""

    order: IntArray  # (n,) place of each row among those given
    time_ns: IntArray  # (n,)
    position: FloatArray  # (n, 2)
    first: IntArray  # (n,) first row of each row's piece
    last: IntArray  # (n,) last row of it
    axis: IntArray  # (n,) ns: pieces end to end, further apart than any window, so that one search serves all

    @classmethod
    def of(
        cls, vehicle: IntArray, time_ns: IntArray, position: FloatArray, *, longest_gap_s: float = LONGEST_GAP_S
    ) -> Ways:  # fmt: skip
        """Of rows in any order; a gap is longer than some usual intervals, and at most so long."""
        order = in_order(vehicle, time_ns)
        time, n = time_ns[order], time_ns.size
        other, apart = np.diff(vehicle[order]) != 0, np.diff(time)
        usual_s = float(np.median(apart[~other])) * 1e-9 if not other.all() else 0.0
        breaks = other | (apart > _ns(min(max(INTERVALS_IN_GAP * usual_s, MAX_GAP_S), longest_gap_s)))
        piece = np.append(0, np.cumsum(breaks))[:n]
        axis = np.append(0, np.cumsum(np.where(breaks, 2 * _ns(HALF_WINDOWS_S[-1]) + 1, apart)))[:n]
        first, end = np.searchsorted(piece, piece), np.searchsorted(piece, piece, side="right")
        return cls(order, time, position[order], first, end - 1, axis)

    def differences(self, half_window_s: float) -> tuple[FloatArray, FloatArray]:
        """(n, 2) metres from the row so much before to the row so much after, and (n,) the seconds between them.

        A window reaches at least to the next row; at the ends of a piece it is one-sided. A row that stands alone has
        0 of both.
        """
        row = np.arange(self.axis.size)
        before = np.searchsorted(self.axis, self.axis - _ns(half_window_s), side="left")
        after = np.searchsorted(self.axis, self.axis + _ns(half_window_s), side="right") - 1
        before = np.where(before == row, np.maximum(row - 1, self.first), before)
        after = np.where(after == row, np.minimum(row + 1, self.last), after)
        span_s = (self.time_ns[after] - self.time_ns[before]) * 1e-9
        return self.position[after] - self.position[before], np.asarray(span_s, np.float64)

    def smoothed(self, moves: BoolArray) -> SmoothedMotion | None:
        """Velocities by a smoother, whose numbers are those of rows that move; None of too few rows."""
        follows = self.first[1:] == self.first[:-1]
        return SmoothedMotion.of(np.float64(1e-9) * (self.axis - self.axis[:1]), self.position, follows, moves)

    @property
    def are_seldom(self) -> bool:
        """Whether four rows usually take longer than their noise would show itself by."""
        return self.axis.size > 1 and bool(3 * np.median(np.diff(self.axis)) > _ns(NOISE_SPAN_S))

    def noise(self, moves: BoolArray) -> float:
        """Standard deviation of the white noise of each coordinate of moving vehicles, metres; 0 where none is seen.

        Of four neighbours within `NOISE_SPAN_S`, at whatever times, sum_j x_j / prod_k (t_j - t_k) is 0 of every
        parabola. Divided by the root of the sum of its squared factors it has the noise's own spread, robustly the
        median of its size.
        """
        is_near = self.axis[3:] - self.axis[:-3] <= _ns(NOISE_SPAN_S)  # so of one piece
        fourth = np.flatnonzero(is_near & moves[1 : moves.size - 2])
        if not fourth.size:
            return 0.0
        rows = fourth[:: 1 + fourth.size // NOISE_SAMPLES, None] + np.arange(4)
        time_s = (self.time_ns[rows] - self.time_ns[rows[:, :1]]) * 1e-9
        apart = time_s[:, :, None] - time_s[:, None, :] + np.eye(4)
        factor = 1.0 / apart.prod(axis=2)
        factor /= np.linalg.norm(factor, axis=1, keepdims=True)
        off = np.einsum("nj,njd->nd", factor, self.position[rows] - self.position[rows[:, :1]])
        return float(np.median(np.abs(off)) / STANDARD_DEVIATION_OF_MEDIAN)

    def course(self, moved: FloatArray, least: FloatArray, yaw: FloatArray) -> FloatArray:
        """(n,) direction of each row's move (n, 2); of less than `least` metres, that of the nearest row that moves."""
        course = np.arctan2(moved[:, 1], moved[:, 0])
        moves = np.hypot(*moved.T) >= least
        n = moves.size
        row = np.arange(n)
        past = np.maximum.accumulate(np.where(moves, row, -1))
        next_one = np.minimum.accumulate(np.where(moves, row, n)[::-1])[::-1]
        has_past, has_next = past >= self.first, next_one <= self.last
        next_one = np.minimum(next_one, n - 1)
        is_past = has_past & (~has_next | (self.time_ns - self.time_ns[past] <= self.time_ns[next_one] - self.time_ns))
        own = np.where(np.isnan(yaw), course, yaw)
        return np.where(has_past | has_next, course[np.where(is_past, past, next_one)], own)


def later_rows(vehicle: IntArray, time_ns: IntArray, span_s: float, longest_s: float) -> tuple[IntArray, BoolArray]:
    """(n,) the vehicle's first row at least `span_s` later; and (n,) whether there is one, without a longer pause.

    Rows are in order of vehicle and time.
    """
    other, step_ns = np.diff(vehicle) != 0, np.minimum(np.diff(time_ns), _ns(longest_s) + 1)
    axis = np.append(0, np.cumsum(np.where(other, _ns(span_s + longest_s), step_ns)))[: vehicle.size]
    run = np.append(0, np.cumsum(other | (step_ns > _ns(longest_s))))[: vehicle.size]
    later = np.minimum(np.searchsorted(axis, axis + _ns(span_s)), vehicle.size - 1)
    return later, (run[later] == run) & (axis[later] - axis >= _ns(span_s))


def _ns(seconds: float) -> int:
    return int(seconds * 1e9)


def log_motion(motion: DerivedMotion, n: int) -> None:
    """One line on how the courses of n rows were derived."""
    level = logging.WARNING if motion.keeps_heading else logging.INFO
    how = f"over +-{motion.half_window_s:g} s" if motion.half_window_s else "by a smoother"
    logger.log(
        level, "directions of %d rows derived from positions %s: noise %.3f m, median speed %.1f m/s%s",
        n, how, motion.noise, motion.median_speed,
        "; too noisy for a course, so the body's heading is kept" if motion.keeps_heading else "",
    )  # fmt: skip
