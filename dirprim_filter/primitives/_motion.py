"""Compiled: how particles move by manoeuvres.

A particle holds a manoeuvre and a push, its own acceleration beside the manoeuvre's. Its direction deviates from the
manoeuvre's course; deviation and push are Ornstein-Uhlenbeck processes that outlive a change of manoeuvre, so who
drives slowly goes on slowly. Where it enters a cell, stops or starts, it goes over to another manoeuvre.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._elementary import EXACT, cos, exp, log, sin
from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.primitives.motion import CREEP, JUMP_S
from tessellation._kernels import Locator, locate
from tessellation.arrays import FloatArray, IntArray

# Columns of `MotionTable.row`.
(EAST, NORTH, EXTENT, COURSE, BEND_E, BEND_N, A_0, A_E, A_N, A_V, PUSH, TURNING, KEEPS, LONGER, STARTS, PACE, GAIN_E,
 GAIN_N, PATH_0, PATH_1, PATH_2, COSINE, SINE, BY_COURSE, BY_PACE, BY_PATH, SCALE, VISITS, SECONDS, AHEAD,
 MODE, CURVATURE) = range(32)  # fmt: skip
N_COLUMNS = 32
STANDING_BELOW = 0.3
STARTS_AT = 0.31
"""m/s: a vehicle that starts no longer stands."""
DEGREES = 5.0
"""Of freedom: (DEGREES + 3) / 2 is the power in `fit`."""
STANDS_STILL = 0.4
"""Share of the drift that a vehicle keeps which stands."""
DISCOUNT = 0.2
"""Of each count of transitions (Ney, Essen and Kneser 1994): what was seen once may well be something else."""


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
def fit(row: FloatArray, x: float, y: float, direction: float, speed: float, log_pace: float) -> float:
    """How well course, pace and path fit a manoeuvre: the density, by that of vehicles of no place.

    Student's t of three numbers and `DEGREES` of freedom: who fits no manoeuvre well still follows the road.
    """
    extent = row[EXTENT]
    east, north = min(max(x - row[EAST], -extent), extent), min(max(y - row[NORTH], -extent), extent)
    off = direction - row[COURSE] - row[BEND_E] * east - row[BEND_N] * north
    off -= 2.0 * math.pi * math.floor(off / (2.0 * math.pi) + 0.5)
    off *= min(speed, 1.0) * row[BY_COURSE]
    pace = (log_pace - row[PACE] - row[GAIN_E] * east - row[GAIN_N] * north) * row[BY_PACE]
    u, across = row[COSINE] * east + row[SINE] * north, row[COSINE] * north - row[SINE] * east
    across = (across - row[PATH_0] - row[PATH_1] * u - row[PATH_2] * u * u) * row[BY_PATH]
    q = 1.0 + (off * off + pace * pace + across * across) / DEGREES
    return float(row[SCALE] / (q * q * q * q))


@njit(cache=True)
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
    a, b, total, log_pace = 0, 0, 0.0, log(speed + CREEP)
    if cell >= 0:
        a, b = table.begin[cell], table.begin[cell + 1]
    for z in range(a, b):
        weight[z - a] = 0.0
        if (table.row[z, STARTS] > 0.0) == stands:
            fits = fit(table.row[z], x, y, direction, speed, log_pace)
            weight[z - a] = table.row[z, SECONDS if by_time else VISITS] * fits
            total += weight[z - a]
    share = table.strength / (total + table.strength)
    if total > 0.0 and random.uniform(state) >= max(share, least):
        left = random.uniform(state) * total
        for z in range(a, b):
            left -= weight[z - a]
            if left < 0.0:
                return z
    if before >= 0 and (table.row[before, STARTS] > 0.0) == stands:
        return before
    return leave_places(table, before, speed, weight, state)


@njit(cache=True)
def leave_places(table: MotionTable, before: int, speed: float, weight: FloatArray, state: UIntArray) -> int:
    """A place-free manoeuvre: that which follows another such, or else any of about that speed."""
    n_placed, stands, total = table.begin[-1], speed < STANDING_BELOW, 0.0
    if before >= n_placed:
        for t in range(table.first[before], table.first[before + 1]):
            if (table.row[table.following[t], STARTS] > 0.0) == stands:
                total += table.count[t]
        left = random.uniform(state) * total
        for t in range(table.first[before], table.first[before + 1]):
            if (table.row[table.following[t], STARTS] > 0.0) == stands:
                left -= table.count[t]
                if left < 0.0:
                    return table.following[t]
    total, pace = 0.0, log(speed + CREEP)
    for z in range(n_placed, len(table.row)):
        row = table.row[z]
        weight[z - n_placed] = 0.0
        if (row[STARTS] > 0.0) == stands:
            off = (pace - row[PACE]) * row[BY_PACE]
            weight[z - n_placed] = row[SECONDS] * row[BY_PACE] * exp(max(-0.5 * off * off, -50.0))
            total += weight[z - n_placed]
    left = random.uniform(state) * total
    for z in range(n_placed, len(table.row)):
        left -= weight[z - n_placed]
        if left < 0.0:
            return z
    return len(table.row) - 1


@njit(cache=True)
def go_over(
    table: MotionTable, before: int, cell: int, x: float, y: float, direction: float, speed: float, weight: FloatArray,
    state: UIntArray,
) -> int:  # fmt: skip
    """The manoeuvre that follows another in the cell entered: by counts, or backing off to any that fits there."""
    stands, n, kinds = speed < STANDING_BELOW, 0.0, 0.0
    if cell >= 0 and before < table.begin[-1]:
        a, b = table.begin[cell], table.begin[cell + 1]
        for t in range(table.first[before], table.first[before + 1]):
            z = table.following[t]
            if a <= z < b and (table.row[z, STARTS] > 0.0) == stands:
                n += table.count[t]
                kinds += DISCOUNT
        left = random.uniform(state) * n
        if n > 0.0 and left < n - kinds:
            for t in range(table.first[before], table.first[before + 1]):
                z = table.following[t]
                if a <= z < b and (table.row[z, STARTS] > 0.0) == stands:
                    left -= table.count[t] - DISCOUNT
                    if left < 0.0:
                        return z
    return take_up(table, before, cell, x, y, direction, speed, False, 0.0, weight, state)


@njit(nogil=True, **EXACT)
def move(
    table: MotionTable, position: FloatArray, direction: FloatArray, speed: FloatArray, cell: IntArray,
    manoeuvre: IntArray, push: FloatArray, led: FloatArray, dt_s: float, state: UIntArray,
) -> None:  # fmt: skip
    """Move (n,) particles of one vehicle by `dt_s`, in steps of at most `step_s`; see `MotionTable`.

    `led` is (n, 3), what a leader has each do: its acceleration, the share that its manoeuvre's own acceleration and
    start rate keep, and a start rate; or (0, 3) where nobody has a leader.
    """
    is_led = len(led) > 0
    n, weight = speed.size, np.empty(table.most)
    n_steps = max(1, math.ceil(dt_s / table.step_s - 1e-9))
    h = dt_s / n_steps
    course_kept, push_kept = math.exp(-table.course_rate * h), math.exp(-table.push_rate * h)
    turned_by, pushed_by = math.sqrt(1.0 - course_kept * course_kept), math.sqrt(1.0 - push_kept * push_kept)
    root, drift = math.sqrt(h), math.sqrt(12.0 * table.drift * h)
    redraws = 1.0 - math.exp(-table.redraw_rate * h)
    normal, even = np.empty(2 * n), np.empty(2 * n)
    jumps = 1.0 - math.exp(-h / JUMP_S)
    redraw, jump = random.draw_gap(redraws, state), random.draw_gap(jumps, state)
    for _ in range(n_steps):
        random.fill_normals(normal, state)
        random.fill_even(even, state)  # over some steps a drift is normal whatever each step's is
        for p in range(n):
            row = table.row[manoeuvre[p]]
            x, y, theta, v = position[p, 0], position[p, 1], direction[p], speed[p]
            east = min(max(x - row[EAST], -row[EXTENT]), row[EXTENT])
            north = min(max(y - row[NORTH], -row[EXTENT]), row[EXTENT])
            stood = v < STANDING_BELOW
            if row[STARTS] > 0.0:
                later, way = v, 0.0
                starts = row[STARTS]
                if is_led:
                    starts = led[p, 2] + led[p, 1] * starts
                if random.uniform(state) < starts * h:
                    later = STARTS_AT
            else:
                gained = row[A_0] + row[A_E] * east + row[A_N] * north + row[A_V] * v + row[PUSH] * push[p]
                if is_led:
                    gained = led[p, 0] + led[p, 1] * gained
                later = max(v + h * gained, 0.0)
                way = 0.5 * h * (v + later) * (1.0 + row[LONGER])
            c, s = cos(theta), sin(theta)
            turn = (row[BEND_E] * c + row[BEND_N] * s + row[CURVATURE]) * way
            off = theta - row[COURSE] - row[BEND_E] * east - row[BEND_N] * north
            off -= 2.0 * math.pi * math.floor(off / (2.0 * math.pi) + 0.5)
            keeps = row[KEEPS]  # 1 for a place-free manoeuvre, which has no course to come back to
            turn -= (1.0 - keeps) * (1.0 - course_kept) * off
            turn += row[TURNING] * (turned_by + keeps * (root - turned_by)) * min(v, 1.0) * normal[p]
            if row[STARTS] > 0.0:
                turn = 0.0  # who stands keeps its direction
            push[p] = push[p] * push_kept + pushed_by * normal[n + p]
            half = 0.5 * turn
            strays = drift * min(max(v, STANDS_STILL), 1.0)
            x += way * (c - half * (s + 0.5 * half * c)) + strays * even[p]
            y += way * (s + half * (c - 0.5 * half * s)) + strays * even[n + p]
            theta += turn
            position[p, 0], position[p, 1] = x, y
            direction[p] = theta - 2.0 * math.pi * math.floor(theta / (2.0 * math.pi) + 0.5)
            speed[p] = later
            here = locate(table.locator, x, y)
            redrawn, jumped = redraw == 0, jump == 0
            redraw = random.draw_gap(redraws, state) if redrawn else redraw - 1
            jump = random.draw_gap(jumps, state) if jumped else jump - 1
            before = manoeuvre[p]
            if redrawn:
                manoeuvre[p] = take_up(
                    table, -1, here, x, y, direction[p], later, True,
                    table.place_free_share, weight, state,
                )  # fmt: skip
            elif here != cell[p] or stood != (later < STANDING_BELOW):
                manoeuvre[p] = go_over(table, before, here, x, y, direction[p], later, weight, state)
                keep_deviation(table, before, manoeuvre[p], position[p], direction, p)
            elif jumped and keeps == 1.0:
                manoeuvre[p] = leave_places(table, before, later, weight, state)
            elif jumped and not (here >= 0 and table.begin[here] <= before < table.begin[here + 1]):
                manoeuvre[p] = take_up(table, -1, here, x, y, direction[p], later, True, 0.0, weight, state)
            cell[p] = here


@njit(cache=True)
def course_at(row: FloatArray, x: float, y: float) -> float:
    """The course of a manoeuvre at a place."""
    extent = row[EXTENT]
    east, north = min(max(x - row[EAST], -extent), extent), min(max(y - row[NORTH], -extent), extent)
    return float(row[COURSE] + row[BEND_E] * east + row[BEND_N] * north)


@njit(cache=True)
def keep_deviation(
    table: MotionTable, before: int, after: int, place: FloatArray, direction: FloatArray, p: int
) -> None:
    """Turn a particle with the course of its manoeuvre: what it keeps is how it deviates."""
    one, other = table.row[before], table.row[after]
    if one[KEEPS] + other[KEEPS] + one[STARTS] + other[STARTS] == 0.0:
        turned = direction[p] + course_at(other, place[0], place[1])
        turned -= course_at(one, place[0], place[1])
        direction[p] = turned - 2.0 * math.pi * math.floor(turned / (2.0 * math.pi) + 0.5)


@njit(cache=True, nogil=True)
def settle(
    table: MotionTable, position: FloatArray, direction: FloatArray, speed: FloatArray, cell: IntArray,
    manoeuvre: IntArray, push: FloatArray, state: UIntArray,
) -> None:  # fmt: skip
    """Give (n,) particles the cell of their place, a manoeuvre that fits them, and a push."""
    weight = np.empty(table.most)
    for p in range(speed.size):
        push[p] = random.draw_normal(state)
        cell[p] = locate(table.locator, position[p, 0], position[p, 1])
        manoeuvre[p] = take_up(
            table, -1, cell[p], position[p, 0], position[p, 1], direction[p], speed[p], True,
            table.place_free_share, weight, state,
        )  # fmt: skip


@njit(cache=True, nogil=True)
def rollout(table: MotionTable, start: FloatArray, dt_s: FloatArray, key: UIntArray, path: FloatArray) -> None:
    """Futures of vehicles. (n, 4) place, direction, speed; (n_steps,) seconds; (n,) keys; fills (n, p, n_steps, 2)."""
    n = path.shape[1]
    position, direction, speed, push = np.empty((n, 2)), np.empty(n), np.empty(n), np.empty(n)
    cell, manoeuvre, state = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(4, np.uint64)
    alone = np.empty((0, 3))
    for i in range(len(start)):
        random.seed_state(key[i], state)
        position[:, 0], position[:, 1], direction[:], speed[:] = start[i, 0], start[i, 1], start[i, 2], start[i, 3]
        settle(table, position, direction, speed, cell, manoeuvre, push, state)
        for t in range(dt_s.size):
            move(table, position, direction, speed, cell, manoeuvre, push, alone, dt_s[t], state)
            for p in range(n):  # a slice assigned to a slice would compile numba's strings for its error
                path[i, p, t, 0], path[i, p, t, 1] = position[p, 0], position[p, 1]
