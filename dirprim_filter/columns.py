"""Tables of columns: struct of arrays, validated once; of a column of which no row is known one row stands for all."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import field, fields
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from dirprim_filter.arrays import AnyArray, ArrayValue, BoolArray, FloatArray, IntArray, as_floats

LARGEST_ANGLE = 6.3
"""Radians, a turn, rounded; what is beyond it are degrees."""
NAMES = {
    "position": ("x_m", "y_m"), "direction": ("course_rad",), "heading": ("heading_rad",), "speed": ("speed_mps",),
    "size": ("length_m", "width_m", "height_m"), "speed_std": ("speed_std_mps",),
    "covariance": ("covariance_xx_m2", "covariance_xy_m2", "covariance_yy_m2"),
    "cue": ("cue_turn_rad", "cue_concentration"),
}  # fmt: skip
"""What a table calls the columns of a field."""


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
    n = np.arange(len(column))[rows].size
    return column[:n] if n <= len(column) else np.broadcast_to(column[:1], (n, *column.shape[1:]))


def joined(parts: Sequence[AnyArray]) -> AnyArray:
    """All rows of all parts, of which there is at least one."""
    if any(map(is_held, parts)):
        return np.concatenate(parts)
    n = sum(map(len, parts))
    return np.broadcast_to(np.concatenate([part[:1] for part in parts])[:1], (n, *parts[0].shape[1:]))


def required(*shape: int, checked: bool = False) -> Any:
    """A field of finite numbers, (n, *shape); may be `checked` by its name, see `CHECKS`."""
    return field(metadata={"shape": shape, "checked": checked})


def optional(*shape: int, missing: float = np.nan, checked: bool = False) -> Any:
    """A field of finite numbers, (n, *shape), NaN where unknown; left out, `missing` in all rows."""
    return field(default_factory=lambda: np.empty(0), metadata={"shape": shape, "missing": missing, "checked": checked})


def ids(convert: Callable[[AnyArray], AnyArray]) -> Any:
    """A field of ids (n,), by what makes them of any."""
    return field(metadata={"ids": convert})


def groups() -> Any:
    """A field of int64 groups (n,); left out, all 0."""
    return field(default_factory=lambda: np.empty(0, np.int64))


class ArrayTable(ArrayValue):
    """A frozen dataclass of columns with a row for each vehicle and instant, which other tools take as a table."""

    __slots__ = ()
    track_id: AnyArray
    time_ns: IntArray

    def __post_init__(self) -> None:
        n = len(np.atleast_1d(self.time_ns))
        columns: dict[str, AnyArray] = {}
        of_fields = fields(self)  # type: ignore[arg-type]
        for f in of_fields:
            value, shape = getattr(self, f.name), f.metadata.get("shape", ())
            if "ids" in f.metadata:
                columns[f.name] = f.metadata["ids"](np.asarray(value))
            elif f.name == "time_ns":
                columns[f.name] = as_times(f.name, value)
            elif f.name == "group":
                columns[f.name] = as_groups(value, n)
            elif "missing" not in f.metadata:
                columns[f.name] = as_floats(f.name, value, " ".join(map(str, ("n", *shape))))
        check_lengths(columns)
        for f in of_fields:
            if "missing" in f.metadata:
                value, shape, missing = getattr(self, f.name), f.metadata["shape"], f.metadata["missing"]
                columns[f.name] = as_optional(f.name, value, n, *shape, missing=missing)
            if f.metadata.get("checked"):
                check(f.name, columns[f.name])
        self._set(columns)

    def _set(self, columns: dict[str, AnyArray]) -> None:
        for name, column in columns.items():
            object.__setattr__(self, name, column)

    def __len__(self) -> int:
        return int(self.time_ns.size)

    def __getitem__(self, rows: BoolArray | IntArray | slice) -> Self:
        """The chosen rows, by mask, indices or slice."""
        return type(self)(**{f.name: chosen(getattr(self, f.name), rows) for f in fields(self)})  # type: ignore[arg-type]

    @classmethod
    def none(cls) -> Self:
        """No row."""
        shapes = {f.name: f.metadata.get("shape", ()) for f in fields(cls)}  # type: ignore[arg-type]
        columns: dict[str, AnyArray] = {name: np.empty((0, *shape)) for name, shape in shapes.items()}
        return cls(**columns | dict.fromkeys({"track_id", "time_ns", "group"} & set(shapes), np.empty(0, np.int64)))

    @classmethod
    def concatenate(cls, parts: Iterable[Self]) -> Self:
        """All rows of all parts, in their order; no part gives no row."""
        parts = list(parts)
        if len(parts) < 2:
            return parts[0] if parts else cls.none()
        columns = {f.name: joined([getattr(part, f.name) for part in parts]) for f in fields(cls)[1:]}  # type: ignore[arg-type]
        ids = [part.track_id for part in parts]
        mixed = len({of.dtype.kind for of in ids}) > 1
        columns["track_id"] = np.concatenate([of.astype(np.str_) for of in ids] if mixed else ids)
        return cls(**columns)

    def to_arrow(self) -> Any:
        """A `pyarrow.Table`: `time_ns`, `track_id`, then the columns that are known, named with their units.

        The names are those of csv and Parquet files, so that `read_tracks` reads what is written of it.
        """
        import pyarrow as pa  # noqa: PLC0415  (values need no tables)

        table: dict[str, AnyArray] = {"time_ns": self.time_ns, "track_id": self.track_id}
        for f in fields(self):  # type: ignore[arg-type]
            column, names = getattr(self, f.name), NAMES.get(f.name, (f.name,))
            if is_held(column) and f.name not in table:  # else one row stands for all: nowhere known
                flat = column.reshape(len(column), -1)
                table |= {name: flat[:, -1 if name.endswith("yy_m2") else i] for i, name in enumerate(names)}
        return pa.table(table)

    def to_pandas(self) -> Any:
        """The same as a `pandas.DataFrame`.

        Raises:
            ImportError: pandas is not installed.
        """
        return self.to_arrow().to_pandas()


def as_optional(name: str, value: npt.ArrayLike, n: int, *shape: int, missing: float = np.nan) -> FloatArray:
    """(n, *shape), NaN where unknown; an empty column stands for one that is left out.

    Raises:
        ValueError: another shape, or an infinite number.
    """
    column = np.asarray(value, dtype=np.float64)
    if column.shape[:1] == (0,):
        return unknown(n, *shape) if np.isnan(missing) else np.full((n, *shape), missing)
    if not np.isnan(missing):  # then every row is known
        as_floats(name, column, " ".join(map(str, ("n", *shape))))
    if column.shape != (n, *shape):
        raise ValueError(f"{name}: expected shape {(n, *shape)}, got {column.shape}")
    if not is_held(column):
        return column
    if np.isinf(column).any():
        raise ValueError(f"{name}: expected finite numbers, or NaN where unknown, got {column[np.isinf(column)][0]}")
    return unknown(n, *shape) if np.isnan(column).all() else column


def is_covariance(matrix: FloatArray) -> BoolArray:
    """(n, 2, 2) -> (n,) where a matrix is finite, symmetric and positive definite."""
    xx, xy, yx, yy = (matrix[:, i, j] for i in (0, 1) for j in (0, 1))
    with np.errstate(over="ignore", invalid="ignore"):  # of errors beyond all magnitudes
        return np.asarray(np.isfinite(matrix).all(axis=(1, 2)) & (xy == yx) & (xx > 0) & (xx * yy > xy * xy))


_IS_ANGLE = lambda angle: ~(np.abs(angle) > LARGEST_ANGLE), "radians, at most a turn (np.deg2rad converts degrees)"
CHECKS: dict[str, tuple[Callable[[FloatArray], Any], str]] = {
    "direction": _IS_ANGLE, "heading": _IS_ANGLE, "speed": (lambda speed: ~(speed < 0), "at least 0 m/s"),
    "size": (lambda size: ~(size <= 0).any(axis=1), "metres above 0, or NaN where unknown"),
    "covariance": (lambda p: np.isnan(p[:, 0, 0]) | is_covariance(p), "symmetric positive definite matrices, or NaN"),
    "cue": (lambda cue: ~(cue[:, 1] < 0), "a concentration of at least 0"),
}  # fmt: skip
"""By the name of a column: which of its rows are good, and what is expected. Unknown numbers, NaN, are good."""


def check(name: str, column: FloatArray) -> None:
    """All rows of a column (n, ...) are good.

    Raises:
        ValueError: says what was expected, and the first row that is wrong.
    """
    good, expected = CHECKS[name]
    is_good = good(column if is_held(column) else column[:1])
    if not is_good.all():
        row = int(np.argmin(is_good))
        raise ValueError(f"{name}: expected {expected}, got {column[row].tolist()} in row {row}")


def known_sizes(reported: FloatArray) -> FloatArray:
    """(n, 3) as a file reports it; what is not positive and finite is unknown, as are unset fields."""
    return np.where((reported > 0) & (reported < np.inf), reported, np.nan) if is_held(reported) else reported


def as_times(name: str, value: npt.ArrayLike) -> IntArray:
    """Times as int64 nanoseconds.

    Raises:
        ValueError: not whole numbers, as a float loses nanoseconds in silence; or beyond int64.
    """
    return _as_whole(name, value, "nanoseconds")


def as_groups(value: npt.ArrayLike, n: int) -> IntArray:
    """(n,) int64 groups; of none given all 0.

    Raises:
        ValueError: not whole numbers, or beyond int64.
    """
    group = _as_whole("group", value, "numbers")
    return group if group.size else np.zeros(n, np.int64)


def _as_whole(name: str, value: npt.ArrayLike, what: str) -> IntArray:
    array = np.asarray(value)
    is_whole = array.dtype.kind in "iu" or all(type(number) is int for number in array.flat)
    if not is_whole:
        raise ValueError(f"{name}: expected whole {what} (int64), got {array.dtype}")
    limits = np.iinfo(np.int64)
    if array.size and array.dtype.kind != "i" and not (array.min() >= limits.min and array.max() <= limits.max):
        raise ValueError(f"{name}: expected {what} within int64, got {array.min()} to {array.max()}")
    return array.astype(np.int64, copy=False)


def check_lengths(columns: dict[str, AnyArray]) -> None:
    """All columns are of one length.

    Raises:
        ValueError: they are not.
    """
    lengths = {name: column.shape[:1] for name, column in columns.items()}
    if len(set(lengths.values())) > 1 or any(c.ndim == 0 for c in columns.values()):
        shapes = ", ".join(f"{name} {columns[name].shape}" for name in lengths)
        raise ValueError(f"columns: expected one length n, got {shapes}")
