"""The array types of every signature, the check of an argument at a public function, and equality of array values."""

from dataclasses import fields
from typing import Any

import numpy as np

from tessellation._arrays import AnyArray, BoolArray, FloatArray, IntArray, as_floats

__all__ = ["AnyArray", "ArrayTable", "ArrayValue", "BoolArray", "FloatArray", "IntArray", "as_floats"]


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


class ArrayTable(ArrayValue):
    """Such a value with a row for each vehicle and instant, which other tools take as a table."""

    __slots__ = ()

    def to_arrow(self) -> Any:
        """A `pyarrow.Table`: `time_ns`, `track_id`, then the columns that are known, named with their units.

        The names are those of csv and Parquet files, so that `read_tracks` reads what is written of it.
        """
        import pyarrow as pa  # noqa: PLC0415  (values need no tables)

        table: dict[str, AnyArray] = {"time_ns": self.time_ns, "track_id": self.track_id}  # type: ignore[attr-defined]
        for f in fields(self):  # type: ignore[arg-type]
            column, names = getattr(self, f.name), COLUMNS.get(f.name, (f.name,))
            if any(column.strides) and f.name not in table:  # else one row stands for all: nowhere known
                flat = column.reshape(len(column), -1)
                table |= {name: flat[:, -1 if name.endswith("yy_m2") else i] for i, name in enumerate(names)}
        return pa.table(table)

    def to_pandas(self) -> Any:
        """The same as a `pandas.DataFrame`.

        Raises:
            ImportError: pandas is not installed.
        """
        return self.to_arrow().to_pandas()


COLUMNS = {
    "position": ("x_m", "y_m"), "direction": ("course_rad",), "heading": ("heading_rad",), "speed": ("speed_mps",),
    "size": ("length_m", "width_m", "height_m"), "speed_std": ("speed_std_mps",),
    "covariance": ("covariance_xx_m2", "covariance_xy_m2", "covariance_yy_m2"),
    "cue": ("cue_turn_rad", "cue_concentration"),
}  # fmt: skip
"""What a table calls the columns of a field."""


def _equal(one: Any, other: Any) -> bool:
    if not (isinstance(one, np.ndarray) and isinstance(other, np.ndarray)):
        return bool(one == other)
    return np.array_equal(one, other, equal_nan=one.dtype.kind == other.dtype.kind == "f")
