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
    BEND_E,
    BEND_N,
    BY_TIME,
    BY_VISITS,
    COURSE,
    CURVATURE,
    KEEPS,
    LANES,
    LONGER,
    OWN_WAY,
    STANDING_BELOW,
    STARTS,
    TURNING,
    MotionTable,
    SingleArray,
    acceleration_of,
    go_over,
    keep_deviation,
    leave_places,
    offset_from,
    take_up,
)
from dirprim_filter.primitives.motion import JUMP_S, PUSH_RATE
from tessellation._compiling import UNCOUNTED
from tessellation._kernels import locate

STARTS_AT = 0.31
"""m/s: a vehicle that starts no longer stands."""


class Step(NamedTuple):
    """What a step of a given time keeps and adds."""

    h: float  # s
    course_kept: float  # of a deviation from the course
    push_kept: float
    turned_by: float  # standard deviations, in those of the manoeuvre
    pushed_by: float
    root: float  # of h: a background course is a random walk


class Block(NamedTuple):
    """Particles of one vehicle that are moved together."""

    position: FloatArray  # (n, 2)
    direction: FloatArray  # (n,)
    speed: FloatArray  # (n,)
    cell: IntArray  # (n,)
    manoeuvre: IntArray  # (n,)
    push: FloatArray  # (n,)
    led: FloatArray  # (n, 3) or (0, 3), see `move`


# Rows of the room in which a block of particles moves.
(GAINED, OFF, STRETCH, TURN_E, TURN_N, TURN_0, BACK, NOISE, MOVED_E, MOVED_N, BEFORE, STARTING) = range(12)
PIECES, BLOCK = 12, 256


class Due(NamedTuple):
    """Which particles of a block may change their manoeuvre: who passes into another cell, stops or starts; by chance.

    Of those that may by chance, one is drawn from each so many particles (stratified sampling), so that each is as
    probable.
    """

    every: float  # one of so many particles
    leaves: float  # of those due by chance, the share that goes its own way
    next: FloatArray  # (2,) the particle drawn, and the first of those from which the one after it is drawn
    cell: IntArray  # (BLOCK,) where they are now
    which: IntArray  # (2 BLOCK,) those that pass, then those due by chance
    end: IntArray  # (2,) of each kind


@njit(**EXACT)
def step_of(table: MotionTable, h: float) -> Step:
    """A step of `h` seconds."""
    course_kept, push_kept = math.exp(-table.course_rate * h), math.exp(-PUSH_RATE * h)
    turned_by, pushed_by = math.sqrt(1.0 - course_kept * course_kept), math.sqrt(1.0 - push_kept * push_kept)
    return Step(h, course_kept, push_kept, turned_by, pushed_by, math.sqrt(h))


@njit(nogil=True, **EXACT)
def move(
    table: MotionTable, position: FloatArray, direction: FloatArray, speed: FloatArray, cell: IntArray,
    manoeuvre: IntArray, push: FloatArray, led: FloatArray, dt_s: float, state: UIntArray,
) -> None:  # fmt: skip
    """Move (n,) particles of one vehicle by `dt_s`, in steps of at most `step_s`; see `MotionTable`.

    `led` is (n, 3), the response to leaders: an acceleration, the share that the manoeuvre's own acceleration and start
    rate keep, and a start rate; or (0, 3) without leaders.
    """
    n, weight = speed.size, np.empty((table.most, LANES), np.float32)
    n_steps = max(1, math.ceil(dt_s / table.step_s - 1e-9))
    step = step_of(table, dt_s / n_steps)
    due = _due(table, step.h)
    normal, room = np.empty(2 * n), np.empty((PIECES, BLOCK))
    for _ in range(n_steps):
        random.fill_normals(normal, state)
        due.next[0], due.next[1] = random.uniform(state) * due.every, due.every
        for first in range(0, n, BLOCK):
            last = min(first + BLOCK, n)
            block = Block(
                position[first:last], direction[first:last], speed[first:last], cell[first:last],
                manoeuvre[first:last], push[first:last], led[first:last],
            )  # fmt: skip
            _gather(table, step, block, room)
            _advance(step, block, normal[first:], normal[n + first :], room)
            _place(table, step.h, block, room, due, state)
            _change(table, block, due, weight, state)


@njit(**EXACT)
def _due(table: MotionTable, h: float) -> Due:
    """None yet."""
    which, end = np.empty(2 * BLOCK, np.int64), np.empty(2, np.int64)
    every = 1.0 / (1.0 - math.exp(-h / JUMP_S))
    leaves = every * (1.0 - math.exp(-table.own_way_rate * h))
    return Due(every, leaves, np.empty(2), np.empty(BLOCK, np.int64), which, end)


@njit(**EXACT | UNCOUNTED)
def _gather(table: MotionTable, step: Step, block: Block, room: FloatArray) -> None:
    """What each particle's manoeuvre says at its place: here memory is waited for, so that the next loop need not."""
    position, direction, speed, push, led = block.position, block.direction, block.speed, block.push, block.led
    is_led, row, manoeuvre = len(led) > 0, table.row, block.manoeuvre
    for i in range(speed.size):
        z, v = manoeuvre[i], speed[i]
        starts = row[z, STARTS]
        moves = 0.0 if starts > 0.0 else 1.0
        east, north = offset_from(row, z, position[i, 0], position[i, 1])
        gained = acceleration_of(row, z, east, north, v, push[i])
        if is_led:
            gained = led[i, 0] + led[i, 1] * gained
            starts = led[i, 2] + led[i, 1] * starts
        room[GAINED, i], room[STARTING, i] = moves * gained, (1.0 - moves) * starts
        room[OFF, i] = direction[i] - row[z, COURSE] - row[z, BEND_E] * east - row[z, BEND_N] * north
        room[STRETCH, i] = moves * (1.0 + row[z, LONGER])
        room[TURN_E, i], room[TURN_N, i], room[TURN_0, i] = row[z, BEND_E], row[z, BEND_N], row[z, CURVATURE]
        keeps = row[z, KEEPS]  # 1 for a background manoeuvre, which has no course to come back to
        room[BACK, i] = moves * (1.0 - keeps) * (1.0 - step.course_kept)
        wanders = step.turned_by + keeps * (step.root - step.turned_by)
        room[NOISE, i] = moves * row[z, TURNING] * wanders * min(v, 1.0)
        room[BEFORE, i] = v


@njit(**EXACT | UNCOUNTED)
def _advance(step: Step, block: Block, turned: FloatArray, pushed: FloatArray, room: FloatArray) -> None:
    """Turn, accelerate and push particles on, and fill how far each goes: a loop of vector instructions.

    Who stands neither turns nor accelerates.
    """
    direction, speed, push = block.direction, block.speed, block.push
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
        moved_e[i] = way * (c - half * (s + 0.5 * half * c))
        moved_n[i] = way * (s + half * (c - 0.5 * half * s))
        theta += turn
        direction[i] = theta - 2.0 * math.pi * math.floor(theta / (2.0 * math.pi) + 0.5)
        speed[i] = later
        push[i] = push[i] * step.push_kept + step.pushed_by * pushed[i]


@njit(**EXACT)
def _place(table: MotionTable, h: float, block: Block, room: FloatArray, due: Due, state: UIntArray) -> None:
    """Put particles where they go, start those that do, and list which may change their manoeuvre."""
    position, speed, cell, now, which = block.position, block.speed, block.cell, due.cell, due.which
    n, n_due = speed.size, 0
    for i in range(n):
        position[i, 0] += room[MOVED_E, i]
        position[i, 1] += room[MOVED_N, i]
        now[i] = locate(table.locator, position[i, 0], position[i, 1])
    for i in range(n):
        if room[STARTING, i] > 0.0 and random.uniform(state) < room[STARTING, i] * h:
            speed[i] = STARTS_AT
    for i in range(n):
        halts = (room[BEFORE, i] < STANDING_BELOW) != (speed[i] < STANDING_BELOW)
        which[n_due] = i
        n_due += halts | (now[i] != cell[i])  # no branch, which the processor would guess wrong
        cell[i] = now[i]
    due.end[0] = n_due
    while due.next[0] < n:
        which[n_due] = int(due.next[0])
        n_due += 1
        due.next[0] = due.next[1] + random.uniform(state) * due.every
        due.next[1] += due.every
    due.next[0] -= n
    due.next[1] -= n
    due.end[1] = n_due


@njit(**EXACT | UNCOUNTED)
def _change(table: MotionTable, block: Block, due: Due, weight: SingleArray, state: UIntArray) -> None:
    """Change the manoeuvres of the particles that pass into another cell or state, or are due by chance."""
    position, direction, cell, manoeuvre = block.position, block.direction, block.cell, block.manoeuvre
    begin, end = table.begin, due.end
    for k in range(end[1]):  # kind by kind: the processor guesses what comes next
        p = due.which[k]
        before, now, x, y = manoeuvre[p], cell[p], position[p, 0], position[p, 1]
        passes, theta, v, after = k < end[0], direction[p], block.speed[p], -1
        if passes:
            after = go_over(table, before, now, v, state)
        elif due.leaves > 0.0 and v >= STANDING_BELOW and random.uniform(state) < due.leaves:
            after = len(table.row) + OWN_WAY
        elif begin[-1] <= before:
            after = leave_places(table, before, v, weight, state)
        elif now >= 0 and begin[now] <= before < begin[now + 1]:
            continue
        if after < 0:
            former, rate = (before, BY_VISITS) if passes else (-1, BY_TIME)
            after = take_up(table, former, now, x, y, theta, v, rate, weight, state)
        if passes:
            direction[p] = keep_deviation(table, before, after, x, y, theta)
        manoeuvre[p] = after


@njit(inline="always", nogil=True, **EXACT)  # by itself it would compile all of `take_up` once more
def initialise_motion(
    table: MotionTable, position: FloatArray, direction: FloatArray, speed: FloatArray, cell: IntArray,
    manoeuvre: IntArray, push: FloatArray, state: UIntArray,
) -> None:  # fmt: skip
    """Draw for (n,) particles a manoeuvre that fits them and a push, and look up their cell."""
    weight = np.empty((table.most, LANES), np.float32)
    for p in range(speed.size):
        push[p] = random.draw_normal(state)
        cell[p] = locate(table.locator, position[p, 0], position[p, 1])
        manoeuvre[p] = take_up(  # as integers: literals would compile it once more
            table, np.int64(-1), cell[p], position[p, 0], position[p, 1], direction[p], speed[p], np.int64(BY_TIME),
            weight, state,
        )  # fmt: skip
