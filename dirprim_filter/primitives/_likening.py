"""Compiled: how like remembered journeys a vehicle's motion is, and where those stand that may be like it."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dirprim_filter.distributions._elementary import single, squared_sine
from tessellation.arrays import FloatArray, IntArray

PIXEL_M = 2.0
"""Side of the squares by which journeys are found: each knows all rows that may be like a vehicle in it."""
MOST_PIXELS = 1_000_000
"""Where positions are far apart, squares are larger."""
FARTHEST_M = 6.0
"""Across the way and along it, from further than which a journey is not found, alike or not."""
LONGEST_M = 100.0
"""Of the way from a row to the next, what is found."""
LATERAL_M, DIRECTION, SPEED, SPEED_SHARE = 1.5, 0.12, 0.5, 0.15
"""How far apart two vehicles are alike: across the way, in direction, and in speed (m/s, and as a share of it)."""
FARTHEST = 18.0
"""Squared distance, in those units, beyond which a journey is not like a vehicle at all."""
CREEP = 0.5
"""m/s, added where speeds are compared by their ratio, so that standing vehicles are alike."""
SECTORS = 8
"""Of directions, by which the rows of a square stand."""
_SECTOR = 2.0 * math.pi / SECTORS
_SECTOR_CHORD = 2.0 * math.sin(0.5 * _SECTOR)  # of directions that far apart
NO_ROW = -1
# Columns of `JourneyTable.row`, eight numbers to a row: a line of the cache.
COURSE, PACE, TURN, GAIN, DURATION, EAST, NORTH, VEHICLE = range(8)
# Columns of `JourneyTable.place`.
X, Y, COSINE, SINE, REACH, SLOWNESS = range(6)
NOBODY = -1.0
NOWHERE = ANY_DIRECTION = -1
# In single precision, which every double takes as it is: `apart` then works in the precision of what it is given.
_ZERO, _HALF, BEYOND = single(0.0), single(0.5), single(2.0 * FARTHEST)


class JourneyTable(NamedTuple):
    """Journeys as the kernels take them."""

    row: FloatArray  # (n, 8) direction, speed, their rates of change, seconds to the next row, velocity, vehicle
    place: FloatArray  # (n, 6) position, cosine and sine of the direction, metres to the next row, seconds per metre
    first_steady: int  # row of the journey that stands, and those straight on after it
    slower: IntArray  # (k,) how many rows are slower than 0, 1, 2, ... k - 1 steps of speed
    by_speed: IntArray  # (m,) the rows that are not their journey's last, in order of speed
    origin_x: float
    origin_y: float
    per_metre: float  # squares
    first: IntArray  # (n_x n_y SECTORS + 1,) those of a square and sector are `member[first:next first]`
    member: IntArray  # rows that may be like a vehicle in a square
    n_x: int
    n_y: int
    most_alike: int  # rows of a square
    nearness: float  # scale of the units in which vehicles are alike
    strength: float  # so many alike journeys weigh as much as all those of other places
    direction_rate: float  # 1/s
    speed_rate: float  # 1/s
    direction_spread: float  # radians
    speed_spread: float  # share of the speed
    drift: float  # m^2/s
    forget_rate: float  # 1/s
    turning: float  # radians in the square root of a second, of who follows a journey of another place
    hurrying: float  # m/s, likewise


@njit(cache=True, inline="always")
def sector_of(direction: float) -> int:
    """Which eighth of the circle a direction is in: 0 begins east."""
    return math.floor(direction * (SECTORS / (2.0 * math.pi))) % SECTORS


class Members(NamedTuple):
    """Where the rows stand that may be like a motion: those that its square knows, of about its direction."""

    n: int
    first: int
    n_first: int  # of them; the others follow `other`
    other: int


class Scale(NamedTuple):
    """What a motion's distances are measured by."""

    lateral: float  # 1/m^2
    turned: float
    faster: float  # (s/m)^2


@njit(cache=True, inline="always")
def square_of(table: JourneyTable, x: float, y: float, direction: float, speed: float) -> tuple[int, int]:
    """The square of a place, and the first of the three sectors of a direction; or `NOWHERE`, or `ANY_DIRECTION`."""
    column, line = (x - table.origin_x) * table.per_metre, (y - table.origin_y) * table.per_metre
    if table.strength == np.inf or not (0.0 <= column < table.n_x and 0.0 <= line < table.n_y):
        return NOWHERE, ANY_DIRECTION
    sector = ANY_DIRECTION
    if min(speed, 1.0) * _SECTOR_CHORD > math.sqrt(FARTHEST) * DIRECTION * table.nearness:
        sector = sector_of(direction - _SECTOR)  # no row of a direction further off is alike
    return int(column) * table.n_y + int(line), sector


@njit(cache=True, inline="always")
def members_of(table: JourneyTable, square: int, sector: int) -> Members:
    """The candidates of a square and sector."""
    if square == NOWHERE:
        return Members(0, 0, 0, 0)
    begin, low, high = SECTORS * square, 0, SECTORS
    if sector != ANY_DIRECTION:
        low, high = sector, sector + 3
    first, other = table.first[begin + low], table.first[begin]
    n_first = table.first[begin + min(high, SECTORS)] - first
    n_other = table.first[begin + max(high - SECTORS, 0)] - other
    return Members(n_first + n_other, first, n_first, other - n_first)


@njit(cache=True, inline="always")
def scale_of(table: JourneyTable, speed: float) -> Scale:
    """The units in which a vehicle of this speed is alike: who stands has no direction."""
    across, along = LATERAL_M * table.nearness, table.nearness * (SPEED + SPEED_SHARE * speed)
    turned = min(speed, 1.0) / (DIRECTION * table.nearness)
    return Scale(1.0 / (across * across), turned * turned, 1.0 / (along * along))


@njit(cache=True, inline="always")
def apart(
    lateral: float, faster: float, east: float, north: float, cosine: float, sine: float, reach: float, slowness: float,
    course: float, pace: float, turn: float, gain: float, direction: float, speed: float,
) -> tuple[float, float, float]:  # fmt: skip
    """How far a motion, `east` and `north` of a row, is from the journey from it.

    Returns:
        the squared distance but for directions, half the angle between these, and how many seconds after the row.
    """
    along = east * cosine + north * sine
    is_beside = (along >= _ZERO) & (along < reach)
    ahead = along * slowness if is_beside else _ZERO
    across = north * cosine - east * sine - _HALF * turn * ahead * along
    rest = along - ahead * pace
    off = speed - pace - gain * ahead
    distance = off * off * faster + (across * across + rest * rest) * lateral
    is_passed = (not is_beside) & (pace > 2.0 * CREEP)  # the row before, or the one after, is nearer
    return (BEYOND if is_passed else distance), _HALF * (direction - course - turn * ahead), ahead


@njit(cache=True, inline="always")
def distance_to(
    table: JourneyTable, scale: Scale, r: int, x: float, y: float, direction: float, speed: float
) -> tuple[float, float]:
    """Squared distance of a motion to the journey from row `r`, and how many seconds after it."""
    row, place = table.row[r], table.place[r]
    distance, half, ahead = apart(
        scale.lateral, scale.faster, x - place[X], y - place[Y], place[COSINE], place[SINE], place[REACH],
        place[SLOWNESS], row[COURSE], row[PACE], row[TURN], row[GAIN], direction, speed,
    )  # fmt: skip
    return distance + 4.0 * squared_sine(half) * scale.turned, ahead


@njit(cache=True)
def cover(
    place: FloatArray, sector: IntArray, goes_on: IntArray, origin: FloatArray, pixel: float, n_x: int, n_y: int,
    reach: float, first: IntArray, member: IntArray,
) -> None:  # fmt: skip
    """Tell each square the rows whose way to their next is within `reach` metres of a place in it.

    Args:
        place: (n, 6) `JourneyTable.place`.
        sector: (n,) of each row's direction.
        goes_on: (m,) the rows that have a next.
        origin: (2,) metres.
        pixel: metres, side of a square.
        n_x: squares eastward.
        n_y: squares northward.
        reach: metres.
        first: (n_x n_y SECTORS + 1,) is filled, if `member` is empty, with how many rows each square and sector has,
            one place further on; else it is where the next row of each stands, and moves on.
        member: is filled.
    """
    beside = 0.71 * pixel  # from the middle of a square to its corner
    for r in goes_on:
        x, y, c, s = place[r, X] - origin[0], place[r, Y] - origin[1], place[r, COSINE], place[r, SINE]
        length, ends = min(place[r, REACH], LONGEST_M), beside
        if 1.0 / place[r, SLOWNESS] <= 2.0 * CREEP:
            ends += reach  # it may be like what is before it or past it
        side = ends + reach
        low_x, high_x = min(x, x + length * c) - side, max(x, x + length * c) + side
        low_y, high_y = min(y, y + length * s) - side, max(y, y + length * s) + side
        for i in range(max(math.floor(low_x / pixel), 0), min(math.floor(high_x / pixel) + 1, n_x)):
            for j in range(max(math.floor(low_y / pixel), 0), min(math.floor(high_y / pixel) + 1, n_y)):
                dx, dy = (i + 0.5) * pixel - x, (j + 0.5) * pixel - y
                along = dx * c + dy * s
                if -ends <= along <= length + ends and abs(dy * c - dx * s) <= reach + beside:
                    square = SECTORS * (i * n_y + j) + sector[r]
                    if member.size:
                        member[first[square]] = r
                        first[square] += 1
                    else:
                        first[square + 1] += 1
