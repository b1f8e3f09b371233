"""Tables of columns: struct of arrays, validated once."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import Field, field, fields
from functools import cache
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from dirprim_filter.arrays import AnyArray, ArrayValue, BoolArray, FloatArray, IntArray, as_floats
from dirprim_filter.origin import Origin

LARGEST_ANGLE = 6.3
"""Radians, a turn, rounded; what is beyond it are degrees."""
NAMES = {
    "position": ("x_m", "y_m"), "direction": ("course_rad",), "heading": ("heading_rad",), "speed": ("speed_mps",),
    "size": ("length_m", "width_m", "height_m"), "speed_std": ("speed_std_mps",),
    "covariance": ("covariance_xx_m2", "covariance_xy_m2", "covariance_yy_m2"),
    "cue": ("cue_turn_rad", "cue_concentration"),
}  # fmt: skip
"""What a table calls the columns of a field."""
GLOBE, ORIGIN = ("latitude_deg", "longitude_deg"), ("origin_latitude_deg", "origin_longitude_deg")
"""Columns of places on the Earth, and of the origin of the plane, the same in all rows."""


def required(*shape: int, checked: bool = False) -> Any:
    """A field of finite numbers, (n, *shape); may be `checked` by its name, see `CHECKS`."""
    symbols = " ".join(("n", *map(str, shape)))
    return _column(lambda name, value, _: as_floats(name, value, symbols), shape, checked=checked)


def optional(*shape: int, missing: float = np.nan, checked: bool = False) -> Any:
    """A field of finite numbers, (n, *shape), NaN where unknown; left out, `missing` in all rows."""
    symbols = " ".join(("n", *map(str, shape)))

    def convert(name: str, value: npt.ArrayLike, n: int) -> FloatArray:
        column = np.asarray(value, dtype=np.float64)
        if column.shape[:1] == (0,):
            return np.broadcast_to(missing, (n, *shape))
        if not np.isnan(missing):
            return as_floats(name, column, symbols)
        as_floats(name, np.where(np.isnan(column), 0.0, column), symbols)
        return column if is_held(column) else np.broadcast_to(np.nan, column.shape)  # which takes no memory

    return _column(convert, shape, checked=checked, left_out=missing)


def whole(*, missing: int | None = None) -> Any:
    """A field of int64 numbers (n,); may be left out where it is known what is `missing` then."""

    def convert(name: str, value: npt.ArrayLike, n: int) -> IntArray:
        column = as_whole(name, value)
        return column if column.size or missing is None else np.full(n, missing)

    return _column(convert, dtype=np.int64, left_out=missing)


def ids(convert: Callable[[AnyArray], AnyArray]) -> Any:
    """A field of ids (n,), by what makes them of any."""
    return _column(lambda _, value, __: convert(np.asarray(value)), dtype=np.int64)


def _column(
    convert: Callable[[str, Any, int], AnyArray], shape: tuple[int, ...] = (), *, dtype: Any = np.float64,
    checked: bool = False, left_out: float | None = None,
) -> Any:  # fmt: skip
    """A field by what makes a column of what is given, its name, and the number of rows."""
    about = {"convert": convert, "none": np.empty((0, *shape), dtype), "checked": checked, "left_out": left_out}
    return field(metadata=about) if left_out is None else field(default_factory=lambda: about["none"], metadata=about)


column_fields: Callable[[Any], tuple[Field[Any], ...]] = cache(
    lambda kind: tuple(f for f in fields(kind) if f.metadata)
)
"""The fields of a class of tables that are columns."""


class ArrayTable(ArrayValue):
    """A frozen dataclass of columns, which other tools take as a table; of places it may know the plane's `origin`."""

    __slots__ = ()
    origin: Origin | None

    def __post_init__(self) -> None:
        of_fields = column_fields(type(self))
        n = len(np.atleast_1d(getattr(self, of_fields[0].name)))
        columns = {f.name: f.metadata["convert"](f.name, getattr(self, f.name), n) for f in of_fields}
        if {column.shape[:1] for column in columns.values()} != {(n,)}:
            shapes = ", ".join(f"{name} {column.shape}" for name, column in columns.items())
            raise ValueError(f"columns: expected one length n, got {shapes}")
        for f in of_fields:
            if f.metadata["checked"]:
                check(f.name, columns[f.name])
        self._set(columns | ({"origin": Origin.of(self.origin)} if hasattr(self, "origin") else {}))

    def _set(self, columns: dict[str, Any]) -> None:
        for name, column in columns.items():
            object.__setattr__(self, name, column)

    def __len__(self) -> int:
        return len(getattr(self, column_fields(type(self))[0].name))

    def __getitem__(self, rows: BoolArray | IntArray | slice) -> Self:
        """The chosen rows, by mask, indices or slice; not validated again: a tracker takes rows ten times a frame."""
        of_plane = {"origin": self.origin} if hasattr(self, "origin") else {}
        return self.trusted(**{f.name: getattr(self, f.name)[rows] for f in column_fields(type(self))}, **of_plane)

    def having(self, **columns: Any) -> Self:
        """The same rows with some columns in place of their own, which are not validated."""
        same = ArrayTable.__getitem__(self, slice(None))
        same._set(columns)
        return same

    @classmethod
    def trusted(cls, **columns: Any) -> Self:
        """A table of all its columns as they are, neither converted nor validated: for those that a program made."""
        some = object.__new__(cls)
        some._set(columns)
        return some

    def on_plane(self, origin: Origin | None) -> Self:
        """The same rows on the plane of an origin; without one of their own they are taken to be there.

        Raises:
            ValueError: they have another, too far away.
            ImportError: they have another, and pyproj is not installed.
        """
        if origin is None:
            return self
        own = self.origin
        if own is None or own.is_of(origin):
            return self.having(origin=origin)
        place = origin.to_plane(own.to_globe(getattr(self, "position")))  # noqa: B009 (not all tables have one)
        place = as_floats(f"origin: from {own} to {origin}: position", place, "n 2")
        return self.having(position=place, origin=origin)

    @classmethod
    def none(cls) -> Self:
        """No row."""
        return cls(**{f.name: f.metadata["none"] for f in column_fields(cls)})

    @classmethod
    def concatenate(cls, parts: Iterable[Self]) -> Self:
        """All rows of all parts, in their order; no part gives no row.

        Raises:
            ValueError: rows of planes with different origins.
        """
        parts, columns = list(parts), dict[str, Any]()
        if len(parts) < 2:
            return parts[0] if parts else cls.none()
        if hasattr(cls, "origin"):
            origins = {part.origin for part in [part for part in parts if len(part)] or parts}
            if len(origins) > 1:
                shown = " and ".join(sorted(map(str, origins)))
                raise ValueError(f"origin: expected parts of one plane, got origins {shown}")
            columns["origin"] = origins.pop()
        for f in column_fields(cls):
            own = [getattr(part, f.name) for part in parts]
            is_mixed = len({column.dtype.kind for column in own}) > 1  # numbers among names
            columns[f.name] = np.concatenate([column.astype(np.str_) for column in own] if is_mixed else own)
        return cls(**columns)

    def to_arrow(self) -> Any:
        """A `pyarrow.Table`: `time_ns`, `track_id`, then the columns that are known, named with their units.

        The names are those of csv and Parquet files, so that `read_tracks` reads what is written of it. Where there is
        an origin, the last columns are latitude and longitude, and those of the origin.

        Raises:
            ImportError: there is an origin, and pyproj is not installed.
        """
        import pyarrow as pa  # noqa: PLC0415  (values need no tables)

        table = {name: getattr(self, name) for name in ("time_ns", "track_id") if hasattr(self, name)}
        for f in column_fields(type(self)):
            column, names, left_out = getattr(self, f.name), NAMES.get(f.name, (f.name,)), f.metadata["left_out"]
            if f.name not in table and (left_out is None or np.isfinite(left_out) or is_held(column)):
                flat = column.reshape(len(column), -1)
                table |= {name: flat[:, -1 if name.endswith("yy_m2") else i] for i, name in enumerate(names)}
        if origin := getattr(self, "origin", None):
            degrees = origin.to_globe(np.column_stack([table["x_m"], table["y_m"]]))
            columns = [*degrees.T, *np.broadcast_to(np.reshape(origin, (2, 1)), (2, len(self)))]
            table |= dict(zip((*GLOBE, *ORIGIN), columns, strict=True))
        return pa.table(table)

    def to_pandas(self) -> Any:
        """The same as a `pandas.DataFrame`.

        Raises:
            ImportError: pandas is not installed.
        """
        return self.to_arrow().to_pandas()


def is_held(column: FloatArray) -> bool:
    """Whether some row is known."""
    return not np.isnan(column).all()


def is_covariance(matrix: FloatArray) -> BoolArray:
    """(n, 2, 2) -> (n,) where a matrix is finite, symmetric and positive definite."""
    xx, xy, yx, yy = (matrix[:, i, j] for i in (0, 1) for j in (0, 1))
    with np.errstate(over="ignore", invalid="ignore"):  # of errors beyond all magnitudes
        return np.asarray(np.isfinite(matrix).all(axis=(1, 2)) & (xy == yx) & (xx > 0) & (xx * yy > xy * xy))


LARGEST_VARIANCE = 1e16
"""Square metres: nothing on the Earth is further away than the root of it."""
NO_COVARIANCE = "covariances that are not positive definite, or of more than 1e16 m2, count as unknown"


def known_covariances(reported: FloatArray) -> FloatArray:
    """(n, 2, 2) as a file reports it; what is none, or says nothing of any place, is unknown, as are unset fields."""
    known = is_covariance(reported) & (reported[:, 0, 0] + reported[:, 1, 1] <= LARGEST_VARIANCE)
    return np.where(known[:, None, None], reported, np.nan)


def is_broken_covariance(reported: FloatArray) -> BoolArray:
    """(n, 2, 2) -> (n,) where a variance is stated, but no covariance is known; zeros and -1 state none."""
    is_stated = (reported[:, 0, 0] > 0) | (reported[:, 1, 1] > 0)
    return np.asarray(is_stated & np.isnan(known_covariances(reported)[:, 0, 0]))


_IS_ANGLE = lambda angle: ~(np.abs(angle) > LARGEST_ANGLE), "radians, at most a turn (np.deg2rad converts degrees)"
CHECKS: dict[str, tuple[Callable[[FloatArray], Any], str]] = {
    "direction": _IS_ANGLE, "heading": _IS_ANGLE, "speed": (lambda speed: ~(speed < 0), "at least 0 m/s"),
    "size": (lambda size: ~(size <= 0).any(axis=1), "metres above 0, or NaN where unknown"),
    "covariance": (lambda p: np.isnan(p[:, 0, 0]) | is_covariance(p), "symmetric positive definite matrices, or NaN"),
    "cue": (lambda cue: ~(cue[:, 1] < 0), "a concentration of at least 0"),
    "confidence": (lambda share: ~((share < 0) | (share > 1)), "probabilities from 0 to 1, or NaN where unknown"),
}  # fmt: skip
"""By the name of a column: which of its rows are good, and what is expected. Unknown numbers, NaN, are good."""


def check(name: str, column: FloatArray) -> None:
    """All rows of a column (n, ...) are good.

    Raises:
        ValueError: says what was expected, and the first row that is wrong.
    """
    is_good, expected = CHECKS[name][0](column), CHECKS[name][1]
    if not is_good.all():
        row = int(np.argmin(is_good))
        raise ValueError(f"{name}: expected {expected}, got {column[row].tolist()} in row {row}")


def known_sizes(reported: FloatArray) -> FloatArray:
    """(n, 3) as a file reports it; what is not positive and finite is unknown, as are unset fields."""
    return np.where((reported > 0) & (reported < np.inf), reported, np.nan)


def as_whole(name: str, value: npt.ArrayLike) -> IntArray:
    """Numbers as int64.

    Raises:
        ValueError: not whole numbers, as a float loses nanoseconds in silence; or beyond int64.
    """
    array, limits = np.asarray(value), np.iinfo(np.int64)
    is_whole = array.dtype.kind in "iu" or all(type(number) is int for number in array.flat)
    if not is_whole or (array.size and not limits.min <= array.min() <= array.max() <= limits.max):
        got = f"{array.min()} to {array.max()}" if is_whole else array.dtype
        raise ValueError(f"{name}: expected whole numbers (int64), got {got}")
    return array.astype(np.int64, copy=False)
