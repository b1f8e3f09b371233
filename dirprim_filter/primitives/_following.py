"""Compiled: which remembered journeys a vehicle's motion is like, and how it goes on along one of them.

A vehicle that follows a journey holds the number of a row of it and the seconds since that row. Its direction and speed
deviate from the journey's by Ornstein-Uhlenbeck processes, whose steps are exact however time is cut; it goes the
journey's way turned by its deviation, and as much faster along it as its speed is higher.

A vehicle that follows a journey of another place, because nothing like it was seen here, holds -2 less the row's
number: its direction deviates for good, so the way it goes is the journey's turned to its own.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._elementary import exp
from dirprim_filter.distributions._random import UIntArray
from tessellation.arrays import BoolArray, FloatArray, IntArray

PIXEL_M = 4.0
"""Side of the squares by which journeys are found: those of a square and of the eight around it are looked at."""
MOST_PIXELS = 4_000_000
"""Where positions are far apart, squares are larger."""
LATERAL_M, DIRECTION, SPEED, SPEED_SHARE = 1.5, 0.12, 0.5, 0.15
"""How far apart two vehicles are alike: across the way, in direction, and in speed (m/s, and as a share of it)."""
FARTHEST = 18.0
"""Squared distance, in those units, beyond which a journey is not like a vehicle at all."""
CREEP = 0.5
"""m/s, added where speeds are compared by their ratio, so that standing vehicles are alike."""
NEARBY_SPEEDS = 0.025
"""Share of all rows, to either side in order of speed, among which a journey of another place is drawn."""
STEADY_SHARE = 0.15
"""Of those that follow a journey of another place, who goes straight on at an even speed instead: in the log of a
roundabout nobody does."""
SLOWEST_STEADY, STEADY_RATIO, N_STEADY = 0.25, 1.12, 50
"""m/s, of the first such journey after the one that stands; ratio from one to the next; and how many: up to 65 m/s."""
FASTER = 3.0
"""Nobody goes more than so many times faster or slower along a journey than it went itself."""

SECTORS = 8
"""Of directions, by which the rows of a square stand."""
_SECTOR = 2.0 * math.pi / SECTORS
_SECTOR_DISTANCE = 4.0 * math.sin(0.5 * _SECTOR) ** 2  # of directions that far apart
_LOW_HALF, _HALF, _TO_UNIT = np.uint64(0xFFFFFFFF), np.uint64(32), 2.0**-32
NO_ROW = -1
# Columns of `JourneyTable.row`, eight numbers to a row: a line of the cache.
COURSE, PACE, TURN, GAIN, DURATION, EAST, NORTH, VEHICLE = range(8)
# Columns of `JourneyTable.candidate`.
X, Y, COSINE, SINE, REACH, OF_PACE, OF_TURN, OF_GAIN, OF_COURSE, OF_VEHICLE, OF_ROW = range(11)


class JourneyTable(NamedTuple):
    """Journeys as the kernels take them."""

    row: FloatArray  # (n, 8) direction, speed, their rates of change, seconds to the next row, velocity, vehicle
    first_steady: int  # row of the journey that stands, and those straight on after it
    by_speed: IntArray  # (m,) the rows that are not their journey's last, in order of speed
    origin_x: float
    origin_y: float
    per_metre: float  # squares
    first: IntArray  # (n_x n_y SECTORS + 1,) the rows of a square and sector are `candidate[first:next first]`
    candidate: FloatArray  # (m, 11) what `find` looks at of a row, in the order in which it does
    n_x: int
    n_y: int
    most_alike: int  # rows in three by three squares
    nearness: float  # scale of the units in which vehicles are alike
    strength: float  # so many alike journeys weigh as much as all those of other places
    direction_rate: float  # 1/s
    speed_rate: float  # 1/s
    direction_spread: float  # radians
    speed_spread: float  # share of the speed
    drift: float  # m^2/s
    forget_rate: float  # 1/s
    place_free_turning: float  # radians in the square root of a second


class Decay(NamedTuple):
    """What a step of one length does to deviations: the share that is kept, and the spread that comes in."""

    direction_kept: float
    direction_noise: float
    turned_kept: float  # of a vehicle on a journey of another place
    turned_noise: float
    speed_kept: float
    speed_noise: float
    drift: float  # metres, the width of an even draw
    forgets: float  # probability to look for another journey


@njit(cache=True, inline="always")
def decay_over(table: JourneyTable, h: float) -> Decay:
    """The constants of a step of `h` seconds."""
    direction_kept, speed_kept = math.exp(-table.direction_rate * h), math.exp(-table.speed_rate * h)
    return Decay(
        direction_kept,
        table.direction_spread * math.sqrt(1.0 - direction_kept * direction_kept),
        1.0,
        table.place_free_turning * math.sqrt(h),
        speed_kept,
        table.speed_spread * math.sqrt(1.0 - speed_kept * speed_kept),
        math.sqrt(12.0 * table.drift * h),
        1.0 - math.exp(-table.forget_rate * h),
    )


@njit(cache=True, inline="always")
def sector_of(direction: float) -> int:
    """Which eighth of the circle a direction is in: 0 begins east."""
    return math.floor(direction * (SECTORS / (2.0 * math.pi))) % SECTORS


@njit(cache=True)
def look_around(
    table: JourneyTable, x: float, y: float, direction: float, speed: float, but: float, alike: FloatArray
) -> tuple[int, float]:
    """How many rows are like this motion, and their total weight, e^{-d^2 / 2} each for a distance d.

    Fills the first rows of `alike` (most_alike, 3): row, seconds since it, weight. Journeys of vehicle `but` are passed
    over.
    """
    n, total, far = 0, 0.0, 2.0**31  # from everywhere
    if table.strength == np.inf or not (abs(x) < far and abs(y) < far):
        return n, total
    column, line = (
        math.floor((x - table.origin_x) * table.per_metre),
        math.floor((y - table.origin_y) * table.per_metre),
    )
    lateral = 1.0 / (LATERAL_M * table.nearness) ** 2
    turned = (min(speed, 1.0) / (DIRECTION * table.nearness)) ** 2
    faster = 1.0 / (table.nearness * (SPEED + SPEED_SHARE * speed)) ** 2
    candidate = table.candidate
    begin, n_sectors = 0, SECTORS
    if turned * _SECTOR_DISTANCE > FARTHEST:  # no row of a direction further off is alike
        begin, n_sectors = sector_of(direction - _SECTOR), 3
    for i in range(max(column - 1, 0), min(column + 2, table.n_x)):
        for j in range(max(line - 1, 0), min(line + 2, table.n_y)):
            for k in range(begin, begin + n_sectors):
                sector = SECTORS * (i * table.n_y + j) + k % SECTORS
                for a in range(table.first[sector], table.first[sector + 1]):
                    dx, dy = x - candidate[a, X], y - candidate[a, Y]
                    c, s = candidate[a, COSINE], candidate[a, SINE]
                    along, pace = dx * c + dy * s, candidate[a, OF_PACE]
                    ahead = 0.0
                    if 0.0 <= along < candidate[a, REACH]:
                        ahead = along / max(pace, CREEP)
                    elif pace > 2.0 * CREEP:
                        continue  # the row before, or the one after, is nearer
                    across = dy * c - dx * s - 0.5 * candidate[a, OF_TURN] * ahead * along
                    rest = along - ahead * pace
                    off = speed - pace - candidate[a, OF_GAIN] * ahead
                    distance = off * off * faster + (across * across + rest * rest) * lateral
                    if distance > FARTHEST:
                        continue
                    half = math.sin(0.5 * (direction - candidate[a, OF_COURSE] - candidate[a, OF_TURN] * ahead))
                    distance += 4.0 * half * half * turned
                    if distance > FARTHEST or candidate[a, OF_VEHICLE] == but:
                        continue
                    weight = exp(-0.5 * distance)
                    alike[n, 0], alike[n, 1], alike[n, 2] = candidate[a, OF_ROW], ahead, weight
                    total += weight
                    n += 1
    return n, total


@njit(cache=True)
def take_up(
    table: JourneyTable, n: int, total: float, alike: FloatArray, speed: float, but: float, state: UIntArray
) -> tuple[int, float]:
    """One of the journeys that `look_around` found, or one of another place: the row, and the seconds since it."""
    left = random.uniform(state) * (total + table.strength)
    if left < total:
        for a in range(n):
            left -= alike[a, 2]
            if left < 0.0:
                return int(alike[a, 0]), alike[a, 1]
    return anywhere(table, speed, but, state)


@njit(cache=True)
def find(
    table: JourneyTable, x: float, y: float, direction: float, speed: float, but: float, alike: FloatArray,
    state: UIntArray,
) -> tuple[int, float]:  # fmt: skip
    """A row of a journey like this motion, and the seconds since it."""
    n, total = look_around(table, x, y, direction, speed, but, alike)
    return take_up(table, n, total, alike, speed, but, state)


@njit(cache=True)
def anywhere(table: JourneyTable, speed: float, but: float, state: UIntArray) -> tuple[int, float]:
    """A journey of any place at about this speed, or one straight on."""
    if random.uniform(state) < STEADY_SHARE:
        k = 0
        if speed > SLOWEST_STEADY:
            k = min(1 + int(math.log(speed / SLOWEST_STEADY) / math.log(STEADY_RATIO) + 0.5), N_STEADY)
        return -2 - (table.first_steady + 2 * k), 0.0
    low, high = 0, table.by_speed.size
    while low < high:
        middle = (low + high) // 2
        if table.row[table.by_speed[middle], PACE] < speed:
            low = middle + 1
        else:
            high = middle
    reach = 1.0 + NEARBY_SPEEDS * table.by_speed.size
    row = 0
    for _ in range(8):  # of one vehicle alone there is no other
        at = low + math.floor((2.0 * random.uniform(state) - 1.0) * reach)
        row = table.by_speed[min(max(at, 0), table.by_speed.size - 1)]
        if table.row[row, VEHICLE] != but:
            break
    return -2 - row, random.uniform(state) * table.row[row, DURATION]


@njit(cache=True, inline="always")
def unit_vector(angle: float) -> tuple[float, float]:
    """Cosine and sine; of small angles, as deviations are, by their series, to 1e-9."""
    if abs(angle) > 0.4:
        return math.cos(angle), math.sin(angle)
    q = angle * angle
    cosine = 1.0 - q * (1.0 / 2.0 - q * (1.0 / 24.0 - q * (1.0 / 720.0 - q * (1.0 / 40320.0))))
    sine = angle * (1.0 - q * (1.0 / 6.0 - q * (1.0 / 120.0 - q * (1.0 / 5040.0 - q * (1.0 / 362880.0)))))
    return cosine, sine


@njit(cache=True, inline="always")
def follow(
    table: JourneyTable, decay: Decay, h: float, direction: float, speed: float, row: int, since: float,
    state: UIntArray,
) -> tuple[float, float, float, float, int, float, bool]:  # fmt: skip
    """A step of `h` seconds: the way east and north, direction, speed, row, seconds since it, and whether it ended."""
    r, kept, noise = row, decay.direction_kept, decay.direction_noise
    if row < NO_ROW:
        r, kept, noise = -2 - row, decay.turned_kept, decay.turned_noise
    pace = max(table.row[r, PACE] + table.row[r, GAIN] * since, 0.0)
    turned = direction - table.row[r, COURSE] - table.row[r, TURN] * since
    if abs(turned) > math.pi:
        turned -= 2.0 * math.pi * math.floor(turned / (2.0 * math.pi) + 0.5)
    faster = min(max((speed + CREEP) / (pace + CREEP), 1.0 / FASTER), FASTER)
    left = h * faster
    east = north = 0.0
    while left > table.row[r, DURATION] - since and table.row[r + 1, DURATION] > 0.0:
        rest = table.row[r, DURATION] - since
        east += table.row[r, EAST] * rest
        north += table.row[r, NORTH] * rest
        left -= rest
        since = 0.0
        r += 1
    east += table.row[r, EAST] * left
    north += table.row[r, NORTH] * left
    since += left
    ended = since > table.row[r, DURATION]
    since = min(since, table.row[r, DURATION])
    later = turned * kept + noise * min(speed, 1.0) * random.draw_normal(state)
    pace_later = max(table.row[r, PACE] + table.row[r, GAIN] * since, 0.0)
    off = (speed - pace) * decay.speed_kept + decay.speed_noise * (pace_later + CREEP) * random.draw_normal(state)
    course = table.row[r, COURSE] + table.row[r, TURN] * since + later
    if abs(course) > math.pi:
        course -= 2.0 * math.pi * math.floor(course / (2.0 * math.pi) + 0.5)
    c, s = unit_vector(0.5 * (turned + later))
    drawn = random.bits(state)  # two even draws at once: over some steps a drift is normal whatever each step's is
    drift_east = float(drawn & _LOW_HALF) * _TO_UNIT - 0.5
    drift_north = float(drawn >> _HALF) * _TO_UNIT - 0.5
    return (
        c * east - s * north + decay.drift * drift_east,
        s * east + c * north + decay.drift * drift_north,
        course,
        max(pace_later + off, 0.0),
        r if row > NO_ROW else -2 - r,
        since,
        ended,
    )


@njit(cache=True, nogil=True)
def hallucinate(
    table: JourneyTable, start: FloatArray, but: FloatArray, time_s: FloatArray, step_s: float, key: UIntArray,
    path: FloatArray,
) -> None:  # fmt: skip
    """Futures along journeys alone. (n, 4) position, direction and speed; fills (n, n_samples, n_times, 2).

    Args:
        table: the journeys.
        start: (n, 4).
        but: (n,) each one's own vehicle, whose journey is not to be followed.
        time_s: (n_times,) ascending.
        step_s: about how long a step is.
        key: (n,) of the random numbers.
        path: is filled.
    """
    state, alike = np.empty(4, np.uint64), np.empty((table.most_alike, 3))
    alike_at_start = np.empty((table.most_alike, 3))
    for i in range(len(start)):
        random.seed_state(key[i], state)
        x, y, direction, speed = start[i, 0], start[i, 1], start[i, 2], start[i, 3]
        n_alike, total = look_around(table, x, y, direction, speed, but[i], alike_at_start)
        for p in range(path.shape[1]):
            x, y, direction, speed = start[i, 0], start[i, 1], start[i, 2], start[i, 3]
            row, since = take_up(table, n_alike, total, alike_at_start, speed, but[i], state)
            before = 0.0
            for t in range(time_s.size):
                n = math.ceil((time_s[t] - before) / step_s - 1e-9)
                h = (time_s[t] - before) / n
                decay = decay_over(table, h)
                for _ in range(n):
                    if random.uniform(state) < decay.forgets:
                        row, since = find(table, x, y, direction, speed, but[i], alike, state)
                    east, north, direction, speed, row, since, ended = follow(
                        table, decay, h, direction, speed, row, since, state
                    )
                    x += east
                    y += north
                    if ended:
                        row, since = find(table, x, y, direction, speed, but[i], alike, state)
                before = time_s[t]
                path[i, p, t, 0], path[i, p, t, 1] = x, y


@njit(cache=True)
def spread_over(first: IntArray, square: IntArray, row: IntArray, member: IntArray) -> None:
    """Fill `first` and `member` of a table from pairs of a square and a row."""
    first[:] = 0
    for a in range(square.size):
        first[square[a] + 1] += 1
    for q in range(first.size - 1):
        first[q + 1] += first[q]
    place = first.copy()
    for a in range(square.size):
        member[place[square[a]]] = row[a]
        place[square[a]] += 1


@njit(cache=True)
def thin(new: BoolArray, time_ns: IntArray, interval_ns: int, keep: BoolArray) -> None:
    """Keep rows of a vehicle at least `interval_ns` apart. (n,) whether a row is its vehicle's first, (n,) -> (n,)."""
    last = 0
    for i in range(new.size):
        keep[i] = new[i] or time_ns[i] - last >= interval_ns
        if keep[i]:
            last = time_ns[i]
