"""JSON messages: the wanted fields by their names alone; a JSON schema, where there is one, is not needed.

Times are objects of seconds and nanoseconds (Foxglove: sec, nsec; ROS: sec, nanosec; protobuf's own: seconds,
nanos), whole nanoseconds, or RFC 3339 texts. As protobuf's JSON mapping has it, a number may stand in quotes, and a
part of a time that is left out is 0.

Source: RFC 8259; https://docs.foxglove.dev/docs/sdk/schemas; https://protobuf.dev/programming-guides/json.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from dirprim_filter.arrays import AnyArray, IntArray
from dirprim_filter.recording.decoding._kernels import MAX_ELEMENTS
from dirprim_filter.recording.decoding.column_plan import CLOCKS, MOST_CELLS, TooManyRowsError
from dirprim_filter.recording.decoding.field_columns import (
    EACH,
    MAX_NAME_LENGTH,
    NANOSECONDS,
    NO_TIME,
    Column,
    Field,
    FieldColumns,
    Kind,
    bounded,
    iso_nanoseconds,
    steps_of,
)

_CLOCK_NAMES = frozenset(name for names in CLOCKS for name in names)
_WHOLE = re.compile(r"-?[0-9]{1,20}")
_NUMBER = re.compile(r"-?[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?|NaN|-?Infinity")
EXACT = 2.0**53
"""Whole numbers from here on are not all floats, so ids that differ may be one."""


class _UnlikeError(ValueError):
    """A value is not of the kind that is wanted there."""


NOTHING: dict[Kind, str | int | float] = {"name": "", "time": NO_TIME, "number": 0.0, "presence": 0.0}
"""By what is wanted: what stands where it is missing, of the column's type."""
Steps = list[tuple[str, int | None]]


class JsonPlan:
    """Reads the wanted fields of JSON messages; those that a message lacks are missing."""

    def __init__(self, fields: Mapping[str, Field]) -> None:
        self._fields = fields
        paths = (one.path for one in fields.values())
        tables = sorted(
            {path[: i + 2] for path in paths for i in range(len(path)) if path.startswith("[]", i)}, key=len
        )
        self._tables: dict[str, tuple[str, Steps]] = {}
        for table in tables:  # an element has a row above it even where nothing is wanted of that
            above = Field(path=table[:-2]).table
            self._tables[table] = above, steps_of(table[len(above) :])
        self._steps = {
            label: steps_of(rest) if (rest := one.path[len(one.table) :]) else [] for label, one in fields.items()
        }

    def read(self, data: AnyArray, start: IntArray, stop: IntArray) -> FieldColumns:
        """As `ColumnPlan.read`."""
        rows: dict[str, tuple[list[int], list[int]]] = {table: ([], []) for table in ("", *self._tables)}
        columns: dict[str, list[Any]] = {label: [] for label in self._fields}
        failures: dict[int, str] = {}
        for message, (first, end) in enumerate(zip(start.tolist(), stop.tolist(), strict=True)):
            try:
                found, values = self._taken(json.loads(data[first:end].tobytes()))
            except (ValueError, OverflowError, RecursionError) as error:
                failures[message] = f"no JSON of its schema: {error}"
                found, values = self._taken(None)
            base = {table: len(numbers) for table, (numbers, _) in rows.items()}
            for table, items in found.items():
                above = base[self._tables[table][0]] if table else message
                rows[table][0].extend([message] * len(items))
                rows[table][1].extend(above + i for i, _ in items)
            for label, of_rows in values.items():
                columns[label] += of_rows
            if len(start) > 1 and sum(map(len, columns.values())) > MOST_CELLS:
                raise TooManyRowsError
        return FieldColumns(
            fields=self._fields,
            n_messages=len(start),
            rows={path: (np.array(m, np.int64), np.array(p, np.int64)) for path, (m, p) in rows.items()},
            columns={label: _column(self._fields[label].kind, values) for label, values in columns.items()},
            data=np.empty(0, np.uint8),
            failures=failures,
        )

    def _taken(self, message: Any) -> tuple[dict[str, list[tuple[int, Any]]], dict[str, list[Any]]]:
        """By table the rows of a message, each the number of that above and what it holds; by label the values."""
        rows = {"": [(0, message)]}
        for table, (above, steps) in self._tables.items():
            rows[table] = [(i, item) for i, (_, of) in enumerate(rows[above]) for item in _below(of, steps) or ()]
            if len(rows[table]) > MAX_ELEMENTS:
                raise _UnlikeError(f"expected at most {MAX_ELEMENTS} elements of {table}, got {len(rows[table])}")
        return rows, {
            label: [_converted(one, _below(of, self._steps[label])) for _, of in rows[one.table]]
            for label, one in self._fields.items()
        }


def _below(value: Any, steps: Steps) -> Any:
    """What stands some steps below a value; None where it is missing."""
    for name, selector in steps:
        if value is None:
            return None
        if not isinstance(value, dict):
            raise _UnlikeError(f"expected an object with {name!r}, got {type(value).__name__}")
        value = value.get(name)
        if selector is not None and value is not None:
            if not isinstance(value, list):
                raise _UnlikeError(f"expected a list at {name!r}, got {type(value).__name__}")
            if selector != EACH:
                value = value[selector] if selector < len(value) else None
    return value


def _converted(one: Field, value: Any) -> Any:
    """A value as its column holds it; None where it is missing."""
    kind = one.kind
    if kind == "presence":
        return value is not None
    if value is None:
        return None
    if kind == "time" and isinstance(value, float):
        raise _UnlikeError(f"expected whole nanoseconds at {one.path}, got a decimal fraction; time_s= takes seconds")
    if kind == "time":
        return bounded(_time(value))
    if kind == "name" and isinstance(value, float):  # of writers that have one kind of number
        value = int(value) if abs(value) < EXACT and value.is_integer() else "" if math.isnan(value) else value
    if kind == "name" and isinstance(value, str | int):
        name = str(value)[: MAX_NAME_LENGTH + 1]
        if name.endswith("\0"):
            raise _UnlikeError(f"expected a name without NUL characters at its end at {one.path}, got {name[:40]!r}")
        name.encode()  # half a surrogate pair is no text: refused here, not where the name is written
        return name
    if kind == "number" and (
        isinstance(value, bool | int | float) or (isinstance(value, str) and _NUMBER.fullmatch(value))
    ):
        return float(value)
    raise _UnlikeError(f"expected a {kind} at {one.path}, got {str(value)[:40]!r}")


def _time(value: Any) -> int:
    """Nanoseconds."""
    if isinstance(value, dict) and (not value or not _CLOCK_NAMES.isdisjoint(value)):
        halves = ([names[half] for names in CLOCKS] for half in (0, 1))
        seconds, nanos = (_whole(next((value[n] for n in names if value.get(n) is not None), 0)) for names in halves)
        return seconds * NANOSECONDS + nanos
    if isinstance(value, str) and (time_ns := iso_nanoseconds(value)) is not None:
        return time_ns
    return _whole(value)


def _whole(value: Any) -> int:
    if isinstance(value, int) and not isinstance(value, bool):
        return value
    if isinstance(value, str) and _WHOLE.fullmatch(value):
        return int(value)
    raise _UnlikeError(f"expected a time, got {str(value)[:40]!r}")


def _column(kind: Kind, values: list[Any]) -> Column:
    nothing = NOTHING[kind]
    missing = np.array([value is None for value in values], np.bool_)
    return Column(values=np.array([nothing if v is None else v for v in values], type(nothing)), missing=missing)
