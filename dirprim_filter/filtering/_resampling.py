"""Compiled resampling: survivors of a belief, spread by one kernel of its whole covariance.

Without it the few particles that go with a fast driver, or that a vehicle found again after a gap leaves, soon descend
from one that is wrong, and the belief is sure of it. With weights w and d numbers to a particle, survivor x becomes

    m + sqrt(1 - h^2) (x - m) + h L xi,    h = (4 / (n (d + 2)))^(1 / (d + 4)),    L L^T = P

of mean m, covariance P and effective sample size n = 1 / sum w^2: m and P stay as they are. Places stand along and
across the mean course, so that beliefs are equivariant under rotation.

Source: Liu and West, Combined parameter and state estimation in simulation-based filtering, 2001; Musso, Oudjane and Le
Gland, Improving regularised particle filters, 2001, for the bandwidth; Kitagawa 1996 for systematic resampling.
"""

import math
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._arithmetic import dot, total_of
from dirprim_filter.distributions._elementary import squared_sine, wrap
from dirprim_filter.filtering._kernels import Cloud, effective_sample_size
from dirprim_filter.primitives._manoeuvres import STANDING_BELOW
from tessellation._compiling import compiled

AHEAD, ASIDE, TURN, PACE = range(4)
"""Rows of a state: metres along and across the mean course, radians from it, m/s."""
D = 4


class Room(NamedTuple):
    """What resampling works in."""

    survivors: IntArray  # (P,) how often each particle survives
    parent: IntArray  # (P,) whose copy each becomes
    state: FloatArray  # (D, P) deviations from the mean
    normal: FloatArray  # (D P + D,)
    product: FloatArray  # (P,)
    mean: FloatArray  # (D,)
    covariance: FloatArray  # (D, D)
    root: FloatArray  # (D, D) its lower triangle of Cholesky


@compiled
def room_for(n: int) -> Room:
    """For n particles."""
    numbers, columns, squares = np.empty((2, n), np.int64), np.empty((D + 1, n)), np.empty((2, D, D))
    return Room(
        numbers[0], numbers[1], columns[:D], np.empty(D * (n + 1)), columns[D], np.empty(D), squares[0], squares[1]
    )


@compiled
def systematic(weight: FloatArray, u: float, survivors: IntArray) -> None:
    """Systematic resampling: particle p survives floor or ceil of n w_p times. Fills how often."""
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


@compiled
def find_parents(survivors: IntArray, parent: IntArray) -> None:
    """Whose copy each particle becomes, by how often each survives, (n,): the first copy of each stays where it is."""
    free = 0
    for a in range(survivors.size):
        if survivors[a] > 0:
            parent[a] = a
        for _ in range(survivors[a] - 1):
            while survivors[free] > 0:
                free += 1
            parent[free] = a
            free += 1


@compiled
def resample(below: float, cloud: Cloud, vehicle: IntArray) -> None:
    """Replace the particles of each vehicle by equally weighted survivors, spread by the kernel.

    A vehicle whose effective sample size is not below `below` keeps its own. Who stands keeps its direction and keeps
    standing; who moves keeps moving.
    """
    room = room_for(cloud.position.shape[1])
    for v in vehicle:
        if effective_sample_size(cloud.weight[v]) < below:
            draw(cloud, v, room)


@compiled
def kernel_of(cloud: Cloud, v: int, room: Room) -> tuple[float, float, float]:
    """Fills the deviations of a belief, its mean and covariance; -> the bandwidth and the mean course."""
    c, s = states_of(cloud, v, room)
    covariance_of(cloud.weight[v], room)
    factorise(room.covariance, room.root)
    return (4.0 / (effective_sample_size(cloud.weight[v]) * (D + 2.0))) ** (1.0 / (D + 4.0)), c, s


@compiled
def states_of(cloud: Cloud, v: int, room: Room) -> tuple[float, float]:
    """Fills (D, P) deviations from the mean, and the mean (D,): of the place east and north; -> the mean course."""
    weight, state, mean, direction = cloud.weight[v], room.state, room.mean, cloud.direction[v]
    for p in range(weight.size):
        state[0, p] = 1.0 - 2.0 * squared_sine(0.5 * direction[p])
        state[1, p] = 1.0 - 2.0 * squared_sine(0.5 * direction[p] - 0.25 * math.pi)
    c, s = dot(weight, state[0]), dot(weight, state[1])
    course, length = math.atan2(s, c), math.hypot(c, s)
    c, s = (c / length, s / length) if length > 0.0 else (1.0, 0.0)
    for p in range(weight.size):
        state[AHEAD, p], state[ASIDE, p] = cloud.position[v, p, 0], cloud.position[v, p, 1]
        state[TURN, p], state[PACE, p] = wrap(direction[p] - course), cloud.speed[v, p]
    total = total_of(weight)
    for a in range(D):
        mean[a] = dot(weight, state[a]) / total
        for p in range(weight.size):
            state[a, p] -= mean[a]
    for p in range(weight.size):
        east, north = state[AHEAD, p], state[ASIDE, p]
        state[AHEAD, p], state[ASIDE, p] = east * c + north * s, north * c - east * s
    mean[TURN] += course
    return c, s


@compiled
def covariance_of(weight: FloatArray, room: Room) -> None:
    """Fills (D, D) from deviations (D, P)."""
    total, covariance = total_of(weight), room.covariance
    for a in range(D):
        for p in range(weight.size):
            room.product[p] = weight[p] * room.state[a, p]
        for b in range(a + 1):
            covariance[a, b] = covariance[b, a] = dot(room.product, room.state[b]) / total


@compiled
def factorise(covariance: FloatArray, root: FloatArray) -> None:
    """Fills the lower triangle (D, D) of Cholesky; what does not vary has none."""
    for b in range(D):
        for a in range(b, D):
            left = covariance[a, b]
            for k in range(b):
                left -= root[a, k] * root[b, k]
            if a == b:
                root[a, b] = math.sqrt(left) if left > 1e-12 * covariance[a, a] else 0.0
            else:
                root[a, b] = left / root[b, b] if root[b, b] > 0.0 else 0.0


@compiled
def draw(cloud: Cloud, v: int, room: Room) -> None:
    """Draw the survivors of a vehicle, and put each beside its parent's state."""
    h, c, s = kernel_of(cloud, v, room)
    n, state, parent = room.parent.size, room.state, room.parent
    numbers, m = cloud.state[v].copy(), (n + 1) // 2 * 2
    systematic(cloud.weight[v], random.uniform(numbers), room.survivors)
    find_parents(room.survivors, parent)
    random.fill_normals(room.normal[: D * m], numbers)
    for word in range(numbers.size):
        cloud.state[v, word] = numbers[word]
    for p in range(n):  # who is its own parent survives, so that what is read is not yet written
        a = parent[p]
        if a != p:
            cloud.direction[v, p], cloud.speed[v, p] = cloud.direction[v, a], cloud.speed[v, a]
            cloud.cell[v, p], cloud.manoeuvre[v, p], cloud.push[v, p] = (
                cloud.cell[v, a], cloud.manoeuvre[v, a], cloud.push[v, a],
            )  # fmt: skip
            for k in range(D):
                state[k, p] = state[k, a]
    spread(room, h)
    put(cloud, v, room, c, s)
    for p in range(n):
        cloud.weight[v, p] = 1.0 / n


@compiled
def spread(room: Room, h: float) -> None:
    """Shrink deviations (D, P) towards the mean, and add the kernel's draws."""
    state, root, n = room.state, room.root, room.parent.size
    kept, m = math.sqrt(1.0 - h * h), (n + 1) // 2 * 2
    for a in range(D - 1, -1, -1):
        for p in range(n):
            state[a, p] *= kept
        for b in range(a + 1):
            for p in range(n):
                state[a, p] += h * root[a, b] * room.normal[b * m + p]


@compiled
def put(cloud: Cloud, v: int, room: Room, c: float, s: float) -> None:
    """Put the particles at their deviations (D, P). Who stands keeps standing, and who moves keeps moving."""
    state, mean = room.state, room.mean
    for p in range(room.parent.size):
        ahead, aside = state[AHEAD, p], state[ASIDE, p]
        state[AHEAD, p] = cloud.position[v, p, 0] = mean[AHEAD] + ahead * c - aside * s
        state[ASIDE, p] = cloud.position[v, p, 1] = mean[ASIDE] + ahead * s + aside * c
        if cloud.speed[v, p] >= STANDING_BELOW:
            cloud.direction[v, p] = wrap(mean[TURN] + state[TURN, p])
            cloud.speed[v, p] = max(mean[PACE] + state[PACE, p], STANDING_BELOW)
