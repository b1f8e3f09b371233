"""Compiled steps of the particle filter, one vehicle after the other: no vehicle sees another's numbers.

The motion model is Eq. 4 in closed form: the vehicle's own direction, a von Mises whose concentration fades with time,
times the mode of its cell. With e = exp(-k dt) the factors are concentration c e / (1 - e^2) for the vehicle's own and
c / (1 + e) for the mode's; their product is, for small angles, the exact step of an Ornstein-Uhlenbeck process that
settles on the mode, however finely time is cut. Speed takes the exact step of the Cox-Ingersoll-Ross process whose
stationary law is the mode's gamma (Cox, Ingersoll and Ross 1985): a noncentral chi-square.

Where the map remembers journeys, particles follow these; see `primitives._following`.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dirprim_filter.distributions import _kernels as density
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.primitives import _following as following
from dirprim_filter.primitives._following import NO_ROW, JourneyTable
from tessellation._kernels import Locator, locate
from tessellation.arrays import BoolArray, FloatArray, IntArray


class MotionTable(NamedTuple):
    """A map's parameters as the kernels take them; row -1 is place-free."""

    locator: Locator
    weight: FloatArray  # (n_cells + 1, M)
    mean: FloatArray
    concentration: FloatArray
    shape: FloatArray
    rate: FloatArray
    log_fit: FloatArray  # (n_cells + 1, M) log of weight and of what normalises direction
    log_speed_fit: FloatArray  # (n_cells + 1, M) what normalises speed
    draws: BoolArray  # (n_cells + 1, M) whether the mode draws directions towards its mean
    bend: FloatArray  # (n_cells + 1, M, 2)
    gain: FloatArray  # (n_cells + 1, M, 2)
    center: FloatArray  # (n_cells + 1, 2)
    extent: FloatArray  # (n_cells + 1,) metres from the centre beyond which nothing bends further
    direction_rate: float
    speed_rate: float
    mode_rate: float
    turning: float
    place_free_speed_rate: float
    drift: float
    place_free_share: float
    step_s: float
    journeys: JourneyTable
    remembers: bool  # whether there are journeys


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


@njit(cache=True, inline="always")
def offset_in(table: MotionTable, cell: int, x: float, y: float) -> tuple[float, float]:
    """Metres from the centre of a cell, as far as its primitive bends: no further than the cell goes."""
    extent = table.extent[cell]
    east = min(max(x - table.center[cell, 0], -extent), extent)
    north = min(max(y - table.center[cell, 1], -extent), extent)
    return east, north


@njit(cache=True)
def draw_mode(
    table: MotionTable, cell: int, x: float, y: float, direction: float, speed: float, by_speed: bool, state: UIntArray
) -> int:
    """A mode of the cell, by its weight times how well it fits the direction and, on request, the speed (Eq. 4).

    A share of the particles follow no primitive of the place, so that a vehicle that does not either is not lost.
    """
    if random.uniform(state) < table.place_free_share:
        cell = -1  # the place-free modes stand in the same columns of every row
    n = table.weight.shape[1]
    log_p = np.empty(n)
    top = -np.inf
    log_speed = math.log(max(speed, 1e-6))
    east, north = offset_in(table, cell, x, y)
    for m in range(n):
        log_p[m] = -np.inf
        if table.weight[cell, m] > 0.0:
            mean = table.mean[cell, m] + table.bend[cell, m, 0] * east + table.bend[cell, m, 1] * north
            log_p[m] = table.log_fit[cell, m]
            log_p[m] += table.concentration[cell, m] * (math.cos(direction - mean) - 1.0)
            if by_speed:
                gained = table.gain[cell, m, 0] * east + table.gain[cell, m, 1] * north
                log_p[m] += table.log_speed_fit[cell, m] - table.rate[cell, m] * math.exp(-gained) * speed
                log_p[m] += (table.shape[cell, m] - 1.0) * log_speed - table.shape[cell, m] * gained
            top = max(top, log_p[m])
    total = 0.0
    for m in range(n):
        log_p[m] = math.exp(log_p[m] - top)
        total += log_p[m]
    left = random.uniform(state) * total
    for m in range(n):
        left -= log_p[m]
        if left < 0.0:
            return m
    return n - 1  # rounding left a sliver over


@njit(cache=True)
def turn(direction: float, mean: float, concentration: float, kept: float, state: UIntArray) -> float:
    """The direction a step later: Eq. 4 of the vehicle's own and its mode's; `kept` is e^{-k dt}."""
    own = concentration * kept / (1.0 - kept * kept)
    usual = concentration / (1.0 + kept)
    away = mean - direction
    along = own + usual * math.cos(away)
    across = usual * math.sin(away)
    return random.draw_von_mises(direction + math.atan2(across, along), math.hypot(along, across), state)


@njit(cache=True)
def accelerate(speed: float, shape: float, rate: float, kept: float, state: UIntArray) -> float:
    """The speed a step later: the exact step of the Cox-Ingersoll-Ross process; `kept` is e^{-k dt}.

    A noncentral chi-square of 2 shape degrees of freedom: a shifted normal squared and a gamma, or, of fewer than one
    degree, a Poisson mixture of gammas.
    """
    if shape <= 0.5:
        count = random.draw_poisson(rate * speed * kept / (1.0 - kept), state)
        return random.draw_gamma(shape + count, state) * (1.0 - kept) / rate
    root = math.sqrt(2.0 * rate * speed * kept / (1.0 - kept)) + random.draw_normal(state)
    return (0.5 * root * root + random.draw_gamma(shape - 0.5, state)) * (1.0 - kept) / rate


class Step(NamedTuple):
    """What a step of one length does."""

    h: float  # seconds
    takes_up: float  # probability of another mode
    slip: float  # metres
    direction_kept: float
    speed_kept: float
    free_speed_kept: float
    free_concentration: float


@njit(cache=True, inline="always")
def step_of(table: MotionTable, h: float) -> Step:
    """The constants of a step of `h` seconds."""
    return Step(
        h,
        1.0 - math.exp(-table.mode_rate * h),
        math.sqrt(table.drift * h),
        math.exp(-table.direction_rate * h),
        math.exp(-table.speed_rate * h),
        math.exp(-table.place_free_speed_rate * h),
        1.0 / (table.turning * h),
    )


@njit(cache=True)
def relax(
    table: MotionTable, step: Step, x: float, y: float, direction: float, speed: float, cell: int, mode: int,
    state: UIntArray,
) -> tuple[float, float, float, float]:  # fmt: skip
    """A step on the way to a mode: position, direction and speed, by the step's mean direction and speed."""
    rate, h = table.rate[cell, mode], step.h
    if table.draws[cell, mode]:
        east, north = offset_in(table, cell, x, y)
        bend_east, bend_north = table.bend[cell, mode, 0], table.bend[cell, mode, 1]
        mean = table.mean[cell, mode] + bend_east * east + bend_north * north
        rate *= math.exp(-table.gain[cell, mode, 0] * east - table.gain[cell, mode, 1] * north)
        # The deviation from the mode relaxes, not the direction: a vehicle on a bend turns with the bend.
        carried = (bend_east * math.cos(direction) + bend_north * math.sin(direction)) * speed * h
        turned = turn(direction + carried, mean + carried, table.concentration[cell, mode], step.direction_kept, state)
        kept = step.speed_kept
    else:
        turned = random.draw_von_mises(direction, step.free_concentration, state)
        kept = step.free_speed_kept
    faster = accelerate(speed, table.shape[cell, mode], rate, kept, state)
    middle, distance = 0.5 * (direction + turned), 0.5 * (speed + faster) * h
    x += distance * math.cos(middle) + step.slip * random.draw_normal(state)
    y += distance * math.sin(middle) + step.slip * random.draw_normal(state)
    return x, y, density.wrap(turned), faster


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
