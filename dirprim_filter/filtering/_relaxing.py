"""Compiled: how a vehicle relaxes to the modes of the cells that it passes.

The motion model is Eq. 4 in closed form: the vehicle's own direction, a von Mises whose concentration fades with time,
times the mode of its cell. With e = exp(-k dt) the factors are concentration c e / (1 - e^2) for the vehicle's own and
c / (1 + e) for the mode's; their product is, for small angles, the exact step of an Ornstein-Uhlenbeck process that
settles on the mode, however finely time is cut. Speed takes the exact step of the Cox-Ingersoll-Ross process whose
stationary law is the mode's gamma (Cox, Ingersoll and Ross 1985): a noncentral chi-square.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dirprim_filter.distributions import _kernels as density
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._random import UIntArray
from dirprim_filter.primitives._likening import JourneyTable
from tessellation._kernels import Locator
from tessellation.arrays import BoolArray, FloatArray


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
    n: int = table.weight.shape[1]
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
