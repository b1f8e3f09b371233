"""Compiled: how particles move by manoeuvres.

A particle holds a manoeuvre and a push, its own acceleration beside the manoeuvre's. Its direction deviates from the
manoeuvre's course; deviation and push are Ornstein-Uhlenbeck processes that outlive a change of manoeuvre, so a slow
driver stays slow. Where it enters a cell, stops or starts, it changes to another manoeuvre.
"""

import math
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._elementary import cos, sin
from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.primitives._manoeuvres import (
    A_0,
    A_E,
    A_N,
    A_V,
    BEND_E,
    BEND_N,
    BY_TIME,
    BY_VISITS,
    COURSE,
    CURVATURE,
    DISCOUNT,
    DISTANCE,
    EAST,
    LANES,
    N_COLUMNS,
    NORTH,
    OWN_WAY,
    PUSH,
    RETURNS,
    STANDING_BELOW,
    STARTS,
    TURNING,
    MotionTable,
    SingleArray,
    acceleration_of,
    follow,
    keep_deviation,
    leave_places,
    offset_from,
    take_up,
)
from dirprim_filter.primitives.motion import JUMP_S, PUSH_RATE
from tessellation._compiling import compiled, pasted, uncounted
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
    jumps: float  # how often a particle may change its manoeuvre by chance
    leaves: float  # share of these that goes its own way


@compiled
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
    h = dt_s / n_steps
    course_kept, push_kept = math.exp(-table.course_rate * h), math.exp(-PUSH_RATE * h)
    turned_by, pushed_by = math.sqrt(1.0 - course_kept * course_kept), math.sqrt(1.0 - push_kept * push_kept)
    jumps = 1.0 - math.exp(-h / JUMP_S)
    leaves = (1.0 - math.exp(-table.own_way_rate * h)) / jumps
    step = Step(h, course_kept, push_kept, turned_by, pushed_by, math.sqrt(h), jumps, leaves)
    normal, own = np.empty(2 * n), np.empty((N_COLUMNS, n)).T
    for _ in range(n_steps):
        random.fill_normals(normal, state)
        _gather(table.row, position, manoeuvre, led, own)
        _advance(step, own, direction, speed, push, normal)
        _change(table, step, own, position, direction, speed, cell, manoeuvre, weight, state)


@uncounted
def _gather(row: FloatArray, position: FloatArray, manoeuvre: IntArray, led: FloatArray, own: FloatArray) -> None:
    """Fill each particle's own row, from its place: here memory is waited for, so that the next loop need not."""
    for i in range(manoeuvre.size):
        own[i, EAST], own[i, NORTH] = offset_from(row, manoeuvre[i], position[i, 0], position[i, 1])
        for k in range(COURSE, N_COLUMNS):
            own[i, k] = row[manoeuvre[i], k]
    for i in range(len(led)):
        if own[i, STARTS] > 0.0:
            own[i, STARTS] = led[i, 2] + led[i, 1] * own[i, STARTS]
        else:
            for k in (A_0, A_E, A_N, A_V, PUSH):
                own[i, k] *= led[i, 1]
            own[i, A_0] += led[i, 0]


@uncounted
def _advance(
    step: Step, own: FloatArray, direction: FloatArray, speed: FloatArray, push: FloatArray, normal: FloatArray
) -> None:
    """Turn, accelerate and push particles on; -> in `own` how far each goes. A loop of vector instructions."""
    n = speed.size
    for i in range(n):
        v, theta, east, north = speed[i], direction[i], own[i, EAST], own[i, NORTH]
        later = max(v + step.h * acceleration_of(own, i, east, north, v, push[i]), 0.0)
        way = 0.5 * step.h * (v + later) * own[i, DISTANCE]
        c, s = cos(theta), sin(theta)
        off = theta - own[i, COURSE] - own[i, BEND_E] * east - own[i, BEND_N] * north
        off -= 2.0 * math.pi * math.floor(off / (2.0 * math.pi) + 0.5)
        wanders = own[i, TURNING] * (step.turned_by + (1.0 - own[i, RETURNS]) * (step.root - step.turned_by))
        turn = (own[i, BEND_E] * c + own[i, BEND_N] * s + own[i, CURVATURE]) * way
        turn += wanders * min(v, 1.0) * normal[i] - own[i, RETURNS] * (1.0 - step.course_kept) * off
        half = 0.5 * turn
        own[i, EAST] = way * (c - half * (s + 0.5 * half * c))
        own[i, NORTH] = way * (s + half * (c - 0.5 * half * s))
        theta += turn
        direction[i] = theta - 2.0 * math.pi * math.floor(theta / (2.0 * math.pi) + 0.5)
        speed[i] = later
        push[i] = push[i] * step.push_kept + step.pushed_by * normal[n + i]


@uncounted
def _change(
    table: MotionTable, step: Step, own: FloatArray, position: FloatArray, direction: FloatArray, speed: FloatArray,
    cell: IntArray, manoeuvre: IntArray, weight: SingleArray, state: UIntArray,
) -> None:  # fmt: skip
    """Start who does, and change the manoeuvres of those that enter a cell, stop or start, or look for one of it."""
    begin, n_placed = table.begin, table.begin[-1]
    for p in range(speed.size):
        x, y = position[p, 0] + own[p, EAST], position[p, 1] + own[p, NORTH]
        stood, now = own[p, DISTANCE] == 0.0, locate(table.locator, x, y)
        if stood and random.uniform(state) < own[p, STARTS] * step.h:
            speed[p] = STARTS_AT
        v = speed[p]
        passes = (now != cell[p]) | (stood != (v < STANDING_BELOW))
        position[p, 0], position[p, 1], cell[p] = x, y, now
        is_due = random.uniform(state) < step.jumps
        for by_chance in range(not passes, 1 + is_due):
            before, after = manoeuvre[p], -1
            if not by_chance:
                if now >= 0 and before < n_placed:
                    after = follow(table, before, begin[now], begin[now + 1], v < STANDING_BELOW, DISCOUNT, state)
            elif v >= STANDING_BELOW and random.uniform(state) < step.leaves:
                after = len(table.row) + OWN_WAY
            elif before >= n_placed:
                after = leave_places(table, before, v, state)
            elif now >= 0 and begin[now] <= before < begin[now + 1]:
                continue
            if after < 0:
                former, rate = (-1, BY_TIME) if by_chance else (before, BY_VISITS)
                after = take_up(table, former, now, x, y, direction[p], v, rate, weight, state)
            if not by_chance:
                direction[p] = keep_deviation(table, before, after, x, y, direction[p])
            manoeuvre[p] = after


@pasted  # by itself it would compile all of `take_up` once more
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
