"""Compiled: how particles move by manoeuvres.

A particle holds a manoeuvre and a push, its own acceleration beside the manoeuvre's. Its direction deviates from the
manoeuvre's course; deviation and push are Ornstein-Uhlenbeck processes that outlive a change of manoeuvre, so a slow
driver stays slow. Where it enters a cell, stops or starts, it changes to another manoeuvre.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._elementary import EXACT, cos, sin
from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.primitives._manoeuvres import (
    A_0,
    A_E,
    A_N,
    A_V,
    BEND_E,
    BEND_N,
    COURSE,
    CURVATURE,
    EAST,
    EXTENT,
    KEEPS,
    LONGER,
    NORTH,
    PUSH,
    STANDING_BELOW,
    STARTS,
    TURNING,
    MotionTable,
    go_over,
    keep_deviation,
    leave_places,
    take_up,
)
from dirprim_filter.primitives.motion import JUMP_S
from tessellation._kernels import locate, locate_all

STARTS_AT = 0.31
"""m/s: a vehicle that starts no longer stands."""
STANDS_STILL = 0.4
"""Share of the drift that a vehicle keeps which stands."""


class Step(NamedTuple):
    """What a step of a given time keeps and adds."""

    h: float  # s
    course_kept: float  # of a deviation from the course
    push_kept: float
    turned_by: float  # standard deviations, in those of the manoeuvre
    pushed_by: float
    root: float  # of h: a place-free course is a random walk
    drift: float  # m, range of an even draw


# Rows of the room in which a block of particles moves.
(GAINED, OFF, STRETCH, TURN_E, TURN_N, TURN_0, BACK, NOISE, MOVED_E, MOVED_N, BEFORE) = range(11)
PIECES, BLOCK = 11, 256


@njit(**EXACT)
def step_of(table: MotionTable, h: float) -> Step:
    """A step of `h` seconds."""
    course_kept, push_kept = math.exp(-table.course_rate * h), math.exp(-table.push_rate * h)
    turned_by, pushed_by = math.sqrt(1.0 - course_kept * course_kept), math.sqrt(1.0 - push_kept * push_kept)
    return Step(h, course_kept, push_kept, turned_by, pushed_by, math.sqrt(h), math.sqrt(12.0 * table.drift * h))


@njit(nogil=True, **EXACT)
def move(
    table: MotionTable, position: FloatArray, direction: FloatArray, speed: FloatArray, cell: IntArray,
    manoeuvre: IntArray, push: FloatArray, led: FloatArray, dt_s: float, state: UIntArray,
) -> None:  # fmt: skip
    """Move (n,) particles of one vehicle by `dt_s`, in steps of at most `step_s`; see `MotionTable`.

    `led` is (n, 3), the response to leaders: an acceleration, the share that the manoeuvre's own acceleration and start
    rate keep, and a start rate; or (0, 3) without leaders.
    """
    n, weight = speed.size, np.empty(table.most)
    n_steps = max(1, math.ceil(dt_s / table.step_s - 1e-9))
    step = step_of(table, dt_s / n_steps)
    redraws, jumps = 1.0 - math.exp(-table.redraw_rate * step.h), 1.0 - math.exp(-step.h / JUMP_S)
    due = np.array([random.draw_gap(redraws, state), random.draw_gap(jumps, state)])
    normal, even, room = np.empty(2 * n), np.empty(2 * n), np.empty((PIECES, BLOCK))
    for _ in range(n_steps):
        random.fill_normals(normal, state)
        random.fill_even(even, state)  # over some steps a drift is normal whatever each step's is
        for first in range(0, n, BLOCK):
            last = min(first + BLOCK, n)
            _gather(table, step, position, direction, speed, manoeuvre, push, led, first, last, room)
            _advance(
                step, direction[first:last], speed[first:last], push[first:last], normal[first:], normal[n + first :],
                even[first:], even[n + first :], room,
            )  # fmt: skip
            _change(
                table, step.h, position, direction, speed, cell, manoeuvre, led, first, last, room, redraws, jumps,
                due, weight, state,
            )  # fmt: skip


@njit(**EXACT)
def _gather(
    table: MotionTable, step: Step, position: FloatArray, direction: FloatArray, speed: FloatArray,
    manoeuvre: IntArray, push: FloatArray, led: FloatArray, first: int, last: int, room: FloatArray,
) -> None:  # fmt: skip
    """What each particle's manoeuvre says at its place: here memory is waited for, so that the next loop need not."""
    is_led = len(led) > 0
    for p in range(first, last):
        row, i, v = table.row[manoeuvre[p]], p - first, speed[p]
        extent, moves = row[EXTENT], 0.0 if row[STARTS] > 0.0 else 1.0
        east = min(max(position[p, 0] - row[EAST], -extent), extent)
        north = min(max(position[p, 1] - row[NORTH], -extent), extent)
        gained = row[A_0] + row[A_E] * east + row[A_N] * north + row[A_V] * v + row[PUSH] * push[p]
        if is_led:
            gained = led[p, 0] + led[p, 1] * gained
        room[GAINED, i] = moves * gained
        room[OFF, i] = direction[p] - row[COURSE] - row[BEND_E] * east - row[BEND_N] * north
        room[STRETCH, i] = moves * (1.0 + row[LONGER])
        room[TURN_E, i], room[TURN_N, i], room[TURN_0, i] = row[BEND_E], row[BEND_N], row[CURVATURE]
        keeps = row[KEEPS]  # 1 for a place-free manoeuvre, which has no course to come back to
        room[BACK, i] = moves * (1.0 - keeps) * (1.0 - step.course_kept)
        wanders = step.turned_by + keeps * (step.root - step.turned_by)
        room[NOISE, i] = moves * row[TURNING] * wanders * min(v, 1.0)
        room[BEFORE, i] = v


@njit(**EXACT)
def _advance(
    step: Step, direction: FloatArray, speed: FloatArray, push: FloatArray, turned: FloatArray, pushed: FloatArray,
    strayed_east: FloatArray, strayed_north: FloatArray, room: FloatArray,
) -> None:  # fmt: skip
    """Turn, accelerate and push (n,) particles on, and fill how far each goes: a loop of vector instructions.

    Who stands neither turns nor accelerates.
    """
    gained, off, stretch = room[GAINED], room[OFF], room[STRETCH]
    turn_e, turn_n, turn_0 = room[TURN_E], room[TURN_N], room[TURN_0]
    back, noise, moved_e, moved_n = room[BACK], room[NOISE], room[MOVED_E], room[MOVED_N]
    for i in range(speed.size):
        v, theta = speed[i], direction[i]
        later = max(v + step.h * gained[i], 0.0)
        way = 0.5 * step.h * (v + later) * stretch[i]
        c, s = cos(theta), sin(theta)
        deviation = off[i] - 2.0 * math.pi * math.floor(off[i] / (2.0 * math.pi) + 0.5)
        turn = (turn_e[i] * c + turn_n[i] * s + turn_0[i]) * way - back[i] * deviation + noise[i] * turned[i]
        half = 0.5 * turn
        strays = step.drift * min(max(v, STANDS_STILL), 1.0)
        moved_e[i] = way * (c - half * (s + 0.5 * half * c)) + strays * strayed_east[i]
        moved_n[i] = way * (s + half * (c - 0.5 * half * s)) + strays * strayed_north[i]
        theta += turn
        direction[i] = theta - 2.0 * math.pi * math.floor(theta / (2.0 * math.pi) + 0.5)
        speed[i] = later
        push[i] = push[i] * step.push_kept + step.pushed_by * pushed[i]


@njit(**EXACT)
def _change(
    table: MotionTable, h: float, position: FloatArray, direction: FloatArray, speed: FloatArray, cell: IntArray,
    manoeuvre: IntArray, led: FloatArray, first: int, last: int, room: FloatArray, redraws: float, jumps: float,
    due: IntArray, weight: FloatArray, state: UIntArray,
) -> None:  # fmt: skip
    """Put particles where they go, and change the manoeuvres of those that enter a cell, stop, start or are due.

    due: (2,) how many particles until the next redraw, and until the next jump.
    """
    redraw, jump, is_led = due[0], due[1], len(led) > 0
    rows, begin, here = table.row, table.begin, np.empty(BLOCK, np.int64)
    for p in range(first, last):
        position[p, 0] += room[MOVED_E, p - first]
        position[p, 1] += room[MOVED_N, p - first]
    locate_all(table.locator, position[first:last], here)
    for p in range(first, last):
        before, now, x, y = manoeuvre[p], here[p - first], position[p, 0], position[p, 1]
        starts = rows[before, STARTS]
        if is_led and starts > 0.0:
            starts = led[p, 2] + led[p, 1] * starts
        if starts > 0.0 and random.uniform(state) < starts * h:
            speed[p] = STARTS_AT
        later = speed[p]
        redrawn, jumped = redraw == 0, jump == 0
        redraw = random.draw_gap(redraws, state) if redrawn else redraw - 1
        jump = random.draw_gap(jumps, state) if jumped else jump - 1
        if redrawn:
            manoeuvre[p] = take_up(
                table, -1, now, x, y, direction[p], later, True, table.place_free_share, weight, state
            )
        elif now != cell[p] or (room[BEFORE, p - first] < STANDING_BELOW) != (later < STANDING_BELOW):
            manoeuvre[p] = go_over(table, before, now, x, y, direction[p], later, weight, state)
            keep_deviation(table, before, manoeuvre[p], position[p], direction, p)
        elif jumped and rows[before, KEEPS] == 1.0:
            manoeuvre[p] = leave_places(table, before, later, weight, state)
        elif jumped and not (now >= 0 and begin[now] <= before < begin[now + 1]):
            manoeuvre[p] = take_up(table, -1, now, x, y, direction[p], later, True, 0.0, weight, state)
        cell[p] = now
    due[0], due[1] = redraw, jump


@njit(nogil=True, **EXACT)
def initialise_motion(
    table: MotionTable, position: FloatArray, direction: FloatArray, speed: FloatArray, cell: IntArray,
    manoeuvre: IntArray, push: FloatArray, state: UIntArray,
) -> None:  # fmt: skip
    """Draw for (n,) particles a manoeuvre that fits them and a push, and look up their cell."""
    weight = np.empty(table.most)
    for p in range(speed.size):
        push[p] = random.draw_normal(state)
        cell[p] = locate(table.locator, position[p, 0], position[p, 1])
        manoeuvre[p] = take_up(
            table, -1, cell[p], position[p, 0], position[p, 1], direction[p], speed[p], True,
            table.place_free_share, weight, state,
        )  # fmt: skip


@njit(nogil=True, **EXACT)
def rollout(table: MotionTable, start: FloatArray, dt_s: FloatArray, key: UIntArray, path: FloatArray) -> None:
    """Rollouts of vehicles. (n, 4) place, direction, speed; (n_steps,) seconds; (n,) keys; fills (n, p, n_steps, 2)."""
    n = path.shape[1]
    position, direction, speed, push = np.empty((n, 2)), np.empty(n), np.empty(n), np.empty(n)
    cell, manoeuvre, state = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(4, np.uint64)
    alone = np.empty((0, 3))
    for i in range(len(start)):
        random.seed_state(key[i], state)
        position[:, 0], position[:, 1], direction[:], speed[:] = start[i, 0], start[i, 1], start[i, 2], start[i, 3]
        initialise_motion(table, position, direction, speed, cell, manoeuvre, push, state)
        for t in range(dt_s.size):
            move(table, position, direction, speed, cell, manoeuvre, push, alone, dt_s[t], state)
            for p in range(n):  # a slice assigned to a slice would compile numba's strings for its error
                path[i, p, t, 0], path[i, p, t, 1] = position[p, 0], position[p, 1]
