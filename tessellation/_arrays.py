"""The array types of every signature, and the check of an argument at a public function."""

from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
AnyArray = npt.NDArray[Any]
Array = TypeVar("Array", bound=npt.NDArray[Any])

FARTHEST_M = 1e9
"""Places are nearer: compiled code squares distances and counts pixels, which must not overflow."""
SHORTEST_M = 1e-6


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
    free, tail = _expected(shape)
    n_free = array.ndim - len(tail)
    fits = n_free == 0 or (free and n_free > 0)
    if not fits or any(n not in (None, own) for n, own in zip(tail, array.shape[n_free:], strict=True)):
        raise ValueError(f"{name}: expected shape ({', '.join(shape.split())}), got {array.shape}")
    if not np.isfinite(array).all():
        place = np.argwhere(~np.isfinite(np.atleast_1d(array)))[0]
        raise ValueError(
            f"{name}: expected finite numbers, got {np.atleast_1d(array)[tuple(place)]} at {tuple(map(int, place))}"
        )
    return array


@lru_cache
def _expected(shape: str) -> tuple[bool, tuple[int | None, ...]]:
    """Whether any axes may come first, and the lengths of the others, None for any."""
    symbols = shape.split()
    free = symbols[:1] == ["..."]
    return free, tuple(int(s) if s.isdigit() else None for s in symbols[free:])


def read_only(array: Array) -> Array:
    """A view that cannot be written to: of arrays that may be and may not be numba compiles two kernels."""
    view = array.view()
    view.flags.writeable = False
    return view


def as_places(name: str, value: npt.ArrayLike, shape: str) -> FloatArray:
    """As `as_floats`, of places in metres.

    Raises:
        ValueError: as `as_floats`, or a place beyond `FARTHEST_M`.
    """
    places = as_floats(name, value, shape)
    if (np.abs(places) > FARTHEST_M).any():
        raise ValueError(f"{name}: expected places within {FARTHEST_M:g} m, got {np.abs(places).max():g} m")
    return places
