"""The array types of every signature, and the checks made once at a public door."""

from dataclasses import fields
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
AnyArray = npt.NDArray[Any]


class ArrayValue:
    """A dataclass over arrays: equal where all its fields are, element by element; NaN equals NaN.

    Dataclasses of it are declared with `eq=False`: what they would compare themselves is tuples, of whose arrays
    Python asks whether they are true.
    """

    __slots__ = ()
    __hash__ = None  # type: ignore[assignment]  # arrays have none

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(_equal(getattr(self, f.name), getattr(other, f.name)) for f in fields(self))  # type: ignore[arg-type]


def _equal(one: Any, other: Any) -> bool:
    if not (isinstance(one, np.ndarray) and isinstance(other, np.ndarray)):
        return bool(one == other)
    return np.array_equal(one, other, equal_nan=one.dtype.kind == other.dtype.kind == "f")


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
