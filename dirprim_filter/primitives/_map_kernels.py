"""Compiled densities and samples of a map, row by row: find the cell, gather its modes, sum or draw.

Modes stand cell by cell, those of weight 0 left out, all numbers of a mode side by side: a row reads one stretch of
memory. A block's (row, mode) pairs are written one after the other, and their sines and exponentials then taken in
loops that the compiler turns into vector instructions.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions._blocks import ROWS
from dirprim_filter.distributions._elementary import exp, log, squared_sine, wrap
from dirprim_filter.distributions._random import UIntArray
from tessellation._compiling import COMPILED, INLINED
from tessellation._kernels import Locator, locate

PAIRS = 1024  # (row, mode) pairs at a time: the buffers stay in the cache
LOG_OF_ZERO = -1e300  # times a shape less one: nothing for shape 1, without end for any other
BEYOND = 1e280  # what only a multiple of LOG_OF_ZERO exceeds
SMALLEST_NORMAL = 2.2250738585072014e-308
TOO_SMALL = 1e-260  # in a sum of exponentials below it the least that `exp` gives is felt

TOO_LARGE = 1e280  # likewise above it, where `exp` stops

# Columns of `MapTable.mode`.
LOG_WEIGHT, LOG_DIRECTION, MEAN, TWICE_CONCENTRATION, LOG_SPEED, SHAPE, RATE = 0, 1, 2, 3, 4, 5, 6
BEND_EAST, BEND_NORTH, GAIN_EAST, GAIN_NORTH, CUMULATIVE, ENVELOPE_Q, ENVELOPE_B = 7, 8, 9, 10, 11, 12, 13
N_COLUMNS = 14


class MapTable(NamedTuple):
    """A map's parameters and what normalises them, as the kernels take them; row -1 is place-free."""

    locator: Locator
    center: FloatArray  # (n_cells + 1, 2)
    first: IntArray  # (n_cells + 1,) the row's modes are `mode[first:last]`
    last: IntArray  # (n_cells + 1,)
    mode: FloatArray  # (n_modes, N_COLUMNS)
    most_modes: int  # of a row
    curved: bool


class Pairs(NamedTuple):
    """What a block's (row, mode) pairs need for their log densities."""

    log_p: FloatArray  # what does not depend on the two below
    half_turn: FloatArray  # half the turn from the mode's mean direction to the row's
    width: FloatArray  # twice the concentration
    growth: FloatArray  # log of what the mode's mean speed has grown by at the row's place
    decay: FloatArray  # rate times speed
    density: FloatArray
    end: IntArray  # of each row's pairs
    log_speed: FloatArray  # of each row
    total: FloatArray  # of each row's densities


class Rows(NamedTuple):
    """Where, which way and how fast; what is not asked for is not read."""

    position: FloatArray  # (n, 2)
    direction: FloatArray  # (n,)
    speed: FloatArray  # (n,)
    of_direction: bool
    of_speed: bool


@njit(nogil=True, **COMPILED)
def log_densities(table: MapTable, rows: Rows, out: FloatArray) -> bool:
    """Fill `out` (n,) with log p(direction, speed | position), or of one alone; False where a row is not finite."""
    size = max(PAIRS, table.most_modes)
    n_rows = size // table.most_modes
    pairs = Pairs(
        np.empty(size), np.empty(size), np.empty(size), np.empty(size), np.empty(size), np.empty(size),
        np.empty(n_rows, np.int64), np.empty(n_rows), np.empty(n_rows),
    )  # fmt: skip
    finite = True
    for begin in range(0, out.size, n_rows):
        stop = min(begin + n_rows, out.size)
        if rows.of_speed:
            _take_logarithms(rows.speed[begin:stop], pairs.log_speed)
        finite = _gather(table, rows, begin, stop, pairs) and finite
        _evaluate(pairs, pairs.end[stop - begin - 1], rows.of_direction, rows.of_speed, table.curved)
        _sum(pairs, out[begin:stop])
        if rows.of_speed:
            for i in range(begin, stop):
                if rows.speed[i] < 0.0:
                    out[i] = -np.inf
    return finite


@njit(error_model="numpy", **COMPILED)
def _take_logarithms(value: FloatArray, out: FloatArray) -> None:
    for i in range(value.size):
        out[i] = log(value[i])
    for i in range(value.size):
        if not value[i] >= SMALLEST_NORMAL:
            out[i] = math.log(value[i]) if value[i] > 0.0 else LOG_OF_ZERO


@njit(**COMPILED)
def _gather(table: MapTable, rows: Rows, begin: int, stop: int, pairs: Pairs) -> bool:
    """Write the pairs of rows `begin` to `stop`; False where a row is not finite."""
    n, finite = 0, True
    of_direction, of_speed, curved, column = rows.of_direction, rows.of_speed, table.curved, table.mode
    for i in range(begin, stop):
        x, y = rows.position[i, 0], rows.position[i, 1]
        cell = locate(table.locator, x, y)
        d, v, log_v = 0.0, 0.0, 0.0
        if of_direction:
            d = wrap(rows.direction[i])
        if of_speed:
            v, log_v = rows.speed[i], pairs.log_speed[i - begin]
        finite = finite and (x - x) + (y - y) + (d - d) + (v - v) == 0.0  # infinity less itself is NaN
        east, north = 0.0, 0.0
        if curved:
            east, north = x - table.center[cell, 0], y - table.center[cell, 1]
        for j in range(table.first[cell], table.last[cell]):
            log_p = column[j, LOG_WEIGHT]
            if of_direction:
                turned = column[j, BEND_EAST] * east + column[j, BEND_NORTH] * north
                log_p += column[j, LOG_DIRECTION]
                pairs.half_turn[n] = 0.5 * (d - column[j, MEAN] - turned)
                pairs.width[n] = column[j, TWICE_CONCENTRATION]
            if of_speed:
                grown = column[j, GAIN_EAST] * east + column[j, GAIN_NORTH] * north
                log_p += column[j, LOG_SPEED] + (column[j, SHAPE] - 1.0) * log_v - column[j, SHAPE] * grown
                pairs.growth[n] = grown
                pairs.decay[n] = column[j, RATE] * v
            pairs.log_p[n] = log_p
            n += 1
        pairs.end[i - begin] = n
    return finite


@njit(**COMPILED)
def _evaluate(pairs: Pairs, n: int, of_direction: bool, of_speed: bool, curved: bool) -> None:
    """The densities of the first `n` pairs, in loops without a branch or a call."""
    log_p = pairs.log_p
    if of_direction:
        half_turn, width = pairs.half_turn, pairs.width
        for p in range(n):
            log_p[p] -= width[p] * squared_sine(half_turn[p])
    if of_speed:
        growth, decay = pairs.growth, pairs.decay
        if curved:
            for p in range(n):
                decay[p] *= exp(-growth[p])
        for p in range(n):
            log_p[p] -= decay[p]
    density = pairs.density
    for p in range(n):
        density[p] = exp(log_p[p])


@njit(error_model="numpy", **COMPILED)
def _sum(pairs: Pairs, out: FloatArray) -> None:
    """The logarithm of the sum over each row's pairs."""
    total, first = pairs.total, 0
    for i in range(out.size):
        last = pairs.end[i]
        row_total = 0.0
        for p in range(first, last):
            row_total += pairs.density[p]
        total[i] = row_total
        first = last
    for i in range(out.size):
        out[i] = log(total[i])
    for i in range(out.size):
        if not TOO_SMALL < total[i] < TOO_LARGE:
            out[i] = _log_sum(pairs.log_p, pairs.end[i - 1] if i > 0 else 0, pairs.end[i])


@njit(**COMPILED)
def _log_sum(log_p: FloatArray, first: int, last: int) -> float:
    """log(sum(exp(log_p[first:last]))), where the exponentials leave the range of a double; NaN where one is."""
    top = -np.inf
    for p in range(first, last):
        top = max(top, log_p[p])
    if abs(top) > BEYOND:
        return math.copysign(np.inf, top)
    total = 0.0
    for p in range(first, last):
        total += math.exp(log_p[p] - top)
    return top + math.log(total)


@njit(**COMPILED | INLINED)
def mode_of(table: MapTable, cell: int, u: float) -> int:
    """The mode of a cell, or of the place-free row -1, whose cumulative weight exceeds an even draw from [0, 1)."""
    j, last = table.first[cell], table.last[cell] - 1
    while j < last and table.mode[j, CUMULATIVE] <= u:
        j += 1
    return int(j)


@njit(nogil=True, **COMPILED)
def draw(table: MapTable, position: FloatArray, key: UIntArray, direction: FloatArray, speed: FloatArray) -> bool:
    """Fill `direction` and `speed` (n,) with a draw at each position (n, 2), each block of rows from its own key.

    False where a position is not finite.
    """
    state = np.empty(4, np.uint64)
    finite = True
    for i in range(direction.size):
        if i % ROWS == 0:
            random.seed_state(key[i // ROWS], state)
        x, y = position[i, 0], position[i, 1]
        finite = finite and (x - x) + (y - y) == 0.0
        cell = locate(table.locator, x, y)
        j = mode_of(table, cell, random.uniform(state))
        turned = table.mode[j, MEAN] + random.draw_turn(
            0.5 * table.mode[j, TWICE_CONCENTRATION], table.mode[j, ENVELOPE_Q], table.mode[j, ENVELOPE_B], state
        )
        rate = table.mode[j, RATE]
        if table.curved:
            east, north = x - table.center[cell, 0], y - table.center[cell, 1]
            turned += table.mode[j, BEND_EAST] * east + table.mode[j, BEND_NORTH] * north
            rate *= math.exp(-(table.mode[j, GAIN_EAST] * east + table.mode[j, GAIN_NORTH] * north))
        direction[i] = wrap(turned)
        speed[i] = random.draw_gamma(table.mode[j, SHAPE], state) / rate
    return finite
