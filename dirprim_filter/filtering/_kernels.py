"""Compiled steps of the particle filter, one vehicle after the other: no vehicle sees another's numbers.

Particles move by the manoeuvres of the map (`primitives._motion`).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._arithmetic import dot, total_of, weighted_sums
from dirprim_filter.distributions._blocks import ROWS
from dirprim_filter.distributions._elementary import EXACT, squared_sine, wrap
from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.primitives import _map_kernels, _motion
from dirprim_filter.primitives._manoeuvres import MotionTable
from dirprim_filter.primitives._map_kernels import MapTable
from tessellation import OUTSIDE

KERNEL_SHARE = 0.7
"""Of the kernel that is best for a Gaussian: beliefs have several modes, which that would blur. Of half of it beliefs
are too sure: NEES of 2.2 in sight instead of 2.0."""


class Cloud(NamedTuple):
    """Particles of every vehicle."""

    position: FloatArray  # (V, P, 2)
    direction: FloatArray  # (V, P)
    speed: FloatArray  # (V, P)
    cell: IntArray  # (V, P)
    manoeuvre: IntArray  # (V, P)
    push: FloatArray  # (V, P) the vehicle's own acceleration, in standard deviations of its manoeuvre's
    weight: FloatArray  # (V, P) sums to 1
    state: UIntArray  # (V, 4) of the random numbers


@njit(nogil=True, **EXACT)
def initialise_motion(table: MotionTable, cloud: Cloud, vehicle: IntArray) -> None:
    """Look up the cell of every particle, and draw a manoeuvre that fits its direction and speed."""
    for v in vehicle:
        _motion.initialise_motion(
            table, cloud.position[v], cloud.direction[v], cloud.speed[v], cloud.cell[v], cloud.manoeuvre[v],
            cloud.push[v], cloud.state[v],
        )  # fmt: skip


@njit(cache=True, nogil=True)
def scatter(
    primitives: MapTable, cloud: Cloud, vehicle: IntArray, key: UIntArray, measured: FloatArray, noise: float
) -> None:
    """Initialise a belief from one measurement: positions around it, direction and speed from the primitive there.

    `initialise_motion` then looks up the cells and draws manoeuvres.
    """
    n = cloud.speed.shape[1]
    block = np.empty(n // ROWS + 1, np.uint64)
    for i in range(vehicle.size):
        v = vehicle[i]
        state = cloud.state[v]
        random.seed_state(key[i], state)
        for p in range(n):
            cloud.position[v, p, 0] = measured[i, 0] + noise * random.draw_normal(state)
            cloud.position[v, p, 1] = measured[i, 1] + noise * random.draw_normal(state)
        for b in range(block.size):
            block[b] = random.bits(state)
        _map_kernels.draw(primitives, cloud.position[v], block, cloud.direction[v], cloud.speed[v])
        cloud.weight[v] = 1.0 / n


@njit(cache=True)
def effective_sample_size(weight: FloatArray) -> float:
    """1 / sum of squared weights."""
    return 1.0 / dot(weight, weight)


@njit(cache=True)
def systematic(weight: FloatArray, u: float, survivors: IntArray) -> None:
    """Systematic resampling (Kitagawa 1996): particle p survives floor or ceil of n w_p times. Fills how often."""
    n = weight.size
    total, cumulative, before = 0.0, 0.0, 0
    for p in range(n):
        total += weight[p]
    share = n / total
    for p in range(n - 1):
        cumulative += weight[p]
        so_far = min(max(math.ceil(cumulative * share - u), before), n)
        survivors[p] = so_far - before
        before = so_far
    survivors[n - 1] = n - before


@njit(cache=True)
def parent_of(survivors: IntArray, parent: IntArray, copy: IntArray) -> int:
    """Whose copy each particle becomes, by how often each survives: fills (n,), and which ones are another's.

    Returns:
        How many these are; `copy` (n,) begins with them, in ascending order.
    """
    free = n_copies = 0
    for a in range(survivors.size):
        if survivors[a] > 0:
            parent[a] = a
        for _ in range(survivors[a] - 1):
            while survivors[free] > 0:
                free += 1
            parent[free], copy[n_copies] = a, free
            free += 1
            n_copies += 1
    return n_copies


@njit(cache=True)
def spread_of(column: FloatArray, copies: FloatArray, off: FloatArray, squared: FloatArray, is_angle: bool) -> float:
    """Standard deviation of a column (n,) of which `copies` (n,) survive; of angles, from the first survivor's.

    `off` and `squared` are room for n numbers each.
    """
    n, first = column.size, 0
    while copies[first] == 0.0:
        first += 1
    origin = column[first]
    for p in range(n):
        off[p] = column[p] - origin
    if is_angle:
        for p in range(n):
            off[p] -= 2.0 * math.pi * math.floor(off[p] / (2.0 * math.pi) + 0.5)
    for p in range(n):
        squared[p] = off[p] * off[p]
    _, mean, square = weighted_sums(copies, (off, squared))
    return math.sqrt(max(square / n - (mean / n) ** 2, 0.0))


class ResampleRoom(NamedTuple):
    """What resampling works in."""

    survivors: IntArray  # (P,) how often each particle survives
    parent: IntArray  # (P,) whose copy each has become
    copy: IntArray  # (P,) which have become another's
    normal: FloatArray  # (4 P + 4,)
    column: FloatArray  # (4, P)


@njit(cache=True)
def room_to_resample(n: int) -> ResampleRoom:
    """For n particles of a vehicle."""
    numbers = np.empty((3, n), np.int64)
    return ResampleRoom(numbers[0], numbers[1], numbers[2], np.empty(4 * n + 4), np.empty((4, n)))


@njit(cache=True, nogil=True)
def resample(cloud: Cloud, vehicle: IntArray, below: float) -> None:
    """Replace the particles of each vehicle by equally weighted survivors: the first of each stays where it is.

    A vehicle whose effective sample size is not below `below` keeps its own.
    """
    room = room_to_resample(cloud.position.shape[1])
    for v in vehicle:
        effective = effective_sample_size(cloud.weight[v])
        if effective < below:
            resample_vehicle(cloud, v, effective, room)


@njit(cache=True)
def resample_vehicle(cloud: Cloud, v: int, effective: float, room: ResampleRoom) -> None:
    """Resample one vehicle of so large an effective sample size; `room.parent` says then whose copy each particle is.

    Copies are spread by the kernel of a regularised filter (Musso, Oudjane and Le Gland 2001): as wide as the belief
    is, times the effective sample size to the power -1/6. Else the few particles that go with a fast driver, or that a
    vehicle found again after a gap leaves, soon descend from one that is wrong, and the belief is sure of it.
    """
    n, bandwidth, state = cloud.position.shape[1], KERNEL_SHARE * effective ** (-1.0 / 6.0), cloud.state[v].copy()
    survivors, parent, normal = room.survivors, room.parent, room.normal
    copies, column, off, squared = room.column[0], room.column[1], room.column[2], room.column[3]
    turns, runs = bool(np.bool_(True)), bool(np.bool_(False))  # literals would compile it once more, as do views
    systematic(cloud.weight[v], random.uniform(state), survivors)
    position, direction, speed, push = cloud.position[v], cloud.direction[v], cloud.speed[v], cloud.push[v]
    cell, manoeuvre = cloud.cell[v], cloud.manoeuvre[v]
    for p in range(n):
        copies[p] = survivors[p]
    wider = bandwidth * spread_of(direction, copies, off, squared, turns)
    faster = bandwidth * spread_of(speed, copies, off, squared, runs)
    for p in range(n):
        column[p] = position[p, 0]
    east = bandwidth * spread_of(column, copies, off, squared, runs)
    for p in range(n):
        column[p] = position[p, 1]
    north = bandwidth * spread_of(column, copies, off, squared, runs)
    n_copies = parent_of(survivors, parent, room.copy)
    m = (n_copies + 1) // 2 * 2
    random.fill_normals(normal[: 4 * m], state)
    for k in range(n_copies):
        p = room.copy[k]
        a = parent[p]
        position[p, 0] = position[a, 0] + east * normal[k]
        position[p, 1] = position[a, 1] + north * normal[m + k]
        direction[p] = wrap(direction[a] + wider * normal[2 * m + k])
        speed[p] = max(speed[a] + faster * normal[3 * m + k], 0.0)
        cell[p], manoeuvre[p], push[p] = cell[a], manoeuvre[a], push[a]
    for word in range(state.size):
        cloud.state[v, word] = state[word]
    cloud.weight[v] = 1.0 / n


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
        c, s, speed = dot(weight, one) / total, dot(weight, two) / total, dot(weight, pace) / total
        for p in range(n):
            one[p], two[p] = place[p, 0], place[p, 1]
        x, y = dot(weight, one) / total, dot(weight, two) / total
        out[i, 0], out[i, 1], out[i, 5], out[i, 6], out[i, 7] = x, y, math.atan2(s, c), math.hypot(c, s), speed
        for p in range(n):
            dx, dy = place[p, 0] - x, place[p, 1] - y
            one[p], two[p], three[p] = dx * dx, dx * dy, dy * dy
        out[i, 2], out[i, 3] = dot(weight, one) / total, dot(weight, two) / total
        out[i, 4] = dot(weight, three) / total
        for p in range(n):
            one[p] = (pace[p] - speed) ** 2
        out[i, 8] = math.sqrt(dot(weight, one) / total)
        out[i, 9] = effective_sample_size(weight)


@njit(cache=True, nogil=True)
def outside(cloud: Cloud, vehicle: IntArray, out: FloatArray) -> None:
    """Fills (V,): the weight of the particles that are in no cell."""
    is_outside = np.empty(cloud.position.shape[1])
    for i in range(vehicle.size):
        cell = cloud.cell[vehicle[i]]
        for p in range(cell.size):
            is_outside[p] = 1.0 if cell[p] == OUTSIDE else 0.0
        out[i] = dot(cloud.weight[vehicle[i]], is_outside)


@njit(cache=True, nogil=True)
def mean_rate(cloud: Cloud, rate: FloatArray, vehicle: IntArray, out: FloatArray) -> None:
    """Fills (V,): the mean over the particles of what is (z,) of each manoeuvre."""
    of_particle = np.empty(cloud.position.shape[1])
    for i in range(vehicle.size):
        manoeuvre = cloud.manoeuvre[vehicle[i]]
        for p in range(manoeuvre.size):
            of_particle[p] = rate[manoeuvre[p]]
        out[i] = dot(cloud.weight[vehicle[i]], of_particle)
