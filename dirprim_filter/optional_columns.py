"""Columns that most logs do not have: as long as the others, and where no row is known, one NaN stands for all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray


def unknown(*shape: int) -> FloatArray:
    """(n, ...) of NaN, that takes no memory."""
    return np.broadcast_to(np.nan, shape)


def is_held(column: FloatArray) -> bool:
    """Whether some row may be known; False for what `unknown` made."""
    return any(column.strides)


def chosen(column: FloatArray, rows: BoolArray | IntArray | slice) -> FloatArray:
    """The chosen rows, by mask, indices or slice."""
    if is_held(column):
        return column[rows]
    return unknown(np.broadcast_to(False, len(column))[rows].size, *column.shape[1:])


def joined(parts: Sequence[FloatArray]) -> FloatArray:
    """All rows of all parts, of which there is at least one."""
    if any(map(is_held, parts)):
        return np.concatenate(parts)
    return unknown(sum(map(len, parts)), *parts[0].shape[1:])
