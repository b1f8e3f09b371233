"""Columns that most logs do not have: as long as the others, and where no row is known, one row stands for all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray


def unknown(*shape: int) -> FloatArray:
    """(n, ...) of NaN, that takes no memory."""
    return np.broadcast_to(np.nan, shape)


def is_held(column: AnyArray) -> bool:
    """Whether some row may be known; False where one row stands for all, as in what `unknown` made."""
    return any(column.strides)


def chosen(column: AnyArray, rows: BoolArray | IntArray | slice) -> AnyArray:
    """The chosen rows, by mask, indices or slice."""
    if is_held(column):
        return column[rows]
    n = np.broadcast_to(False, len(column))[rows].size
    return np.broadcast_to(column[:1], (n, *column.shape[1:]))


def joined(parts: Sequence[AnyArray]) -> AnyArray:
    """All rows of all parts, of which there is at least one."""
    if any(map(is_held, parts)):
        return np.concatenate(parts)
    n = sum(map(len, parts))
    return np.broadcast_to(np.concatenate([part[:1] for part in parts])[:1], (n, *parts[0].shape[1:]))
