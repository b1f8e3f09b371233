"""Compiled: which manoeuvre a particle takes up, and which follows another.

By how often each is driven from a cell, or after the one before, and by how well it fits; where nothing fits, by the
background ones.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._arithmetic import fma
from dirprim_filter.distributions._elementary import exp, log, single
from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.primitives.motion import CREEP
from tessellation._compiling import inlined
from tessellation._kernels import Locator

# Columns of `MotionTable.row`.
(EAST, NORTH, EXTENT, COURSE, BEND_E, BEND_N, A_0, A_E, A_N, A_V, PUSH, TURNING, RETURNS, DISTANCE, STARTS,
 CURVATURE) = range(16)  # fmt: skip
N_COLUMNS, N_FIELDS, LANES = 16, 16, 8
# Where the fields of eight begin in a row of `Candidates.field`.
(HEADS, TURNS_E, TURNS_N, PACE, GAIN_E, GAIN_N, PATH_0, PATH_1, PATH_2, COSINE, SINE, BY_COURSE, BY_PACE, BY_PATH,
 BY_VISITS, BY_TIME) = range(0, N_FIELDS * LANES, LANES)  # fmt: skip
OWN_WAY = -1
"""The row of who goes its own way: straight on."""
STANDING_BELOW = 0.1
"""m/s: who is faster creeps, which is to start or to stop; queues of real vehicles do so for seconds."""
DEGREES = 5.0
"""Of freedom: (DEGREES + 3) / 2 is the power in `weigh_candidates`."""
DISCOUNT = 0.2
"""Subtracted from each count of transitions (Ney, Essen and Kneser 1994), for those that were not seen."""
_TWO_PI, _PER_TWO_PI, _PER_DEGREES = single(2.0 * np.pi), single(0.5 / np.pi), single(1.0 / DEGREES)
_NOTHING, _ONE = single(0.0), single(1.0)
_ROUND = single(1.5 * 2.0**23)  # adding it rounds to an integer

SingleArray = npt.NDArray[np.float32]


class Candidates(NamedTuple):
    """Which manoeuvres may be taken up in each cell: those in motion, then those that stand.

    Eight stand side by side, in single precision, so that one instruction weighs all of them.
    """

    center: FloatArray  # (n_cells, 3) east, north, and how far from there fields go
    begin: IntArray  # (2 n_cells + 1,) the first eight of each
    field: SingleArray  # (k, N_FIELDS * LANES)
    number: IntArray  # (k, LANES) of the manoeuvre; the eight are filled up with any, of weight 0


class MotionTable(NamedTuple):
    """A map's motion as the kernels take it; the last rows are the background manoeuvres', and one's own way."""

    locator: Locator
    candidates: Candidates
    row: FloatArray  # (z, 16), accelerations, turns and distances of those that stand are 0
    ahead: FloatArray  # (z,) radians by which vehicles have turned some seconds later
    favour: FloatArray  # (z,) how well each fits a cue, by which it is drawn; (0,) without one
    begin: IntArray  # (n_cells + 1,) the first manoeuvre of each cell
    first: IntArray  # (z + 1,)
    following: IntArray  # (t,)
    count: FloatArray  # type: ignore[assignment]  # (t,), not the method of tuples
    free: FloatArray  # (k, 3) of background ones: log pace, 1 / its spread, rate
    most: int  # eights of a cell
    course_rate: float
    background_visits: float
    own_way_rate: float  # 1/s, at which vehicles leave what they follow and go their own way
    step_s: float


@inlined
def weigh_eight(
    of: SingleArray, often: SingleArray, east: float, north: float, heading: float, slowed: float, scale: float,
    log_pace: float, out: SingleArray,
) -> None:  # fmt: skip
    """A loop of vector instructions of eight rounds: its length comes from `out`, or it would be unrolled instead."""
    for k in range(out.size):
        off = fma(-of[TURNS_N + k], north, fma(-of[TURNS_E + k], east, heading - of[HEADS + k]))
        off = fma(-_TWO_PI, (off * _PER_TWO_PI + _ROUND) - _ROUND, off)
        off *= slowed * of[BY_COURSE + k]
        pace = fma(-of[GAIN_N + k], north, fma(-of[GAIN_E + k], east, log_pace - of[PACE + k]))
        pace *= of[BY_PACE + k]
        u = fma(of[COSINE + k], east, of[SINE + k] * north)
        across = fma(of[COSINE + k], north, -of[SINE + k] * east)
        across -= fma(fma(of[PATH_2 + k], u, of[PATH_1 + k]), u, of[PATH_0 + k])
        across *= of[BY_PATH + k]
        q = fma(fma(off, off, fma(pace, pace, across * across)), _PER_DEGREES, _ONE)
        out[k] = scale * often[k] / ((q * q) * (q * q))


@inlined
def weigh_candidates(
    may: Candidates, cell: int, stands: bool, x: float, y: float, direction: float, speed: float, rate: int,
    favour: FloatArray, cumulative: SingleArray,
) -> float:  # fmt: skip
    """How often each manoeuvre of a cell is driven, times how well course, pace and path fit it; -> their sum.

    Fills the cumulative sums of these weights, (m, LANES). How well is the density of the manoeuvre divided by the
    background one: Student's t of three variables with `DEGREES` of freedom, for a vehicle that fits none well still
    follows the road. Under a cue they are weighed by how well they fit it too: the product of Eq. 4.
    """
    extent = may.center[cell, 2]
    east = single(min(max(x - may.center[cell, 0], -extent), extent))
    north = single(min(max(y - may.center[cell, 1], -extent), extent))
    heading, slowed, log_pace = single(direction), single(min(speed, 1.0)), single(log(speed + CREEP))
    scale = _ONE if stands else slowed  # the normaliser of what `slowed` widens; who stands has no course to fit
    first, last = may.begin[2 * cell + stands], may.begin[2 * cell + stands + 1]
    total = _NOTHING
    for b in range(first, last):
        eight, often = cumulative[b - first], may.field[b, rate : rate + LANES]
        weigh_eight(may.field[b], often, east, north, heading, slowed, scale, log_pace, eight)
        for k in range(LANES if favour.size else 0):
            eight[k] *= single(favour[may.number[b, k]])
        for k in range(LANES):
            total += eight[k]
            eight[k] = total
    return float(total)


@inlined
def take_up(
    table: MotionTable, before: int, cell: int, x: float, y: float, direction: float, speed: float, rate: int,
    weight: SingleArray, state: UIntArray,
) -> int:  # fmt: skip
    """A manoeuvre of the cell by how often it is driven and how well it fits, or a background one.

    `before` and `cell` are -1 for none. `BY_TIME` weighs manoeuvres by how long they are driven, as found at any
    instant, `BY_VISITS` by how often they are entered. `weight` is room, (most, LANES).
    """
    stands, total, free = speed < STANDING_BELOW, 0.0, table.background_visits
    if cell >= 0:
        total = weigh_candidates(table.candidates, cell, stands, x, y, direction, speed, rate, table.favour, weight)
        free *= table.favour[-1] if table.favour.size else 1.0
    share = free / (total + free)
    drawn = random.uniform(state)
    if total > 0.0 and drawn >= share:
        may, at = table.candidates, 2 * cell + stands
        first, last = may.begin[at], may.begin[at + 1]
        k = chosen(weight[: last - first], (drawn - share) / (1.0 - share) * total)
        return may.number[first + k // LANES, k % LANES]
    if before >= 0 and (table.row[before, STARTS] > 0.0) == stands:
        return before
    return leave_places(table, before, speed, state)


@inlined
def chosen(cumulative: SingleArray, left: float) -> int:
    """The first of (m, LANES) cumulative weights that exceeds `left`, an even draw from below the last of them."""
    k, most = 0, single(left)  # counted: where a search would stop the processor guesses wrong
    for b in range(len(cumulative)):
        eight = cumulative[b]
        for lane in range(eight.size):
            k += eight[lane] <= most
    return min(k, cumulative.size - 1)


@inlined
def follow(table: MotionTable, before: int, low: int, high: int, stands: bool, less: float, state: UIntArray) -> int:
    """The manoeuvre, of those of a kind from `low` to `high`, that follows another, by counts; -1 where none was seen.

    And so often, `less` of each count, for what was not seen: each is drawn against those before it.
    """
    after, total = -1, 0.0
    for t in range(table.first[before], table.first[before + 1]):
        z, count = table.following[t], table.count[t]
        if low <= z < high and (table.row[z, STARTS] > 0.0) == stands:
            favour = table.favour[z] if table.favour.size else 1.0
            total += count * favour
            drawn = random.uniform(state) * total
            if drawn < count * favour:
                after = z if drawn < (count - less) * favour else -1
    return after


@inlined
def leave_places(table: MotionTable, before: int, speed: float, state: UIntArray) -> int:
    """A background manoeuvre: that which follows another such, or else any of about that speed."""
    first, last, stands, after = table.begin[-1], len(table.row), speed < STANDING_BELOW, -1
    if before >= first:
        after = follow(table, before, first, last, stands, 0.0, state)
    if after < 0:
        pace, total, after = log(speed + CREEP), 0.0, last - 1
        for z in range(first, last):
            if (table.row[z, STARTS] > 0.0) == stands:
                off = (pace - table.free[z - first, 0]) * table.free[z - first, 1]
                often = table.free[z - first, 2] * exp(-0.5 * off * off)
                total += often
                if random.uniform(state) * total < often:
                    after = z
    return after


@inlined
def offset_from(row: FloatArray, z: int, x: float, y: float) -> tuple[float, float]:
    """Metres east and north of the centre of a manoeuvre's cell, as far as its fields go."""
    extent = row[z, EXTENT]
    return min(max(x - row[z, EAST], -extent), extent), min(max(y - row[z, NORTH], -extent), extent)


@inlined
def acceleration_of(row: FloatArray, z: int, east: float, north: float, speed: float, push: float) -> float:
    """m/s^2, of a vehicle in motion by a manoeuvre at such an offset."""
    return row[z, A_0] + row[z, A_E] * east + row[z, A_N] * north + row[z, A_V] * speed + row[z, PUSH] * push


@inlined
def course_at(row: FloatArray, z: int, x: float, y: float) -> float:
    """The course of a manoeuvre at a place."""
    east, north = offset_from(row, z, x, y)
    return float(row[z, COURSE] + row[z, BEND_E] * east + row[z, BEND_N] * north)


@inlined
def keep_deviation(table: MotionTable, before: int, after: int, x: float, y: float, direction: float) -> float:
    """The direction of a particle that turns with the course of its manoeuvre: what it keeps is how it deviates."""
    row = table.row
    if row[before, RETURNS] * row[after, RETURNS] > 0.0:
        direction += course_at(row, after, x, y) - course_at(row, before, x, y)
        direction -= 2.0 * math.pi * math.floor(direction / (2.0 * math.pi) + 0.5)
    return direction
