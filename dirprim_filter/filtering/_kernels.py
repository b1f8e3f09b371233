"""Compiled steps of the particle filter, one vehicle after the other: no vehicle sees another's numbers.

The motion model is Eq. 4 in closed form: the vehicle's own direction, a von Mises whose concentration fades with time,
times the mode of its cell. With e = exp(-k dt) the factors are concentration c e / (1 - e^2) for the vehicle's own and
c / (1 + e) for the mode's; their product is, for small angles, the exact step of an Ornstein-Uhlenbeck process that
settles on the mode, however finely time is cut. Speed takes the exact step of the Cox-Ingersoll-Ross process whose
stationary law is the mode's gamma (Cox, Ingersoll and Ross 1985): a Poisson mixture of gammas.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dirprim_filter.distributions import _kernels as density
from dirprim_filter.distributions._kernels import UIntArray
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
    speed_rate: FloatArray
    leave: FloatArray
    mode_rate: float
    turning: float
    lead: float
    place_free_speed_rate: float
    drift: float
    place_free_share: float
    step_s: float
    carry_from: float
    lat_fit: float
    slip: FloatArray
    lane_rate: float
    anchor: FloatArray
    hold: FloatArray
    n_own: int
    next_start: IntArray
    next_cell: IntArray
    goal_p: FloatArray
    next_p: FloatArray


class Cloud(NamedTuple):
    """Particles of every vehicle."""

    position: FloatArray  # (V, P, 2)
    direction: FloatArray  # (V, P)
    speed: FloatArray  # (V, P)
    cell: IntArray  # (V, P)
    mode: IntArray  # (V, P)
    log_weight: FloatArray  # (V, P) normalised
    state: UIntArray  # (V, 4) of the random numbers


@njit(cache=True, inline="always")
def offset_in(table: MotionTable, cell: int, x: float, y: float) -> tuple[float, float]:
    """Metres from the centre of a cell, as far as its primitive bends: no further than the cell goes."""
    extent = table.extent[cell]
    east = min(max(x - table.center[cell, 0], -extent), extent)
    north = min(max(y - table.center[cell, 1], -extent), extent)
    return east, north


@njit(cache=True, inline="always")
def beside(table: MotionTable, cell: int, mode: int, x: float, y: float) -> tuple[float, float, float]:
    """Metres left of the line of a mode, and the line's cosine and sine."""
    ax, ay = x - table.anchor[cell, mode, 0], y - table.anchor[cell, mode, 1]
    mx, my = x - 0.5 * ax - table.center[cell, 0], y - 0.5 * ay - table.center[cell, 1]
    mu = table.mean[cell, mode] + table.bend[cell, mode, 0] * mx + table.bend[cell, mode, 1] * my
    c, s = math.cos(mu), math.sin(mu)
    return ay * c - ax * s, c, s


@njit(cache=True)
def draw_mode(
    table: MotionTable, cell: int, x: float, y: float, direction: float, speed: float, by_speed: bool, state: UIntArray
) -> int:
    """A mode of the cell, by its weight times how well it fits the direction and, on request, the speed (Eq. 4).

    A share of the particles follow no primitive of the place, so that a vehicle that does not either is not lost.
    """
    if density.uniform(state) < table.place_free_share:
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
            if table.hold[cell, m] > 0.0:
                e, _c, _s = beside(table, cell, m, x, y)
                log_p[m] += 0.5 * math.log(table.hold[cell, m]) - 0.5 * table.hold[cell, m] * e * e
            top = max(top, log_p[m])
    total = 0.0
    for m in range(n):
        log_p[m] = math.exp(log_p[m] - top)
        total += log_p[m]
    left = density.uniform(state) * total
    for m in range(n):
        left -= log_p[m]
        if left < 0.0:
            return m
    return n - 1  # rounding left a sliver over


CARRY = True


@njit(cache=True)
def draw_goal(table: MotionTable, cell: int, mode: int, state: UIntArray) -> int:
    left = density.uniform(state)
    for g in range(table.goal_p.shape[2]):
        left -= table.goal_p[cell, mode, g]
        if left < 0.0:
            return g
    return table.goal_p.shape[2] - 1


@njit(cache=True)
def follow(
    table: MotionTable, before: int, mode: int, cell: int, x: float, y: float, direction: float, speed: float,
    by_speed: bool, goal: int, state: UIntArray
) -> int:
    """The mode after an own mode of the cell before."""
    edge = -1
    for e in range(table.next_start[before], table.next_start[before + 1]):
        if table.next_cell[e] == cell:
            edge = e
            break
    n = table.n_own
    he, hn = offset_in(table, before, x, y)
    here = table.mean[before, mode] + table.bend[before, mode, 0] * he + table.bend[before, mode, 1] * hn
    log_p = np.empty(n)
    top = -np.inf
    log_speed = math.log(max(speed, 1e-6))
    east, north = offset_in(table, cell, x, y)
    for m in range(n):
        log_p[m] = -np.inf
        if table.weight[cell, m] > 0.0:
            mean = table.mean[cell, m] + table.bend[cell, m, 0] * east + table.bend[cell, m, 1] * north
            if edge >= 0:
                log_p[m] = table.log_fit[cell, m] - math.log(table.weight[cell, m]) + math.log(table.next_p[edge, goal, mode, m] + 1e-9)
            else:
                log_p[m] = table.log_fit[cell, m]
            log_p[m] += table.concentration[cell, m] * (math.cos(direction - mean) - 1.0)
            if by_speed:
                gained = table.gain[cell, m, 0] * east + table.gain[cell, m, 1] * north
                log_p[m] += table.log_speed_fit[cell, m] - table.rate[cell, m] * math.exp(-gained) * speed
                log_p[m] += (table.shape[cell, m] - 1.0) * log_speed - table.shape[cell, m] * gained
            if table.hold[cell, m] > 0.0:
                e, _c, _s = beside(table, cell, m, x, y)
                log_p[m] += 0.5 * math.log(table.hold[cell, m]) - 0.5 * table.lat_fit * table.hold[cell, m] * e * e
            top = max(top, log_p[m])
    if top == -np.inf:
        return draw_mode(table, cell, x, y, direction, speed, True, state)
    total = 0.0
    for m in range(n):
        log_p[m] = math.exp(log_p[m] - top)
        total += log_p[m]
    left = density.uniform(state) * total
    for m in range(n):
        left -= log_p[m]
        if left < 0.0:
            return m
    return n - 1


@njit(cache=True)
def turn(direction: float, mean: float, concentration: float, kept: float, state: UIntArray) -> float:
    """The direction a step later: Eq. 4 of the vehicle's own and its mode's; `kept` is e^{-k dt}."""
    own = concentration * kept / (1.0 - kept * kept)
    usual = concentration / (1.0 + kept)
    away = mean - direction
    along = own + usual * math.cos(away)
    across = usual * math.sin(away)
    return density.draw_von_mises(direction + math.atan2(across, along), math.hypot(along, across), state)


@njit(cache=True)
def accelerate(speed: float, shape: float, rate: float, kept: float, state: UIntArray) -> float:
    """The speed a step later: the exact step of the Cox-Ingersoll-Ross process; `kept` is e^{-k dt}.

    A noncentral chi-square of 2 shape degrees of freedom, which is a shifted normal squared plus a gamma.
    """
    root = math.sqrt(2.0 * rate * speed * kept / (1.0 - kept)) + density.draw_normal(state)
    return (0.5 * root * root + density.draw_gamma(shape - 0.5, state)) * (1.0 - kept) / rate


@njit(cache=True)
def advance(table: MotionTable, cloud: Cloud, v: int, dt_s: float) -> None:
    """Move a vehicle's particles by `dt_s` in steps of at most `step_s`, along each step's mean direction and speed.

    All particles in one call: arguments that hold arrays are counted at every call, by all threads.
    """
    state = cloud.state[v].copy()  # of its own memory, or threads would count references to one array in turns
    n_steps = max(1, math.ceil(dt_s / table.step_s - 1e-9))
    h = dt_s / n_steps
    takes_up = 1.0 - math.exp(-table.mode_rate * h)
    slip = math.sqrt(table.drift * h)
    direction_kept = math.exp(-table.direction_rate * h)
    lane_lost = 1.0 - math.exp(-table.lane_rate * h)
    for p in range(cloud.position.shape[1]):
        x, y = cloud.position[v, p, 0], cloud.position[v, p, 1]
        direction, speed = cloud.direction[v, p], cloud.speed[v, p]
        cell, mode = cloud.cell[v, p], cloud.mode[v, p]
        goal, mode = mode // 1000, mode % 1000
        for _ in range(n_steps):
            here = locate(table.locator, x, y)
            if here != cell:
                if cell >= 0 and here >= 0 and mode < table.n_own:
                    he, hn = offset_in(table, cell, x, y)
                    was = table.mean[cell, mode] + table.bend[cell, mode, 0] * he + table.bend[cell, mode, 1] * hn
                    mode = follow(table, cell, mode, here, x, y, direction, speed, True, goal, state)
                    he, hn = offset_in(table, here, x, y)
                    jump = density.wrap(table.mean[here, mode] + table.bend[here, mode, 0] * he + table.bend[here, mode, 1] * hn - was)
                    if abs(jump) > table.carry_from and math.cos(direction - was) > 0.5:
                        direction = density.wrap(direction + jump)
                else:
                    mode = draw_mode(table, here, x, y, direction, speed, True, state)
                cell = here
                if mode < table.n_own and cell >= 0 and table.goal_p[cell, mode, goal] < 0.003:
                    goal = draw_goal(table, cell, mode, state)
            elif cell >= 0 and mode < table.n_own:
                if density.uniform(state) < table.leave[cell, mode] * h:
                    mode = follow(table, cell, mode, cell, x, y, direction, speed, True, goal, state)
            elif density.uniform(state) < takes_up:
                    mode = draw_mode(table, cell, x, y, direction, speed, False, state)
            rate = table.rate[cell, mode]
            ahead = 1.0
            if table.draws[cell, mode]:
                east, north = offset_in(table, cell, x, y)
                bend, gain = table.bend[cell, mode], table.gain[cell, mode]
                mean = table.mean[cell, mode] + bend[0] * east + bend[1] * north
                rate *= math.exp(-gain[0] * east - gain[1] * north)
                # So the deviation of the speed is a share of it, and goes along with the gain.
                ahead = math.exp((gain[0] * math.cos(direction) + gain[1] * math.sin(direction)) * speed * h)
                # The deviation from the mode relaxes, not the direction: a vehicle on a bend turns with the bend.
                carried = (bend[0] * math.cos(direction) + bend[1] * math.sin(direction)) * speed * h
                turned = turn(
                    direction + carried, mean + carried, table.concentration[cell, mode], direction_kept, state
                )
            else:
                turned = direction + math.sqrt(table.turning * h * min(speed / 5.0, 1.0)) * density.draw_normal(state)
            kept = math.exp(-table.speed_rate[cell, mode] * h)
            faster = accelerate(speed * ahead, table.shape[cell, mode], rate / ahead, kept, state)
            middle, distance = 0.5 * (direction + turned), 0.5 * (speed + faster) * h
            middle += table.slip[cell, mode]
            swing = table.lead * (turned - direction)
            x += distance * math.cos(middle) - swing * math.sin(middle) + slip * density.draw_normal(state)
            y += distance * math.sin(middle) + swing * math.cos(middle) + slip * density.draw_normal(state)
            if table.hold[cell, mode] > 0.0:
                e, c, s = beside(table, cell, mode, x, y)
                x += e * lane_lost * s
                y -= e * lane_lost * c
            direction, speed = density.wrap(turned), faster
        cloud.position[v, p, 0], cloud.position[v, p, 1] = x, y
        cloud.direction[v, p], cloud.speed[v, p] = direction, speed
        cloud.cell[v, p], cloud.mode[v, p] = cell, mode + 1000 * goal
    cloud.state[v] = state


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
    """Give every particle the cell of its position and a mode that fits its direction and speed."""
    for v in vehicle:
        state = cloud.state[v]
        for p in range(cloud.position.shape[1]):
            x, y = cloud.position[v, p, 0], cloud.position[v, p, 1]
            cell = locate(table.locator, x, y)
            cloud.cell[v, p] = cell
            mode = draw_mode(table, cell, x, y, cloud.direction[v, p], cloud.speed[v, p], True, state)
            cloud.mode[v, p] = mode + 1000 * draw_goal(table, cell, mode, state)


@njit(cache=True, nogil=True)
def be_born(
    table: MotionTable, cloud: Cloud, vehicle: IntArray, key: UIntArray, measured: FloatArray, noise: float
) -> None:
    """Draw a new belief from one measurement: positions around it, direction and speed from the primitive there."""
    for i in range(vehicle.size):
        v = vehicle[i]
        state = cloud.state[v]
        density.seed_state(key[i], state)
        n = cloud.position.shape[1]
        for p in range(n):
            x = measured[i, 0] + noise * density.draw_normal(state)
            y = measured[i, 1] + noise * density.draw_normal(state)
            cell = locate(table.locator, x, y)
            left, mode = density.uniform(state), 0
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
            cloud.direction[v, p] = density.wrap(density.draw_von_mises(mean, table.concentration[cell, mode], state))
            cloud.speed[v, p] = density.draw_gamma(table.shape[cell, mode], state) / rate
            cloud.cell[v, p], cloud.mode[v, p] = cell, mode
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
    numbers = np.empty((n, 4))
    labels = np.empty((n, 2), np.int64)
    for v in vehicle:
        systematic(cloud.log_weight[v], density.uniform(cloud.state[v]), ancestor)
        for p in range(n):
            a = ancestor[p]
            numbers[p, 0], numbers[p, 1] = cloud.position[v, a, 0], cloud.position[v, a, 1]
            numbers[p, 2], numbers[p, 3] = cloud.direction[v, a], cloud.speed[v, a]
            labels[p, 0], labels[p, 1] = cloud.cell[v, a], cloud.mode[v, a]
        for p in range(n):
            cloud.position[v, p, 0], cloud.position[v, p, 1] = numbers[p, 0], numbers[p, 1]
            cloud.direction[v, p], cloud.speed[v, p] = numbers[p, 2], numbers[p, 3]
            cloud.cell[v, p], cloud.mode[v, p] = labels[p, 0], labels[p, 1]
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
