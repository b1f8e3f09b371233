"""Compiled counting: the states that vehicles are in, and sums of rows by key."""

import numpy as np
from numba import njit

from dirprim_filter.arrays import AnyArray, IntArray
from tessellation._compiling import COMPILED

MIX = np.uint64(0x9E3779B97F4A7C15)
"""2^64 by the golden ratio: products of numbers that lie close together are spread evenly (Knuth 1973)."""


@njit(nogil=True, **COMPILED)
def summed(order: IntArray, first: IntArray, value: AnyArray) -> IntArray:
    """(m, v) sums of the rows (n, v) in order, from each of `first` (m,) to the next; most are of one row."""
    total = np.empty((first.size, value.shape[1]), np.int64)
    for k in range(first.size):
        a, b = first[k], first[k + 1] if k + 1 < first.size else order.size
        for j in range(value.shape[1]):
            total[k, j] = value[order[a], j]
        for i in order[a + 1 : b]:
            for j in range(value.shape[1]):
                total[k, j] += value[i, j]
    return total


@njit(nogil=True, **COMPILED)
def as_they_come(value: IntArray, number: IntArray) -> IntArray:
    """The different values, numbered as they first come; fills (n,) the number of each, by a hash table."""
    slots = 16
    while slots < 2 * value.size:
        slots *= 2
    table, different, m = np.full(slots, -1, np.int32), np.empty(value.size, np.int64), 0
    for i in range(value.size):
        mixed = np.uint64(value[i]) * MIX
        at = np.int64(mixed >> np.uint64(32)) & (slots - 1)
        while table[at] >= 0 and different[table[at]] != value[i]:
            at = (at + 1) & (slots - 1)
        if table[at] < 0:
            table[at], different[m] = m, value[i]
            m += 1
        number[i] = table[at]
    return different[:m].copy()
