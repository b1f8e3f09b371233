"""How large bodies are: length along x, width along y, height along z of the body's axes, as REP 103 has them.

A column of sizes is as long as the others; where no row tells one, it takes no memory: one NaN stands for all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tessellation.arrays import BoolArray, FloatArray, IntArray


def unknown_sizes(n: int) -> FloatArray:
    """(n, 3) of NaN, that takes no memory."""
    return np.broadcast_to(np.nan, (n, 3))


def has_sizes(size: FloatArray) -> bool:
    """Whether a column may tell of some row; False for what `unknown_sizes` made."""
    return size.strides != (0, 0)


def known_sizes(told: FloatArray) -> FloatArray:
    """(n, 3) as a file tells it; what is not positive and finite is unknown, as is what nobody set."""
    return np.where((told > 0) & (told < np.inf), told, np.nan)


def as_sizes(value: npt.ArrayLike, n: int) -> FloatArray:
    """(n, 3) metres, NaN where unknown; that of no row is a column that tells nothing.

    Raises:
        ValueError: another shape, or a number that is not positive.
    """
    size = np.asarray(value, dtype=np.float64)
    if size.shape[:1] == (0,):
        return unknown_sizes(n)
    if size.shape != (n, 3):
        raise ValueError(f"size: expected shape ({n}, 3), got {size.shape}")
    if not has_sizes(size):
        return size
    unknown = np.isnan(size)
    if unknown.all():
        return unknown_sizes(n)
    wrong = ~unknown & ~((size > 0) & (size < np.inf))
    if wrong.any():
        row = int(np.argmax(wrong.any(axis=1)))
        raise ValueError(f"size: expected metres above 0, or NaN where unknown, got {size[row]} in row {row}")
    return size


def chosen_sizes(size: FloatArray, rows: BoolArray | IntArray | slice) -> FloatArray:
    """The chosen rows, by mask, indices or slice."""
    if has_sizes(size):
        return size[rows]
    return unknown_sizes(np.broadcast_to(False, len(size))[rows].size)


def joined_sizes(parts: Sequence[FloatArray]) -> FloatArray:
    """All rows of all parts, of which there is at least one."""
    if any(map(has_sizes, parts)):
        return np.concatenate(parts)
    return unknown_sizes(sum(map(len, parts)))
