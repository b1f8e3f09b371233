"""Compiled filling in: vehicles at every step, by cubic Hermite splines between their rows."""

import math

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from tessellation._compiling import COMPILED

TURN = 2.0 * math.pi


@njit(nogil=True, **COMPILED)
def time_to_next(order: IntArray, vehicle: IntArray, time_ns: IntArray, longest_ns: int) -> IntArray:
    """(n,) nanoseconds to the next row in an order by vehicle and time; -1 where a segment ends.

    A segment is a vehicle's rows, no two of which follow each other by more than `longest_ns`.
    """
    apart = np.full(order.size, -1)
    for a in range(order.size - 1):
        i, following = order[a], order[a + 1]
        if vehicle[i] == vehicle[following] and time_ns[following] - time_ns[i] <= longest_ns:
            apart[a] = time_ns[following] - time_ns[i]
    return apart


@njit(nogil=True, **COMPILED)
def at_steps(
    order: IntArray, apart: IntArray, position: FloatArray, direction: FloatArray, speed: FloatArray, step_ns: int
) -> tuple[IntArray, IntArray, FloatArray]:
    """Vehicles every `step_ns` from the first row of each segment on, by Hermite splines.

    Args:
        order: (m,) rows of whole segments, each in order of time.
        apart: (m,) see `time_to_next`.
        position: (n, 2) metres.
        direction: (n,) radians.
        speed: (n,) m/s.
        step_ns: nanoseconds.

    Returns:
        (s,) the row at each step or before it, (s,) the first row of its segment, and (s, 4) metres east and north,
        radians and m/s.
    """
    n, lasts = 0, 0
    for a in range(order.size):
        lasts += max(apart[a], 0)
        if apart[a] < 0:
            n, lasts = n + lasts // step_ns + 1, 0
    row, first, state = np.empty(n, np.int64), np.empty(n, np.int64), np.empty((n, 4))
    k, since, begin = 0, 0, 0  # since: from this row to the next step
    for a in range(order.size):
        i = order[a]
        ends = apart[a] < 0
        while since < apart[a] or (ends and since == 0):
            row[k], first[k] = i, order[begin]
            if since == 0:
                state[k, 0], state[k, 1], state[k, 2], state[k, 3] = position[i, 0], position[i, 1], 0.0, speed[i]
                state[k, 2] = _wrapped(direction[i])
            else:
                _between(i, order[a + 1], apart[a] * 1e-9, since * 1e-9, position, direction, speed, state[k])
            k += 1
            since += step_ns
        since -= apart[a]
        if ends:
            since, begin = 0, a + 1
    return row, first, state


@njit(**COMPILED)
def _between(
    i: int, j: int, h: float, since: float, position: FloatArray, direction: FloatArray, speed: FloatArray,
    state: FloatArray,
) -> None:  # fmt: skip
    """Fills (4,) the state `since` seconds after row i, of which row j is `h` seconds later."""
    u = since / max(h, 1e-9)
    at_i, at_j = (1 + 2 * u) * (1 - u) ** 2, u * u * (3 - 2 * u)
    by_i, by_j = u * (1 - u) ** 2 * h, u * u * (u - 1) * h
    state[0] = (
        at_i * position[i, 0] + by_i * (speed[i] * math.cos(direction[i]))
        + at_j * position[j, 0] + by_j * (speed[j] * math.cos(direction[j]))
    )  # fmt: skip
    state[1] = (
        at_i * position[i, 1] + by_i * (speed[i] * math.sin(direction[i]))
        + at_j * position[j, 1] + by_j * (speed[j] * math.sin(direction[j]))
    )  # fmt: skip
    state[2] = _wrapped(direction[i] + u * _wrapped(direction[j] - direction[i]))
    state[3] = (1 - u) * speed[i] + u * speed[j]


@njit(**COMPILED)
def _wrapped(angle: float) -> float:
    """In [-pi, pi)."""
    turned = angle + math.pi
    return (turned if 0.0 <= turned < TURN else turned % TURN) - math.pi
