"""Compiled: how a vehicle goes on along a journey that a map remembers.

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
from dirprim_filter.distributions._elementary import EXACT, cos, sin
from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.primitives._candidates import find, room_for
from dirprim_filter.primitives._likening import (
    COURSE,
    CREEP,
    DURATION,
    EAST,
    GAIN,
    NO_ROW,
    NORTH,
    PACE,
    TURN,
    JourneyTable,
)
from tessellation.arrays import BoolArray, FloatArray, IntArray

FASTER = 3.0
"""Nobody goes more than so many times faster or slower along a journey than it went itself."""


class Decay(NamedTuple):
    """What a step of one length does to deviations: the share that is kept, and the spread that comes in."""

    direction_kept: float
    direction_noise: float
    turned_kept: float  # of a vehicle on a journey of another place
    turned_noise: float
    speed_kept: float
    speed_noise: float  # share of the speed
    hurried_noise: float  # m/s, of a vehicle on a journey of another place
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
        table.turning * math.sqrt(h),
        speed_kept,
        table.speed_spread * math.sqrt(1.0 - speed_kept * speed_kept),
        table.hurrying * math.sqrt((1.0 - speed_kept * speed_kept) / (2.0 * table.speed_rate)),
        math.sqrt(12.0 * table.drift * h),
        1.0 - math.exp(-table.forget_rate * h),
    )


@njit(cache=True, inline="always")
def go_along(
    table: JourneyTable, h: float, speed: float, row: int, since: float
) -> tuple[float, float, float, float, float, float, int, float, bool]:
    """A step of `h` seconds along a journey, as much faster than it as `speed` is higher.

    Returns:
        its way east and north; its direction and speed before, and after; the row, the seconds since it, and whether it
        has ended.
    """
    r = row if row > NO_ROW else -2 - row
    pace = max(table.row[r, PACE] + table.row[r, GAIN] * since, 0.0)
    course = table.row[r, COURSE] + table.row[r, TURN] * since
    left = h * min(max((speed + CREEP) / (pace + CREEP), 1.0 / FASTER), FASTER)
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
    course_later = table.row[r, COURSE] + table.row[r, TURN] * since
    pace_later = max(table.row[r, PACE] + table.row[r, GAIN] * since, 0.0)
    return east, north, course, pace, course_later, pace_later, r if row > NO_ROW else -2 - r, since, ended


@njit(inline="always", **EXACT)
def wrapped(angle: float) -> float:
    """The angle in [-pi, pi)."""
    return angle - 2.0 * math.pi * np.floor(angle / (2.0 * math.pi) + 0.5)


@njit(inline="always", **EXACT)
def turned_later(decay: Decay, elsewhere: float, turned: float, speed: float, turning: float) -> float:
    """How far a vehicle is turned from its journey after a step; `elsewhere` is 1 on one of another place, else 0."""
    kept = decay.direction_kept + elsewhere * (decay.turned_kept - decay.direction_kept)
    noise = decay.direction_noise + elsewhere * (decay.turned_noise - decay.direction_noise)
    return turned * kept + noise * min(speed, 1.0) * turning


@njit(inline="always", **EXACT)
def speed_later(decay: Decay, elsewhere: float, speed: float, pace: float, pace_later: float, hurrying: float) -> float:
    """Its speed after a step in which its journey's went from `pace` to `pace_later`."""
    noise = decay.speed_noise * (pace_later + CREEP) + elsewhere * decay.hurried_noise
    return max(pace_later + (speed - pace) * decay.speed_kept + noise * hurrying, 0.0)


@njit(cache=True, inline="always")
def follow(
    table: JourneyTable, decay: Decay, h: float, direction: float, speed: float, row: int, since: float,
    turning: float, hurrying: float,
) -> tuple[float, float, float, float, int, float, bool]:  # fmt: skip
    """A step of `h` seconds: the way east and north, direction, speed, row, seconds since it, and whether it ended."""
    east, north, course, pace, course_later, pace_later, r, since, ended = go_along(table, h, speed, row, since)
    elsewhere, turned = 1.0 if row < NO_ROW else 0.0, wrapped(direction - course)
    later = turned_later(decay, elsewhere, turned, speed, turning)
    s, c = sin(0.5 * (turned + later)), cos(0.5 * (turned + later))
    speed = speed_later(decay, elsewhere, speed, pace, pace_later, hurrying)
    return c * east - s * north, s * east + c * north, wrapped(course_later + later), speed, r, since, ended


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
    state, found = np.empty(4, np.uint64), room_for(table)
    for i in range(len(start)):
        random.seed_state(key[i], state)
        for p in range(path.shape[1]):
            x, y, direction, speed = start[i, 0], start[i, 1], start[i, 2], start[i, 3]
            row, since = find(table, x, y, direction, speed, but[i], 0.0, found, state)
            before = 0.0
            for t in range(time_s.size):
                n = math.ceil((time_s[t] - before) / step_s - 1e-9)
                h = (time_s[t] - before) / n
                decay = decay_over(table, h)
                for _ in range(n):
                    if random.uniform(state) < decay.forgets:
                        row, since = find(table, x, y, direction, speed, but[i], 0.0, found, state)
                    turning, hurrying = random.draw_normal(state), random.draw_normal(state)
                    east, north, direction, speed, row, since, ended = follow(
                        table, decay, h, direction, speed, row, since, turning, hurrying
                    )
                    x += east + decay.drift * (random.uniform(state) - 0.5)
                    y += north + decay.drift * (random.uniform(state) - 0.5)
                    if ended:
                        row, since = find(table, x, y, direction, speed, but[i], 0.0, found, state)
                before = time_s[t]
                path[i, p, t, 0], path[i, p, t, 1] = x, y


@njit(cache=True)
def thin(new: BoolArray, time_ns: IntArray, interval_ns: int, keep: BoolArray) -> None:
    """Keep rows of a vehicle at least `interval_ns` apart. (n,) whether a row is its vehicle's first, (n,) -> (n,)."""
    last = 0
    for i in range(new.size):
        keep[i] = new[i] or time_ns[i] - last >= interval_ns
        if keep[i]:
            last = time_ns[i]
