"""The array types of every signature, and the check of an argument at a public function."""

from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
AnyArray = npt.NDArray[Any]


def as_floats(name: str, value: npt.ArrayLike, shape: str) -> FloatArray:
    """`value` as a contiguous, finite float64 array of the stated shape.

    Args:
        name: what the caller calls it; it opens the error message.
        value: anything numpy can turn into an array.
        shape: the expected shape in symbols, trailing axes last: "n", "n 2", "... 2". A number must match; a
            letter matches any length; a leading "..." matches any number of axes.

    Raises:
        ValueError: the shape differs, or an element is NaN or infinite.
    """
    array = np.ascontiguousarray(value, dtype=np.float64)
    if np.ndim(value) == 0:
        array = array.reshape(())
    symbols = shape.split()
    free = symbols[:1] == ["..."]
    tail = symbols[1:] if free else symbols
    fits = array.ndim >= len(tail) if free else array.ndim == len(tail)
    if fits:
        lengths = array.shape[array.ndim - len(tail) :]
        fits = all(not s.isdigit() or int(s) == n for s, n in zip(tail, lengths, strict=True))
    if not fits:
        raise ValueError(f"{name}: expected shape ({', '.join(symbols)}), got {array.shape}")
    if not np.isfinite(array).all():
        place = np.argwhere(~np.isfinite(np.atleast_1d(array)))[0]
        raise ValueError(
            f"{name}: expected finite numbers, got {np.atleast_1d(array)[tuple(place)]} at {tuple(map(int, place))}"
        )
    return array
