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
from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.filtering._relaxing import MotionTable, draw_mode, offset_in, relax, step_of
from dirprim_filter.primitives import _following as following
from dirprim_filter.primitives._following import NO_ROW
from tessellation._kernels import locate
from tessellation.arrays import FloatArray, IntArray


class Cloud(NamedTuple):
    """Particles of every vehicle."""

    position: FloatArray  # (V, P, 2)
    direction: FloatArray  # (V, P)
    speed: FloatArray  # (V, P)
    cell: IntArray  # (V, P)
    mode: IntArray  # (V, P)
    row: IntArray  # (V, P) of the journey followed; `NO_ROW` for none: then the mode is followed
    since: FloatArray  # (V, P) seconds since it
    log_weight: FloatArray  # (V, P) normalised
    state: UIntArray  # (V, 4) of the random numbers


@njit(cache=True)
def take_up(
    table: MotionTable, x: float, y: float, direction: float, speed: float, alike: FloatArray, state: UIntArray
) -> tuple[int, float]:
    """A journey to follow. A share follow one of another place, so that who does what none did here is not lost."""
    if random.uniform(state) < table.place_free_share:
        return following.anywhere(table.journeys, speed, -1.0, state)
    return following.find(table.journeys, x, y, direction, speed, -1.0, alike, state)


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
    """Move a vehicle's particles along journeys, `n_steps` of `h` seconds."""
    journeys, alike = table.journeys, np.empty((table.journeys.most_alike, 3))
    decay = following.decay_over(journeys, h)
    position, row, since = cloud.position[v], cloud.row[v], cloud.since[v]
    direction, speed = cloud.direction[v], cloud.speed[v]
    for p in range(row.size):
        x, y, course, pace, r, t = position[p, 0], position[p, 1], direction[p], speed[p], row[p], since[p]
        for _ in range(n_steps):
            if r == NO_ROW or random.uniform(state) < decay.forgets:
                r, t = take_up(table, x, y, course, pace, alike, state)
            east, north, course, pace, r, t, ended = following.follow(journeys, decay, h, course, pace, r, t, state)
            x += east
            y += north
            if ended:
                r = NO_ROW
        position[p, 0], position[p, 1], direction[p], speed[p], row[p], since[p] = x, y, course, pace, r, t


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
    journeys, alike = table.journeys, np.empty((table.journeys.most_alike, 3))
    for v in vehicle:
        state = cloud.state[v]
        n, total = 0, 0.0
        for p in range(cloud.position.shape[1]):
            x, y = cloud.position[v, p, 0], cloud.position[v, p, 1]
            direction, speed = cloud.direction[v, p], cloud.speed[v, p]
            cloud.cell[v, p], cloud.mode[v, p], cloud.row[v, p] = locate(table.locator, x, y), 0, NO_ROW
            if not table.remembers:
                cloud.mode[v, p] = draw_mode(table, cloud.cell[v, p], x, y, direction, speed, True, state)
                continue
            same = p > 0 and x == cloud.position[v, p - 1, 0] and y == cloud.position[v, p - 1, 1]
            if not (same and direction == cloud.direction[v, p - 1] and speed == cloud.speed[v, p - 1]):
                n, total = following.look_around(journeys, x, y, direction, speed, -1.0, alike)
            if random.uniform(state) < table.place_free_share:
                n_here, here = 0, 0.0
            else:
                n_here, here = n, total
            row, since = following.take_up(journeys, n_here, here, alike, speed, -1.0, state)
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
            cloud.log_weight[v, p] = -math.log(n)


@njit(cache=True, nogil=True)
def weigh(
    cloud: Cloud,
    vehicle: IntArray,
    measured: FloatArray,
    noise: float,
    outlier_probability: float,
    outlier_extent: float,
    log_evidence: FloatArray,
) -> None:
    """Weigh by a position measured with Gaussian noise, or by an outlier; normalise.

    Fills the log density of each measurement given those before it.
    """
    n = cloud.position.shape[1]
    log_normal = math.log1p(-outlier_probability) - math.log(density.TWO_PI * noise * noise)
    outlier = outlier_probability / outlier_extent**2
    log_outlier = math.log(outlier)
    for i in range(vehicle.size):
        v = vehicle[i]
        weight = cloud.log_weight[v]
        top = -np.inf
        for p in range(n):
            dx = cloud.position[v, p, 0] - measured[i, 0]
            dy = cloud.position[v, p, 1] - measured[i, 1]
            fit = log_normal - 0.5 * (dx * dx + dy * dy) / (noise * noise)
            high, low = max(fit, log_outlier), min(fit, log_outlier)
            weight[p] += high + math.log1p(math.exp(low - high))
            top = max(top, weight[p])
        total = 0.0
        for p in range(n):
            total += math.exp(weight[p] - top)
        log_evidence[i] = top + math.log(total)
        for p in range(n):
            weight[p] -= log_evidence[i]


@njit(cache=True, nogil=True)
def effective_sample_size(cloud: Cloud, vehicle: IntArray, result: FloatArray) -> None:
    """1 / sum of squared weights, of each vehicle."""
    for i in range(vehicle.size):
        total = 0.0
        for p in range(cloud.position.shape[1]):
            w = math.exp(cloud.log_weight[vehicle[i], p])
            total += w * w
        result[i] = 1.0 / total


@njit(cache=True, nogil=True)
def systematic(log_weight: FloatArray, u: float, ancestor: IntArray) -> None:
    """Systematic resampling (Kitagawa 1996): particle p survives floor or ceil of n w_p times. Fills the ancestors."""
    n = log_weight.size
    total = 0.0
    for p in range(n):
        total += math.exp(log_weight[p])
    cumulative, source = math.exp(log_weight[0]), 0
    for p in range(n):
        position = (p + u) / n * total
        while cumulative <= position and source < n - 1:
            source += 1
            cumulative += math.exp(log_weight[source])
        ancestor[p] = source


@njit(cache=True, nogil=True)
def resample(cloud: Cloud, vehicle: IntArray) -> None:
    """Replace each vehicle's particles by equally weighted survivors."""
    n = cloud.position.shape[1]
    ancestor = np.empty(n, np.int64)
    numbers = np.empty((n, 5))
    labels = np.empty((n, 3), np.int64)
    for v in vehicle:
        systematic(cloud.log_weight[v], random.uniform(cloud.state[v]), ancestor)
        for p in range(n):
            a = ancestor[p]
            numbers[p, 0], numbers[p, 1] = cloud.position[v, a, 0], cloud.position[v, a, 1]
            numbers[p, 2], numbers[p, 3], numbers[p, 4] = cloud.direction[v, a], cloud.speed[v, a], cloud.since[v, a]
            labels[p, 0], labels[p, 1], labels[p, 2] = cloud.cell[v, a], cloud.mode[v, a], cloud.row[v, a]
        for p in range(n):
            cloud.position[v, p, 0], cloud.position[v, p, 1] = numbers[p, 0], numbers[p, 1]
            cloud.direction[v, p], cloud.speed[v, p], cloud.since[v, p] = numbers[p, 2], numbers[p, 3], numbers[p, 4]
            cloud.cell[v, p], cloud.mode[v, p], cloud.row[v, p] = labels[p, 0], labels[p, 1], labels[p, 2]
            cloud.log_weight[v, p] = -math.log(n)


@njit(cache=True, nogil=True)
def moments(cloud: Cloud, vehicle: IntArray, out: FloatArray) -> None:
    """Fills (V, 9): mean x, y, covariance xx, xy, yy, mean direction, its resultant, mean speed, its deviation."""
    for i in range(vehicle.size):
        v = vehicle[i]
        total = x = y = c = s = speed = 0.0
        for p in range(cloud.position.shape[1]):
            w = math.exp(cloud.log_weight[v, p])
            total += w
            x += w * cloud.position[v, p, 0]
            y += w * cloud.position[v, p, 1]
            c += w * math.cos(cloud.direction[v, p])
            s += w * math.sin(cloud.direction[v, p])
            speed += w * cloud.speed[v, p]
        x, y, c, s, speed = x / total, y / total, c / total, s / total, speed / total
        xx = xy = yy = variance = 0.0
        for p in range(cloud.position.shape[1]):
            w = math.exp(cloud.log_weight[v, p]) / total
            dx, dy = cloud.position[v, p, 0] - x, cloud.position[v, p, 1] - y
            xx += w * dx * dx
            xy += w * dx * dy
            yy += w * dy * dy
            variance += w * (cloud.speed[v, p] - speed) ** 2
        out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4] = x, y, xx, xy, yy
        out[i, 5], out[i, 6], out[i, 7], out[i, 8] = (
            math.atan2(s, c),
            math.hypot(c, s),
            speed,
            math.sqrt(variance),
        )
