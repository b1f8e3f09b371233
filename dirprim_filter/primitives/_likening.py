"""Compiled: which remembered journeys a vehicle's motion is like, and which of them it goes on along."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._elementary import exp, squared_sine
from dirprim_filter.distributions._random import UIntArray
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
NEARBY_SPEEDS = 0.025
"""Share of all rows, to either side in order of speed, among which a journey of another place is drawn."""
SPEEDS_PER_MPS, MOST_SPEEDS = 20.0, 2000
"""So finely, and so many, speeds are told apart where a journey of another place is drawn."""
STEADY_SHARE = 0.15
"""Of those that follow a journey of another place, who goes straight on at an even speed instead: in the log of a
roundabout nobody does."""
SLOWEST_STEADY, STEADY_RATIO, N_STEADY = 0.25, 1.12, 50
"""m/s, of the first such journey after the one that stands; ratio from one to the next; and how many: up to 65 m/s."""

MOST_TRIES = 8
"""Of `find`, before it looks at all candidates."""
SECTORS = 8
"""Of directions, by which the rows of a square stand."""
_SECTOR = 2.0 * math.pi / SECTORS
_SECTOR_DISTANCE = 4.0 * math.sin(0.5 * _SECTOR) ** 2  # of directions that far apart
NO_ROW = -1
# Columns of `JourneyTable.row`, eight numbers to a row: a line of the cache.
COURSE, PACE, TURN, GAIN, DURATION, EAST, NORTH, VEHICLE = range(8)
# Columns of `JourneyTable.place`.
X, Y, COSINE, SINE, REACH, SLOWNESS = range(6)
# Rows of what `gather` lays out: the number of a row of a journey, what stands there of it, the seconds since it where
# a motion is beside it, and the motion's weight.
(
    FOUND, AT_X, AT_Y, AT_COSINE, AT_SINE, AT_REACH, AT_SLOWNESS, AT_COURSE, AT_PACE, AT_TURN, AT_GAIN, SINCE, WEIGHT,
) = range(13)  # fmt: skip
N_LAID_OUT = 13
NOBODY = -1.0
BEYOND = 2.0 * FARTHEST


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


class Around(NamedTuple):
    """Where the rows are that may be like a motion, and the scales of its distances to them."""

    n: int
    first: int
    n_first: int  # of them; the others follow `other`
    other: int
    lateral: float  # 1/m^2
    turned: float
    faster: float  # (s/m)^2


@njit(cache=True, inline="always")
def around(table: JourneyTable, x: float, y: float, direction: float, speed: float) -> Around:
    """The candidates for a motion: the rows that its square knows, of about its direction."""
    lateral = 1.0 / (LATERAL_M * table.nearness) ** 2
    turned = (min(speed, 1.0) / (DIRECTION * table.nearness)) ** 2
    faster = 1.0 / (table.nearness * (SPEED + SPEED_SHARE * speed)) ** 2
    column, line = (x - table.origin_x) * table.per_metre, (y - table.origin_y) * table.per_metre
    if table.strength == np.inf or not (0.0 <= column < table.n_x and 0.0 <= line < table.n_y):
        return Around(0, 0, 0, 0, lateral, turned, faster)
    begin = SECTORS * (int(column) * table.n_y + int(line))
    low, high = 0, SECTORS
    if turned * _SECTOR_DISTANCE > FARTHEST:  # no row of a direction further off is alike
        low = sector_of(direction - _SECTOR)
        high = low + 3
    first, other = table.first[begin + low], table.first[begin]
    n_first = table.first[begin + min(high, SECTORS)] - first
    n_other = table.first[begin + max(high - SECTORS, 0)] - other
    return Around(n_first + n_other, first, n_first, other - n_first, lateral, turned, faster)


@njit(cache=True, inline="always")
def distance_of(
    near: Around, east: float, north: float, cosine: float, sine: float, reach: float, slowness: float, course: float,
    pace: float, turn: float, gain: float, direction: float, speed: float,
) -> tuple[float, float]:  # fmt: skip
    """Squared distance of a motion, `east` and `north` of a row, to the journey from it, and how many seconds after."""
    along = east * cosine + north * sine
    is_beside = (along >= 0.0) & (along < reach)
    ahead = along * slowness if is_beside else 0.0
    across = north * cosine - east * sine - 0.5 * turn * ahead * along
    rest = along - ahead * pace
    off = speed - pace - gain * ahead
    half = 0.5 * (direction - course - turn * ahead)
    distance = off * off * near.faster + (across * across + rest * rest) * near.lateral
    distance += 4.0 * squared_sine(half) * near.turned
    is_passed = (not is_beside) & (pace > 2.0 * CREEP)  # the row before, or the one after, is nearer
    return (BEYOND if is_passed else distance), ahead


@njit(cache=True, inline="always")
def distance_to(
    table: JourneyTable, near: Around, r: int, x: float, y: float, direction: float, speed: float
) -> tuple[float, float]:
    """The same of row `r`."""
    row, place = table.row[r], table.place[r]
    return distance_of(
        near, x - place[X], y - place[Y], place[COSINE], place[SINE], place[REACH], place[SLOWNESS], row[COURSE],
        row[PACE], row[TURN], row[GAIN], direction, speed,
    )  # fmt: skip


@njit(cache=True)
def gather(table: JourneyTable, near: Around, but: float, alike: FloatArray) -> int:
    """Lay out the candidates, but for journeys of vehicle `but`, side by side in `alike`. -> how many."""
    n = 0
    for a in range(near.n):
        r = table.member[a + (near.first if a < near.n_first else near.other)]
        row, place = table.row[r], table.place[r]
        if row[VEHICLE] != but:
            alike[FOUND, n], alike[AT_X, n], alike[AT_Y, n] = r, place[X], place[Y]
            alike[AT_COSINE, n], alike[AT_SINE, n] = place[COSINE], place[SINE]
            alike[AT_REACH, n], alike[AT_SLOWNESS, n] = place[REACH], place[SLOWNESS]
            alike[AT_COURSE, n], alike[AT_PACE, n] = row[COURSE], row[PACE]
            alike[AT_TURN, n], alike[AT_GAIN, n] = row[TURN], row[GAIN]
            n += 1
    return n


@njit(cache=True, fastmath={"reassoc", "contract"}, error_model="numpy")
def weigh(near: Around, n: int, x: float, y: float, direction: float, speed: float, alike: FloatArray) -> float:
    """How like the gathered journeys a motion is, e^{-d^2 / 2} for a distance d: several at a time. -> the total."""
    since, weight, total = alike[SINCE], alike[WEIGHT], 0.0
    for a in range(n):
        distance, since[a] = distance_of(
            near, x - alike[AT_X, a], y - alike[AT_Y, a], alike[AT_COSINE, a], alike[AT_SINE, a], alike[AT_REACH, a],
            alike[AT_SLOWNESS, a], alike[AT_COURSE, a], alike[AT_PACE, a], alike[AT_TURN, a], alike[AT_GAIN, a],
            direction, speed,
        )  # fmt: skip
        weight[a] = exp(-0.5 * distance) if distance <= FARTHEST else 0.0
    for a in range(n):
        total += weight[a]
    return total


@njit(cache=True)
def look_around(
    table: JourneyTable, x: float, y: float, direction: float, speed: float, but: float, alike: FloatArray
) -> tuple[int, float]:
    """All candidates for a motion, laid out in `alike`, and the total of their weights."""
    near = around(table, x, y, direction, speed)
    n = gather(table, near, but, alike)
    return n, weigh(near, n, x, y, direction, speed, alike)


@njit(cache=True, inline="always")
def anywhere(table: JourneyTable, speed: float, but: float, state: UIntArray) -> tuple[int, float]:
    """A journey of any place at about this speed, or one straight on."""
    if random.uniform(state) < STEADY_SHARE:
        k = 0
        if speed > SLOWEST_STEADY:
            k = min(1 + int(math.log(speed / SLOWEST_STEADY) / math.log(STEADY_RATIO) + 0.5), N_STEADY)
        return -2 - (table.first_steady + 2 * k), 0.0
    low = table.slower[int(min(speed * SPEEDS_PER_MPS, table.slower.size - 1.0))]
    reach = 1.0 + NEARBY_SPEEDS * table.by_speed.size
    row = 0
    for _ in range(8):  # of one vehicle alone there is no other
        at = low + math.floor((2.0 * random.uniform(state) - 1.0) * reach)
        row = table.by_speed[min(max(at, 0), table.by_speed.size - 1)]
        if table.row[row, VEHICLE] != but:
            break
    return -2 - row, random.uniform(state) * table.row[row, DURATION]


@njit(cache=True)
def take_up(
    table: JourneyTable, n: int, total: float, alike: FloatArray, speed: float, but: float, state: UIntArray
) -> tuple[int, float]:
    """One of the journeys that `look_around` found, or one of another place: the row, and the seconds since it."""
    left = random.uniform(state) * (total + table.strength)
    if left >= total:
        return anywhere(table, speed, but, state)
    chosen = 0
    for a in range(n):
        if alike[WEIGHT, a] > 0.0:
            chosen = a
            if left < alike[WEIGHT, a]:
                break
            left -= alike[WEIGHT, a]
    return int(alike[FOUND, chosen]), alike[SINCE, chosen]


@njit(cache=True, inline="always")
def find(
    table: JourneyTable, x: float, y: float, direction: float, speed: float, but: float, strange: float,
    alike: FloatArray, state: UIntArray,
) -> tuple[int, float]:  # fmt: skip
    """A row of a journey like this motion, and the seconds since it; of another place with probability `strange`.

    Von Neumann's rejection: a candidate at random is taken with the probability of its weight, so that few of them are
    looked at. If none is taken for long, all are looked at, which draws by the same law.
    """
    near, row, since = around(table, x, y, direction, speed), NO_ROW, 0.0
    elsewhere = random.uniform(state) < strange
    for _ in range(MOST_TRIES):
        drawn, chance = random.uniform(state) * (near.n + table.strength), random.uniform(state)
        elsewhere |= not drawn < near.n
        if elsewhere:
            break
        a = int(drawn)
        r = table.member[a + (near.first if a < near.n_first else near.other)]
        distance, ahead = distance_to(table, near, r, x, y, direction, speed)
        if distance <= FARTHEST and chance < exp(-0.5 * distance) and table.row[r, VEHICLE] != but:
            row, since = r, ahead
            break
    if elsewhere:
        row, since = anywhere(table, speed, but, state)
    elif row == NO_ROW:
        n, total = look_around(table, x, y, direction, speed, but, alike)
        row, since = take_up(table, n, total, alike, speed, but, state)
    return row, since


@njit(cache=True)
def find_all(
    table: JourneyTable, looking: IntArray, position: FloatArray, direction: FloatArray, speed: FloatArray,
    row: IntArray, since: FloatArray, strange: float, alike: FloatArray, state: UIntArray,
) -> None:  # fmt: skip
    """A journey for each particle of a vehicle that is looking for one, as by `find`; fills `row` and `since`.

    They are near each other: who has the same candidates as the first is served with it, and so on with the rest.
    """
    left = 0
    for p in looking:
        if random.uniform(state) < strange:
            row[p], since[p] = anywhere(table, speed[p], NOBODY, state)
        else:
            looking[left] = p
            left += 1
    while left > 0:
        p = looking[0]
        of = around(table, position[p, 0], position[p, 1], direction[p], speed[p])
        n, others = gather(table, of, NOBODY, alike), 0
        for p in looking[:left]:
            x, y, course, pace = position[p, 0], position[p, 1], direction[p], speed[p]
            near = around(table, x, y, course, pace)
            if near.first == of.first and near.n == of.n and near.other == of.other:
                total = weigh(near, n, x, y, course, pace, alike)
                row[p], since[p] = take_up(table, n, total, alike, pace, NOBODY, state)
            else:
                looking[others] = p
                others += 1
        left = others


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
