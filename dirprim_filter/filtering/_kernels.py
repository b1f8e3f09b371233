"""Compiled steps of the particle filter, one vehicle after the other: no vehicle sees another's numbers.

Where the map remembers journeys, particles follow these (`primitives._following`); on a map of primitives alone they
relax to the modes of the cells that they pass (`_relaxing`).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dirprim_filter.distributions import _kernels as density
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._elementary import EXACT, cos, sin, squared_sine
from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.filtering._relaxing import MotionTable, draw_mode, offset_in, relax, step_of
from dirprim_filter.primitives import _following as following
from dirprim_filter.primitives._candidates import find_all, look_around, room_for, take_up
from dirprim_filter.primitives._likening import NO_ROW, NOBODY
from tessellation._kernels import locate
from tessellation.arrays import FloatArray, IntArray

KERNEL_SHARE = 0.5
"""Of the kernel that is best for a Gaussian: beliefs have several modes, which that would blur."""
# Rows of what `go_on` notes of each particle's step along its journey.
EAST, NORTH, COURSE, PACE, COURSE_LATER, PACE_LATER, ELSEWHERE = range(7)


class Cloud(NamedTuple):
    """Particles of every vehicle."""

    position: FloatArray  # (V, P, 2)
    direction: FloatArray  # (V, P)
    speed: FloatArray  # (V, P)
    cell: IntArray  # (V, P)
    mode: IntArray  # (V, P)
    row: IntArray  # (V, P) of the journey followed; `NO_ROW` for none: then the mode is followed
    since: FloatArray  # (V, P) seconds since it
    weight: FloatArray  # (V, P) sums to 1
    state: UIntArray  # (V, 4) of the random numbers


@njit(cache=True)
def advance(table: MotionTable, cloud: Cloud, v: int, dt_s: float) -> None:
    """Move a vehicle's particles by `dt_s` in steps of at most `step_s`.

    All particles in one call: arguments that hold arrays are counted at every call, by all threads.
    """
    state = cloud.state[v].copy()  # of its own memory, or threads would count references to one array in turns
    n_steps = max(1, math.ceil(dt_s / table.step_s - 1e-9))
    h = dt_s / n_steps
    if table.remembers:
        go_on(table, cloud, v, h, n_steps, state)
    else:
        step = step_of(table, h)
        for p in range(cloud.position.shape[1]):
            x, y = cloud.position[v, p, 0], cloud.position[v, p, 1]
            direction, speed = cloud.direction[v, p], cloud.speed[v, p]
            cell, mode = cloud.cell[v, p], cloud.mode[v, p]
            for _ in range(n_steps):
                here = locate(table.locator, x, y)
                if here != cell:
                    cell = here
                    mode = draw_mode(table, cell, x, y, direction, speed, True, state)
                elif random.uniform(state) < step.takes_up:
                    mode = draw_mode(table, cell, x, y, direction, speed, False, state)
                x, y, direction, speed = relax(table, step, x, y, direction, speed, cell, mode, state)
            cloud.position[v, p, 0], cloud.position[v, p, 1] = x, y
            cloud.direction[v, p], cloud.speed[v, p] = direction, speed
            cloud.cell[v, p], cloud.mode[v, p] = cell, mode
    cloud.state[v] = state


@njit(cache=True)
def go_on(table: MotionTable, cloud: Cloud, v: int, h: float, n_steps: int, state: UIntArray) -> None:
    """Move a vehicle's particles along journeys, `n_steps` of `h` seconds.

    A share of those that look for a journey take one of another place, so that who does what none did here is not lost.
    """
    journeys, found = table.journeys, room_for(table.journeys)
    decay = following.decay_over(journeys, h)
    position, row, since = cloud.position[v], cloud.row[v], cloud.since[v]
    direction, speed = cloud.direction[v], cloud.speed[v]
    n = row.size
    deviating, drifting, looking, way = np.empty(2 * n), np.empty(2 * n), np.empty(n, np.int64), np.empty((7, n))
    forgetting = random.draw_gap(decay.forgets, state)
    for _ in range(n_steps):
        n_looking = 0
        for p in range(n):
            if forgetting == 0 or row[p] == NO_ROW:
                looking[n_looking] = p
                n_looking += 1
            forgetting = forgetting - 1 if forgetting > 0 else random.draw_gap(decay.forgets, state)
        find_all(
            journeys, looking[:n_looking], position, direction, speed, row, since, table.place_free_share, found, state
        )
        random.fill_normals(deviating, state)
        random.fill_even(drifting, state)  # over some steps a drift is normal whatever each step's is
        for p in range(n):
            way[ELSEWHERE, p] = 1.0 if row[p] < NO_ROW else 0.0
            (
                way[EAST, p], way[NORTH, p], way[COURSE, p], way[PACE, p], way[COURSE_LATER, p], way[PACE_LATER, p],
                row[p], since[p], ended,
            ) = following.go_along(journeys, h, speed[p], row[p], since[p])  # fmt: skip
            if ended:
                row[p] = NO_ROW
        move(decay, way, position, direction, speed, deviating[:n], deviating[n:], drifting)


@njit(**EXACT)
def move(
    decay: following.Decay, way: FloatArray, position: FloatArray, direction: FloatArray, speed: FloatArray,
    turning: FloatArray, hurrying: FloatArray, drifting: FloatArray,
) -> None:  # fmt: skip
    """Move particles whose journeys went that `way`, each deviating from its own, as `following.follow` does one.

    Every loop writes one column, and reads few, so that it is compiled to vector instructions.
    """
    n = speed.size
    elsewhere, turned, course_later = way[ELSEWHERE], way[COURSE], way[COURSE_LATER]
    pace, pace_later, east, north = way[PACE], way[PACE_LATER], way[EAST], way[NORTH]
    for p in range(n):
        turned[p] = following.wrapped(direction[p] - turned[p])
    for p in range(n):
        turning[p] = following.turned_later(decay, elsewhere[p], turned[p], speed[p], turning[p])
    for p in range(n):
        direction[p] = following.wrapped(course_later[p] + turning[p])
    for p in range(n):
        speed[p] = following.speed_later(decay, elsewhere[p], speed[p], pace[p], pace_later[p], hurrying[p])
    for p in range(n):
        s, c = sin(0.5 * (turned[p] + turning[p])), cos(0.5 * (turned[p] + turning[p]))
        turned[p], turning[p] = c * east[p] - s * north[p], s * east[p] + c * north[p]
    for p in range(n):
        position[p, 0] += turned[p] + decay.drift * drifting[p]
        position[p, 1] += turning[p] + decay.drift * drifting[n + p]


@njit(cache=True, nogil=True)
def predict(table: MotionTable, cloud: Cloud, vehicle: IntArray, dt_s: FloatArray) -> None:
    """Move every particle of the vehicles named."""
    for i in range(vehicle.size):
        advance(table, cloud, vehicle[i], dt_s[i])


@njit(cache=True, nogil=True)
def predict_paths(table: MotionTable, cloud: Cloud, dt_s: FloatArray, path: FloatArray) -> None:
    """Positions of the particles after each of n_steps steps, (n_steps,) seconds. Fills (V, P, n_steps, 2)."""
    for v in range(path.shape[0]):
        for step in range(path.shape[2]):
            advance(table, cloud, v, dt_s[step])
            for p in range(path.shape[1]):
                path[v, p, step, 0], path[v, p, step, 1] = cloud.position[v, p, 0], cloud.position[v, p, 1]


@njit(cache=True, nogil=True)
def settle(table: MotionTable, cloud: Cloud, vehicle: IntArray) -> None:
    """Give every particle a journey, or the cell of its position and a mode, that fits its direction and speed.

    Particles that begin alike, as those of a forecast do, are looked around for once.
    """
    journeys, found = table.journeys, room_for(table.journeys)
    for v in vehicle:
        state = cloud.state[v]
        n_blocks, total = 0, 0.0
        for p in range(cloud.position.shape[1]):
            x, y = cloud.position[v, p, 0], cloud.position[v, p, 1]
            direction, speed = cloud.direction[v, p], cloud.speed[v, p]
            cloud.cell[v, p], cloud.mode[v, p], cloud.row[v, p] = locate(table.locator, x, y), 0, NO_ROW
            if not table.remembers:
                cloud.mode[v, p] = draw_mode(table, cloud.cell[v, p], x, y, direction, speed, True, state)
                continue
            same = p > 0 and x == cloud.position[v, p - 1, 0] and y == cloud.position[v, p - 1, 1]
            if not (same and direction == cloud.direction[v, p - 1] and speed == cloud.speed[v, p - 1]):
                n_blocks, total = look_around(journeys, x, y, direction, speed, NOBODY, found)
            here = 0.0 if random.uniform(state) < table.place_free_share else total
            row, since = take_up(journeys, n_blocks, here, found, speed, NOBODY, state)
            cloud.row[v, p], cloud.since[v, p] = row, since


@njit(cache=True, nogil=True)
def be_born(
    table: MotionTable, cloud: Cloud, vehicle: IntArray, key: UIntArray, measured: FloatArray, noise: float
) -> None:
    """Draw a new belief from one measurement: positions around it, direction and speed from the primitive there."""
    for i in range(vehicle.size):
        v = vehicle[i]
        state = cloud.state[v]
        random.seed_state(key[i], state)
        n = cloud.position.shape[1]
        for p in range(n):
            x = measured[i, 0] + noise * random.draw_normal(state)
            y = measured[i, 1] + noise * random.draw_normal(state)
            cell = locate(table.locator, x, y)
            left, mode = random.uniform(state), 0
            for m in range(table.weight.shape[1]):
                mode = m
                left -= table.weight[cell, m]
                if left < 0.0:
                    break
            east, north = offset_in(table, cell, x, y)
            bend, gain = table.bend[cell, mode], table.gain[cell, mode]
            mean = table.mean[cell, mode] + bend[0] * east + bend[1] * north
            rate = table.rate[cell, mode] * math.exp(-gain[0] * east - gain[1] * north)
            cloud.position[v, p, 0], cloud.position[v, p, 1] = x, y
            cloud.direction[v, p] = density.wrap(random.draw_von_mises(mean, table.concentration[cell, mode], state))
            cloud.speed[v, p] = random.draw_gamma(table.shape[cell, mode], state) / rate
            cloud.cell[v, p], cloud.mode[v, p], cloud.row[v, p] = cell, mode, NO_ROW
            cloud.weight[v, p] = 1.0 / n


@njit(cache=True, fastmath={"reassoc", "contract"})
def total_of(column: FloatArray) -> float:
    """The sum of a column, in whichever order is quickest: the same at every call."""
    total = 0.0
    for value in column:
        total += value
    return total


@njit(cache=True, fastmath={"reassoc", "contract"})
def mean_of(weight: FloatArray, column: FloatArray, total: float) -> float:
    """The mean of a column by weights of a known total."""
    mean = 0.0
    for p in range(weight.size):
        mean += weight[p] * column[p]
    return mean / total


@njit(cache=True)
def effective_sample_size(weight: FloatArray) -> float:
    """1 / sum of squared weights."""
    return 1.0 / mean_of(weight, weight, 1.0)


@njit(cache=True)
def systematic(weight: FloatArray, u: float, survivors: IntArray) -> None:
    """Systematic resampling (Kitagawa 1996): particle p survives floor or ceil of n w_p times. Fills how often."""
    n = weight.size
    share, cumulative, before = n / weight.sum(), 0.0, 0
    for p in range(n - 1):
        cumulative += weight[p]
        so_far = min(max(math.ceil(cumulative * share - u), before), n)
        survivors[p] = so_far - before
        before = so_far
    survivors[n - 1] = n - before


@njit(cache=True)
def spread_of(column: FloatArray, survivors: IntArray, is_angle: bool) -> float:
    """Standard deviation of what survives; of angles, from that of the first survivor."""
    first = 0
    while survivors[first] == 0:
        first += 1
    origin, mean, squared = column[first], 0.0, 0.0
    for p in range(column.size):
        off = column[p] - origin
        if is_angle and abs(off) > math.pi:
            off = density.wrap(off)
        mean += survivors[p] * off / column.size
        squared += survivors[p] * off * off / column.size
    return math.sqrt(max(squared - mean * mean, 0.0))


@njit(cache=True, nogil=True)
def resample(cloud: Cloud, vehicle: IntArray, below: float, renewed_share: float) -> None:
    """Replace the particles of each vehicle by equally weighted survivors: the first of each stays where it is.

    A vehicle whose effective sample size is not below `below` keeps its own. Of a survivor's copies, a share looks for
    another journey when it next moves. Copies are spread in direction and speed by the kernel of a regularised filter
    (Musso, Oudjane and Le Gland 2001): as wide as the belief is, times n^(-1/6), so that few particles do not become
    one that is wrong.
    """
    n = cloud.position.shape[1]
    bandwidth = KERNEL_SHARE * n ** (-1.0 / 6.0)
    survivors = np.empty(n, np.int64)
    for v in vehicle:
        weight = cloud.weight[v]
        if effective_sample_size(weight) >= below:
            continue
        state = cloud.state[v].copy()
        systematic(weight, random.uniform(state), survivors)
        position, direction, speed, since = cloud.position[v], cloud.direction[v], cloud.speed[v], cloud.since[v]
        cell, mode, row = cloud.cell[v], cloud.mode[v], cloud.row[v]
        wider = bandwidth * spread_of(direction, survivors, True)
        faster = bandwidth * spread_of(speed, survivors, False)
        free = 0
        for a in range(n):
            for _ in range(survivors[a] - 1):
                while survivors[free] > 0:
                    free += 1
                position[free, 0], position[free, 1] = position[a, 0], position[a, 1]
                direction[free] = density.wrap(direction[a] + wider * random.draw_normal(state))
                speed[free] = max(speed[a] + faster * random.draw_normal(state), 0.0)
                since[free] = since[a]
                cell[free], mode[free], row[free] = cell[a], mode[a], row[a]
                if random.uniform(state) < renewed_share:
                    row[free] = NO_ROW
                free += 1
        cloud.state[v] = state
        weight[:] = 1.0 / n


@njit(cache=True, nogil=True)
def moments(cloud: Cloud, vehicle: IntArray, out: FloatArray) -> None:
    """Fills (V, 10): mean x, y, covariance xx, xy, yy, direction, its resultant, speed, its deviation, sample size."""
    n = cloud.position.shape[1]
    one, two, three = np.empty(n), np.empty(n), np.empty(n)
    for i in range(vehicle.size):
        v = vehicle[i]
        weight, place, direction, pace = cloud.weight[v], cloud.position[v], cloud.direction[v], cloud.speed[v]
        for p in range(n):
            one[p] = 1.0 - 2.0 * squared_sine(0.5 * direction[p])
            two[p] = 1.0 - 2.0 * squared_sine(0.5 * direction[p] - 0.25 * math.pi)
        total = total_of(weight)
        c, s, speed = mean_of(weight, one, total), mean_of(weight, two, total), mean_of(weight, pace, total)
        x, y = mean_of(weight, place[:, 0], total), mean_of(weight, place[:, 1], total)
        out[i, 0], out[i, 1], out[i, 5], out[i, 6], out[i, 7] = x, y, math.atan2(s, c), math.hypot(c, s), speed
        for p in range(n):
            dx, dy = place[p, 0] - x, place[p, 1] - y
            one[p], two[p], three[p] = dx * dx, dx * dy, dy * dy
        out[i, 2], out[i, 3] = mean_of(weight, one, total), mean_of(weight, two, total)
        out[i, 4] = mean_of(weight, three, total)
        for p in range(n):
            one[p] = (pace[p] - speed) ** 2
        out[i, 8] = math.sqrt(mean_of(weight, one, total))
        out[i, 9] = effective_sample_size(weight)
