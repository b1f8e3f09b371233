"""Tables of Parquet, Feather and Arrow files, by pyarrow (extra `parquet`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from dirprim_filter.arrays import AnyArray, IntArray
from dirprim_filter.detections import NO_ID
from dirprim_filter.recording.decoding.field_columns import NO_TIME
from dirprim_filter.recording.errors import MissingExtraError, TableError
from dirprim_filter.recording.tables.delimited import MAX_SECONDS
from dirprim_filter.recording.tables.named_columns import (
    DETECTED,
    FLOATS,
    LABEL,
    SENSOR,
    SIGNAL,
    SIZE,
    TIME_NS,
    places_of,
    refuse_degrees,
    signal_cues,
    vehicle_columns,
)
from dirprim_filter.recording.tables.table import Table, table_of
from dirprim_filter.recording.vehicle_rows import VehicleRows

PARQUET = b"PAR1"
"""How such files begin; Feather and Arrow files do otherwise."""
REMEDY = "write the table anew"


def read_arrow(path: str | Path, *, columns: Mapping[str, str] | None = None) -> Table:
    """The tracks of a Parquet, Feather or Arrow file; `named_columns` lists its columns.

    In place of `time_s` it may have `time_ns`: whole nanoseconds, or timestamps. Other than that it is read as by
    `read_csv`; null is an empty cell.

    Args:
        path: the file.
        columns: how the table calls a column, by our name for it; left out, as we do.

    Raises:
        TableError: the file is none of these, or a column is missing, in another unit or of another type.
        MissingExtraError: pyarrow is not installed.
        OSError: the file cannot be read.
    """
    table = ArrowTable(path)
    columns = columns or {}
    has_ns = TIME_NS in table.names or TIME_NS in columns
    required = (TIME_NS if has_ns else DETECTED[0], *DETECTED[1:])
    place, unused = places_of(table.path, "its columns", table.names, columns, required=required)
    present = {name: table.names[at] for name, at in place.items()}
    read: dict[str, AnyArray] = {
        name: table.floats(present[name]) for name in ("x_m", "y_m", *FLOATS, *SIZE) if name in present
    }
    read[TIME_NS] = table.nanoseconds(present[TIME_NS]) if has_ns else table.seconds(present["time_s"])
    if "group" in present:
        read["group"] = table.whole_numbers(present["group"])
    label, sensor, ids = (
        table.texts(present[name]) if name in present else None for name in (LABEL, SENSOR, "track_id")
    )
    cue = signal_cues(table.path, None, table.texts(present[SIGNAL])) if SIGNAL in present else None
    ids = np.full(len(read["x_m"]), NO_ID) if ids is None else ids
    rows = VehicleRows.of(ids, cue=cue, **vehicle_columns(read))
    refuse_degrees(table.path, rows)
    return table_of(rows, label=label, sensor=sensor, unused=unused)


class ArrowTable:
    """The columns of a file; each is read when it is asked for.

    Attributes:
        path: the file.
        names: of its columns.

    Raises:
        TableError: it is no such file, or has no rows.
        MissingExtraError: pyarrow is not installed.
        OSError: it cannot be read.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._arrow = pyarrow(path)
        with self.path.open("rb") as file:
            is_parquet = file.read(len(PARQUET)) == PARQUET
        try:
            self._table = (self._arrow.parquet if is_parquet else self._arrow.feather).read_table(
                self.path, memory_map=True
            )
        except (self._arrow.ArrowException, OSError) as error:
            raise TableError(self.path, "", "a Parquet, Feather or Arrow file", _line(error), REMEDY) from error
        self.names: list[str] = self._table.column_names
        if not self._table.num_rows:
            raise TableError(self.path, "", "rows", "none", "check how the table was made")

    def floats(self, name: str) -> AnyArray:
        """(n,) float64; NaN where there is none."""
        column = self._cast(name, self._arrow.float64(), "numbers", safe=False)  # of whole numbers the nearest
        return np.asarray(column.to_numpy(), np.float64)

    def whole_numbers(self, name: str, *, missing: int | None = None) -> IntArray:
        """(n,) int64; `missing` where there is none.

        Raises:
            TableError: it has other types, or one is missing and none stands for it.
        """
        column = self._cast(name, self._arrow.int64(), "whole numbers")
        if column.null_count and missing is None:
            raise TableError(self.path, f"column {name}", "whole numbers", f"{column.null_count} nulls", REMEDY)
        return np.asarray(column.fill_null(missing or 0).to_numpy(), np.int64)

    def texts(self, name: str) -> AnyArray:
        """(n,) str; empty where there is none."""
        column = self._cast(name, self._arrow.string(), "texts or whole numbers").fill_null("")
        each = column.combine_chunks().dictionary_encode()  # Python makes a text of each name, not of each row
        return np.asarray(np.array(each.dictionary.to_pylist(), np.str_)[each.indices.to_numpy()])

    def nanoseconds(self, name: str) -> IntArray:
        """(n,) int64 of whole numbers or of timestamps; `NO_TIME` where there is none."""
        if self._arrow.types.is_timestamp(self._column(name).type):
            self._table = self._table.set_column(
                self.names.index(name), name, self._cast(name, self._arrow.timestamp("ns"), "times")
            )
        return self.whole_numbers(name, missing=NO_TIME)

    def seconds(self, name: str) -> IntArray:
        """(n,) nanoseconds of a column of seconds; `NO_TIME` where there is none."""
        seconds = self.floats(name)
        known = np.isfinite(seconds)
        if (np.abs(seconds[known]) > MAX_SECONDS).any():
            got = f"{np.abs(seconds[known]).max():g}"
            raise TableError(self.path, f"column {name}", "seconds", got, "name whole nanoseconds time_ns")
        whole = np.floor(np.where(known, seconds, 0.0))
        rest = np.where(known, seconds, 0.0) - whole
        return np.where(known, whole.astype(np.int64) * 1_000_000_000 + np.rint(rest * 1e9).astype(np.int64), NO_TIME)

    def require(self, names: Sequence[str]) -> None:
        """All these columns are there.

        Raises:
            TableError: otherwise.
        """
        missing = [name for name in names if name not in self.names]
        if missing:
            raise TableError(
                self.path, "", f"columns {', '.join(names)}", ", ".join(self.names), f"missing: {', '.join(missing)}"
            )

    def _column(self, name: str) -> Any:
        return self._table[self.names.index(name)]

    def _cast(self, name: str, kind: Any, what: str, *, safe: bool = True) -> Any:
        column = self._column(name)
        if self._arrow.types.is_boolean(column.type) and kind != self._arrow.string():
            raise TableError(self.path, f"column {name}", what, "bool", "write it in this type")
        try:
            return column.cast(kind, safe=safe)
        except self._arrow.ArrowException as error:
            got = f"{column.type} ({_line(error)})"
            raise TableError(self.path, f"column {name}", what, got, "write it in this type") from error


def pyarrow(path: str | Path) -> Any:
    """The library that knows Parquet and Feather.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        import_module("pyarrow.parquet")
        import_module("pyarrow.feather")
        return import_module("pyarrow")
    except ImportError as error:
        raise MissingExtraError(str(path), library="pyarrow", extra="parquet") from error


def _line(error: Exception) -> str:
    return str(error).partition("\n")[0]
