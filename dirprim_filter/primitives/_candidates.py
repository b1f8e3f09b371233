"""Compiled: which of the journeys that a vehicle's motion is like it goes on along."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._elementary import SUMMING, exp, exp_single, single, squared_sine_single
from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.primitives._likening import (
    COSINE,
    COURSE,
    DURATION,
    FARTHEST,
    GAIN,
    NO_ROW,
    NOBODY,
    PACE,
    REACH,
    SINE,
    SLOWNESS,
    TURN,
    VEHICLE,
    JourneyTable,
    Members,
    Scale,
    X,
    Y,
    apart,
    distance_to,
    members_of,
    scale_of,
    square_of,
)
from tessellation.arrays import FloatArray, IntArray

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
BLOCK = 16
"""Candidates stand in blocks, the last filled up with some that nothing is like: so many are weighed at once."""
_UNLIKE_PACE = 1e6  # m/s
_MINUS_HALF, _NOTHING, _FARTHEST = single(-0.5), single(0.0), single(FARTHEST)

# Rows of `Candidates.at`: what stands in the table, places from the first vehicle's; seconds after it where a motion
# is beside it; the motion's weight; and the sum of those of each block.
(
    AT_X, AT_Y, AT_COSINE, AT_SINE, AT_REACH, AT_SLOWNESS, AT_COURSE, AT_PACE, AT_TURN, AT_GAIN, SINCE, WEIGHT,
    BLOCK_WEIGHT,
) = range(13)  # fmt: skip


class Candidates(NamedTuple):
    """Rows of journeys that may be like some vehicles, laid out side by side.

    Single precision tells places to micrometres within a square, and takes half the time: weights err by 1e-5.
    """

    row: IntArray  # (n,)
    at: npt.NDArray[np.float32]  # (13, n)


@njit(cache=True)
def room_for(table: JourneyTable) -> Candidates:
    """Room for the candidates of any motion."""
    n = -(-table.most_alike // BLOCK) * BLOCK
    return Candidates(np.empty(n, np.int64), np.empty((13, n), np.float32))


@njit(cache=True)
def gather(table: JourneyTable, of: Members, x: float, y: float, but: float, found: Candidates) -> int:
    """Lay out the members of a square, but for journeys of vehicle `but`, places from (x, y). -> blocks."""
    n, at = 0, found.at
    for a in range(of.n):
        r = table.member[a + (of.first if a < of.n_first else of.other)]
        row, place = table.row[r], table.place[r]
        if row[VEHICLE] != but:
            found.row[n], at[AT_X, n], at[AT_Y, n] = r, place[X] - x, place[Y] - y
            at[AT_COSINE, n], at[AT_SINE, n] = place[COSINE], place[SINE]
            at[AT_REACH, n], at[AT_SLOWNESS, n] = place[REACH], place[SLOWNESS]
            at[AT_COURSE, n], at[AT_PACE, n] = row[COURSE], row[PACE]
            at[AT_TURN, n], at[AT_GAIN, n] = row[TURN], row[GAIN]
            n += 1
    n_blocks = -(-n // BLOCK)
    at[:BLOCK_WEIGHT, n : n_blocks * BLOCK] = 0.0
    at[AT_PACE, n : n_blocks * BLOCK] = _UNLIKE_PACE
    return n_blocks


@njit(**SUMMING)
def weigh(
    scale: Scale, n_blocks: int, east: float, north: float, direction: float, speed: float, at: npt.NDArray[np.float32]
) -> float:
    """How like gathered journeys a motion is, e^{-d^2 / 2} for a distance d: several at a time. -> the total.

    The motion is `east` and `north` of where their places are from.
    """
    x, y, course, pace = single(east), single(north), single(direction), single(speed)
    lateral, faster, turned = single(scale.lateral), single(scale.faster), single(4.0 * scale.turned)
    for a in range(n_blocks * BLOCK):
        distance, half, at[SINCE, a] = apart(
            lateral, faster, x - at[AT_X, a], y - at[AT_Y, a], at[AT_COSINE, a], at[AT_SINE, a], at[AT_REACH, a],
            at[AT_SLOWNESS, a], at[AT_COURSE, a], at[AT_PACE, a], at[AT_TURN, a], at[AT_GAIN, a], course, pace,
        )  # fmt: skip
        distance += squared_sine_single(half) * turned
        at[WEIGHT, a] = exp_single(_MINUS_HALF * distance) if distance <= _FARTHEST else _NOTHING
    total = 0.0
    for block in range(n_blocks):
        weight = _NOTHING
        for a in range(block * BLOCK, (block + 1) * BLOCK):
            weight += at[WEIGHT, a]
        at[BLOCK_WEIGHT, block] = weight
        total += weight
    return total


@njit(cache=True)
def chosen(n_blocks: int, left: float, at: npt.NDArray[np.float32]) -> int:
    """The candidate at which the weights so far come to more than `left`."""
    block = 0
    while block < n_blocks - 1 and left >= at[BLOCK_WEIGHT, block]:
        left -= at[BLOCK_WEIGHT, block]
        block += 1
    a = block * BLOCK
    for a in range(block * BLOCK, n_blocks * BLOCK):
        left -= at[WEIGHT, a]
        if left < 0.0:
            break
    while at[WEIGHT, a] == 0.0:  # by rounding
        a -= 1
    return a


@njit(cache=True)
def look_around(
    table: JourneyTable, x: float, y: float, direction: float, speed: float, but: float, found: Candidates
) -> tuple[int, float]:
    """All candidates for a motion, weighed: blocks of them, and the total of their weights."""
    square, sector = square_of(table, x, y, direction, speed)
    n_blocks = gather(table, members_of(table, square, sector), x, y, but, found)
    return n_blocks, weigh(scale_of(table, speed), n_blocks, 0.0, 0.0, direction, speed, found.at)


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


@njit(cache=True, inline="always")
def take_up(
    table: JourneyTable, n_blocks: int, total: float, found: Candidates, speed: float, but: float, state: UIntArray
) -> tuple[int, float]:
    """One of the weighed journeys, or one of another place: the row, and the seconds since it."""
    left = random.uniform(state) * (total + table.strength)
    if left >= total:
        row, since = anywhere(table, speed, but, state)
    else:
        a = chosen(n_blocks, left, found.at)
        row, since = found.row[a], float(found.at[SINCE, a])
    return row, since


@njit(cache=True)
def find(
    table: JourneyTable, x: float, y: float, direction: float, speed: float, but: float, strange: float,
    found: Candidates, state: UIntArray,
) -> tuple[int, float]:  # fmt: skip
    """A row of a journey like this motion, and the seconds since it; of another place with probability `strange`.

    Von Neumann's rejection: a candidate at random is taken with the probability of its weight, so that few of them are
    looked at. If none is taken for long, all are looked at, which draws by the same law.
    """
    square, sector = square_of(table, x, y, direction, speed)
    of, scale, row, since = members_of(table, square, sector), scale_of(table, speed), NO_ROW, 0.0
    elsewhere = random.uniform(state) < strange
    for _ in range(MOST_TRIES):
        drawn, chance = random.uniform(state) * (of.n + table.strength), random.uniform(state)
        elsewhere |= not drawn < of.n
        if elsewhere:
            break
        a = int(drawn)
        r = table.member[a + (of.first if a < of.n_first else of.other)]
        distance, ahead = distance_to(table, scale, r, x, y, direction, speed)
        if distance <= FARTHEST and chance < exp(-0.5 * distance) and table.row[r, VEHICLE] != but:
            row, since = r, ahead
            break
    if elsewhere:
        row, since = anywhere(table, speed, but, state)
    elif row == NO_ROW:
        n_blocks, total = look_around(table, x, y, direction, speed, but, found)
        row, since = take_up(table, n_blocks, total, found, speed, but, state)
    return row, since


@njit(cache=True)
def find_all(
    table: JourneyTable, looking: IntArray, position: FloatArray, direction: FloatArray, speed: FloatArray,
    row: IntArray, since: FloatArray, strange: float, found: Candidates, state: UIntArray,
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
        x, y = position[looking[0], 0], position[looking[0], 1]
        here, toward = square_of(table, x, y, direction[looking[0]], speed[looking[0]])
        n_blocks, others = gather(table, members_of(table, here, toward), x, y, NOBODY, found), 0
        for p in looking[:left]:
            square, sector = square_of(table, position[p, 0], position[p, 1], direction[p], speed[p])
            if square == here and sector == toward:
                scale = scale_of(table, speed[p])
                east, north = position[p, 0] - x, position[p, 1] - y
                total = weigh(scale, n_blocks, east, north, direction[p], speed[p], found.at)
                row[p], since[p] = take_up(table, n_blocks, total, found, speed[p], NOBODY, state)
            else:
                looking[others] = p
                others += 1
        left = others
