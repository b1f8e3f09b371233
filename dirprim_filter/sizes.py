"""How large bodies are: length along x, width along y, height along z of the body's axes, as REP 103 has them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dirprim_filter.arrays import FloatArray
from dirprim_filter.optional_columns import is_held, unknown


def known_sizes(reported: FloatArray) -> FloatArray:
    """(n, 3) as a file reports it; what is not positive and finite is unknown, as are unset fields."""
    return np.where((reported > 0) & (reported < np.inf), reported, np.nan)


def as_sizes(value: npt.ArrayLike, n: int) -> FloatArray:
    """(n, 3) metres, NaN where unknown; an empty column stands for one without known sizes.

    Raises:
        ValueError: another shape, or a number that is not positive.
    """
    size = np.asarray(value, dtype=np.float64)
    if size.shape[:1] == (0,):
        return unknown(n, 3)
    if size.shape != (n, 3):
        raise ValueError(f"size: expected shape ({n}, 3), got {size.shape}")
    if not is_held(size):
        return size
    missing = np.isnan(size)
    if missing.all():
        return unknown(n, 3)
    wrong = ~missing & ~((size > 0) & (size < np.inf))
    if wrong.any():
        row = int(np.argmax(wrong.any(axis=1)))
        raise ValueError(f"size: expected metres above 0, or NaN where unknown, got {size[row]} in row {row}")
    return size
