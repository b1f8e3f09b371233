"""The array types of every signature, the checks of arguments at public functions, and equality of array values."""

from dataclasses import fields
from typing import Any, TypeVar

import numpy as np

from tessellation._arrays import AnyArray, BoolArray, FloatArray, IntArray, as_floats, read_only

__all__ = ["AnyArray", "ArrayValue", "BoolArray", "FloatArray", "IntArray", "as_floats", "read_only", "require"]

Kind = TypeVar("Kind")
SUCH = {
    "Generator": ", such as np.random.default_rng(0)",
    "PrimitiveMap": ", as load_map reads it",
    "Sensor": ", as load_sensor reads it",
    "Tracks": ", as read_tracks reads it",
}
"""What leads to a value of a class, for who gives another."""


def require(name: str, value: Any, kind: type[Kind]) -> Kind:
    """The argument, of the class that is expected.

    Raises:
        TypeError: it is of another.
    """
    if not isinstance(value, kind):
        raise TypeError(f"{name}: expected a {kind.__name__}{SUCH.get(kind.__name__, '')}, got {value!r}")
    return value


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
