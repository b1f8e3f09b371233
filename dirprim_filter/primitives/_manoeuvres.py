"""Compiled: which manoeuvre a particle takes up, and which follows another.

By how often each is driven from a cell, or after the one before, and by how well it fits; where nothing fits, by the
place-free ones.
"""

import math
from typing import NamedTuple

from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._elementary import EXACT, exp, log
from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.primitives.motion import CREEP
from tessellation._kernels import Locator

# Columns of `MotionTable.row`.
(EAST, NORTH, EXTENT, COURSE, BEND_E, BEND_N, A_0, A_E, A_N, A_V, PUSH, TURNING, KEEPS, LONGER, STARTS, PACE, GAIN_E,
 GAIN_N, PATH_0, PATH_1, PATH_2, COSINE, SINE, BY_COURSE, BY_PACE, BY_PATH, SCALE, VISITS, SECONDS, AHEAD,
 MODE, CURVATURE) = range(32)  # fmt: skip
N_COLUMNS = 32
STANDING_BELOW = 0.1
"""m/s: who is faster creeps, which is to start or to stop; queues of real vehicles do so for seconds."""
DEGREES = 5.0
"""Of freedom: (DEGREES + 3) / 2 is the power in `fit`."""
DISCOUNT = 0.2
"""Subtracted from each count of transitions (Ney, Essen and Kneser 1994), for transitions that were not seen."""


class MotionTable(NamedTuple):
    """A map's motion as the kernels take it; the last rows are the place-free manoeuvres'."""

    locator: Locator
    row: FloatArray  # (z, N_COLUMNS)
    begin: IntArray  # (n_cells + 1,) the first manoeuvre of each cell
    first: IntArray  # (z + 1,)
    following: IntArray  # (t,)
    count: FloatArray  # type: ignore[assignment]  # (t,), not the method of tuples
    most: int  # manoeuvres of a cell, and the place-free ones
    course_rate: float
    push_rate: float
    strength: float
    place_free_share: float
    redraw_rate: float
    drift: float
    step_s: float


@njit(**EXACT)
def copied(table: MotionTable) -> MotionTable:
    """The same table in memory of its own: threads that count references to one array wait for each other."""
    place = table.locator
    return MotionTable(
        Locator(place.origin_x, place.origin_y, place.pixels_per_metre, place.pixel.copy(), place.entry.copy()),
        table.row.copy(), table.begin.copy(), table.first.copy(), table.following.copy(), table.count.copy(),
        table.most, table.course_rate, table.push_rate, table.strength, table.place_free_share, table.redraw_rate,
        table.drift, table.step_s,
    )  # fmt: skip


@njit(**EXACT)
def fit(rows: FloatArray, z: int, x: float, y: float, direction: float, speed: float, log_pace: float) -> float:
    """How well course, pace and path fit a manoeuvre: their density, divided by the place-free one.

    Student's t of three variables with `DEGREES` of freedom: a vehicle that fits none well still follows the road.
    """
    extent = rows[z, EXTENT]
    east, north = min(max(x - rows[z, EAST], -extent), extent), min(max(y - rows[z, NORTH], -extent), extent)
    off = direction - rows[z, COURSE] - rows[z, BEND_E] * east - rows[z, BEND_N] * north
    off -= 2.0 * math.pi * math.floor(off / (2.0 * math.pi) + 0.5)
    off *= min(speed, 1.0) * rows[z, BY_COURSE]
    pace = (log_pace - rows[z, PACE] - rows[z, GAIN_E] * east - rows[z, GAIN_N] * north) * rows[z, BY_PACE]
    u, across = rows[z, COSINE] * east + rows[z, SINE] * north, rows[z, COSINE] * north - rows[z, SINE] * east
    across = (across - rows[z, PATH_0] - rows[z, PATH_1] * u - rows[z, PATH_2] * u * u) * rows[z, BY_PATH]
    q = 1.0 + (off * off + pace * pace + across * across) / DEGREES
    return float(rows[z, SCALE] / (q * q * q * q))


@njit(**EXACT)
def take_up(
    table: MotionTable, before: int, cell: int, x: float, y: float, direction: float, speed: float, by_time: bool,
    least: float, weight: FloatArray, state: UIntArray,
) -> int:  # fmt: skip
    """A manoeuvre of the cell by how often it is driven and how well it fits, or a place-free one.

    Args:
        table: the map.
        before: the manoeuvre so far, -1 for none.
        cell: where; -1 for outside of all.
        x: metres.
        y: metres.
        direction: radians.
        speed: m/s.
        by_time: weigh manoeuvres by how long they are driven, as found at any instant, not by how often entered.
        least: share of the place-free manoeuvres, if theirs is less.
        weight: (most,) room.
        state: of the random numbers.
    """
    stands = speed < STANDING_BELOW
    rows, begin = table.row, table.begin  # taken out of the table once: each time counts a reference
    a, b, total, log_pace = 0, 0, 0.0, log(speed + CREEP)
    if cell >= 0:
        a, b = begin[cell], begin[cell + 1]
    for z in range(a, b):
        weight[z - a] = 0.0
        if (rows[z, STARTS] > 0.0) == stands:
            fits = fit(rows, z, x, y, direction, speed, log_pace)
            weight[z - a] = rows[z, SECONDS if by_time else VISITS] * fits
            total += weight[z - a]
    share = table.strength / (total + table.strength)
    if total > 0.0 and random.uniform(state) >= max(share, least):
        left = random.uniform(state) * total
        for z in range(a, b):
            left -= weight[z - a]
            if left < 0.0:
                return z
    if before >= 0 and (rows[before, STARTS] > 0.0) == stands:
        return before
    return leave_places(table, before, speed, weight, state)


@njit(**EXACT)
def leave_places(table: MotionTable, before: int, speed: float, weight: FloatArray, state: UIntArray) -> int:
    """A place-free manoeuvre: that which follows another such, or else any of about that speed."""
    rows, first, following, count = table.row, table.first, table.following, table.count
    n_placed, stands, total = table.begin[-1], speed < STANDING_BELOW, 0.0
    if before >= n_placed:
        for t in range(first[before], first[before + 1]):
            if (rows[following[t], STARTS] > 0.0) == stands:
                total += count[t]
        left = random.uniform(state) * total
        for t in range(first[before], first[before + 1]):
            if (rows[following[t], STARTS] > 0.0) == stands:
                left -= count[t]
                if left < 0.0:
                    return int(following[t])
    total, pace = 0.0, log(speed + CREEP)
    for z in range(n_placed, len(rows)):
        weight[z - n_placed] = 0.0
        if (rows[z, STARTS] > 0.0) == stands:
            off = (pace - rows[z, PACE]) * rows[z, BY_PACE]
            weight[z - n_placed] = rows[z, SECONDS] * rows[z, BY_PACE] * exp(max(-0.5 * off * off, -50.0))
            total += weight[z - n_placed]
    left = random.uniform(state) * total
    for z in range(n_placed, len(rows)):
        left -= weight[z - n_placed]
        if left < 0.0:
            return z
    return len(rows) - 1


@njit(**EXACT)
def go_over(
    table: MotionTable, before: int, cell: int, x: float, y: float, direction: float, speed: float, weight: FloatArray,
    state: UIntArray,
) -> int:  # fmt: skip
    """The manoeuvre that follows another in the cell entered: by counts, or backing off to any that fits there."""
    rows, first, following, count = table.row, table.first, table.following, table.count
    stands, n, kinds = speed < STANDING_BELOW, 0.0, 0.0
    if cell >= 0 and before < table.begin[-1]:
        a, b = table.begin[cell], table.begin[cell + 1]
        for t in range(first[before], first[before + 1]):
            z = following[t]
            if a <= z < b and (rows[z, STARTS] > 0.0) == stands:
                n += count[t]
                kinds += DISCOUNT
        left = random.uniform(state) * n
        if n > 0.0 and left < n - kinds:
            for t in range(first[before], first[before + 1]):
                z = following[t]
                if a <= z < b and (rows[z, STARTS] > 0.0) == stands:
                    left -= count[t] - DISCOUNT
                    if left < 0.0:
                        return int(z)
    return take_up(table, before, cell, x, y, direction, speed, False, 0.0, weight, state)


@njit(**EXACT)
def course_at(row: FloatArray, x: float, y: float) -> float:
    """The course of a manoeuvre at a place."""
    extent = row[EXTENT]
    east, north = min(max(x - row[EAST], -extent), extent), min(max(y - row[NORTH], -extent), extent)
    return float(row[COURSE] + row[BEND_E] * east + row[BEND_N] * north)


@njit(**EXACT)
def keep_deviation(
    table: MotionTable, before: int, after: int, place: FloatArray, direction: FloatArray, p: int
) -> None:
    """Turn a particle with the course of its manoeuvre: what it keeps is how it deviates."""
    one, other = table.row[before], table.row[after]
    if one[KEEPS] + other[KEEPS] + one[STARTS] + other[STARTS] == 0.0:
        turned = direction[p] + course_at(other, place[0], place[1])
        turned -= course_at(one, place[0], place[1])
        direction[p] = turned - 2.0 * math.pi * math.floor(turned / (2.0 * math.pi) + 0.5)
