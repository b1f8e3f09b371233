"""JSON messages: the wanted fields by their names alone; a JSON schema, where there is one, is not needed.

Times are objects of seconds and nanoseconds (Foxglove: sec, nsec; ROS: sec, nanosec; protobuf's own: seconds,
nanos), whole nanoseconds, or RFC 3339 texts. As protobuf's JSON mapping has it, a number may stand in quotes, and a
part of a time that is left out is 0.

Source: RFC 8259; https://docs.foxglove.dev/docs/sdk/schemas; https://protobuf.dev/programming-guides/json.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, NamedTuple

import numpy as np

from dirprim_filter.arrays import AnyArray, IntArray
from dirprim_filter.recording.decoding._kernels import MAX_ELEMENTS
from dirprim_filter.recording.decoding.column_plan import CLOCKS, Plan
from dirprim_filter.recording.decoding.field_columns import MAX_NAME_LENGTH, NANOSECONDS, NO_TIME, Column, FieldColumns
from dirprim_filter.recording.decoding.fields import EACH, Field, Kind, Wanted, wanted

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_FRACTION_DIGITS = 9
_CLOCK_NAMES = frozenset(name for names in CLOCKS for name in names)
_DATE_TIME = re.compile(r"([0-9-]{10}[Tt ][0-9:]{8})(?:\.([0-9]+))?([Zz]|[+-][0-9]{2}:[0-9]{2})?")
_WHOLE = re.compile(r"-?[0-9]{1,20}")
_NUMBER = re.compile(r"-?[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?|NaN|-?Infinity")


class _UnlikeError(ValueError):
    """A value is not of the kind that is wanted there."""


class JsonPlan(Plan):
    """Reads the wanted fields of JSON messages; those that a message lacks are missing."""

    def __init__(self, fields: Mapping[str, Field]) -> None:
        self._fields = fields
        self._wanted = wanted(fields)

    def read(self, data: AnyArray, start: IntArray, stop: IntArray) -> FieldColumns:
        """The columns of messages."""
        walk = _Walk(self._fields)
        failures: dict[int, str] = {}
        for message, (first, end) in enumerate(zip(start.tolist(), stop.tolist(), strict=True)):
            kept = walk.sizes()
            try:
                walk.enter(self._wanted, json.loads(data[first:end].tobytes()), "", message, message)
            except (ValueError, OverflowError, RecursionError) as error:
                failures[message] = f"no JSON of its schema: {error}"
                walk.cut(kept)
            walk.ensure_message(message)
        return FieldColumns(
            fields=self._fields,
            n_messages=len(start),
            rows={path: (np.array(m, np.int64), np.array(p, np.int64)) for path, (m, p) in walk.rows.items()},
            columns={label: _column(self._fields[label].kind, values) for label, values in walk.values.items()},
            data=np.empty(0, np.uint8),
            failures=failures,
        )


class _At(NamedTuple):
    """The row that is written."""

    table: str
    message: int
    row: int


class _Walk:
    """Rows and values as they are found."""

    def __init__(self, fields: Mapping[str, Field]) -> None:
        self.rows: dict[str, tuple[list[int], list[int]]] = {"": ([], [])}
        self.rows |= {field.table: ([], []) for field in fields.values()}
        for table in list(self.rows):
            above = table
            while "[]" in above:  # an element has a row above it even where nothing is wanted of that
                above = above[: above[:-2].rfind("[]") + 2] if "[]" in above[:-2] else ""
                self.rows.setdefault(above, ([], []))
        self.values: dict[str, list[Any]] = {label: [] for label in fields}
        self._tables = {table: [label for label, f in fields.items() if f.table == table] for table in self.rows}

    def sizes(self) -> dict[str, int]:
        """How many rows there are, by table."""
        return {table: len(rows[0]) for table, rows in self.rows.items()}

    def cut(self, sizes: Mapping[str, int]) -> None:
        """Go back to so many rows."""
        for table, size in sizes.items():
            for column in (*self.rows[table], *(self.values[label] for label in self._tables[table])):
                del column[size:]

    def ensure_message(self, message: int) -> None:
        """A row in the table of messages, also for one that could not be read."""
        if len(self.rows[""][0]) == message:
            self._append("", message, message)

    def _append(self, table: str, message: int, parent: int) -> int:
        messages, parents = self.rows[table]
        messages.append(message)
        parents.append(parent)
        for label in self._tables[table]:
            self.values[label].append(None)
        return len(messages) - 1

    def enter(self, want: Wanted, value: Any, table: str, message: int, parent: int) -> None:
        """A new row, and what is wanted of an element."""
        self._take(want, value, _At(table, message, self._append(table, message, parent)), table)

    def _take(self, want: Wanted, value: Any, at: _At, path: str) -> None:
        for label, kind in want.labels:
            self.values[label][at.row] = _converted(kind, value)
        if value is None or not want.below:
            return
        if not isinstance(value, dict):
            raise _UnlikeError(f"expected an object at {path or 'the top'}, got {type(value).__name__}")
        for name, selected in want.below.items():
            below = value.get(name)
            for selector, one in selected.items():
                if below is None:
                    continue
                if selector is None:
                    self._take(one, below, at, f"{path}.{name}")
                elif isinstance(below, list):
                    self._elements(one, below, selector, at, f"{path}.{name}")
                else:
                    raise _UnlikeError(f"expected a list at {path}.{name}, got {type(below).__name__}")

    def _elements(self, want: Wanted, items: list[Any], selector: int, at: _At, path: str) -> None:
        if selector == EACH:
            if len(items) > MAX_ELEMENTS:
                raise _UnlikeError(f"expected at most {MAX_ELEMENTS} elements of {path}, got {len(items)}")
            for item in items:
                self.enter(want, item, f"{path}[]", at.message, at.row)
        elif selector < len(items):
            self._take(want, items[selector], at, f"{path}[{selector}]")


def _converted(kind: Kind, value: Any) -> Any:
    """A value as its column holds it; None where it is missing."""
    if kind == "presence":
        return value is not None
    if value is None:
        return None
    if kind == "time":
        return _time(value)
    if kind == "name" and isinstance(value, float) and value.is_integer():
        value = int(value)  # of writers that have one kind of number
    if kind == "name" and isinstance(value, str | int):
        name = str(value)[: MAX_NAME_LENGTH + 1]
        name.encode()  # half a surrogate pair is no text: refused here, not where the name is written
        return name
    if kind == "number" and (
        isinstance(value, bool | int | float) or (isinstance(value, str) and _NUMBER.fullmatch(value))
    ):
        return float(value)
    raise _UnlikeError(f"expected a {kind}, got {str(value)[:40]!r}")


def _time(value: Any) -> int:
    """Nanoseconds; `NO_TIME` beyond int64."""
    if isinstance(value, dict) and (not value or not _CLOCK_NAMES.isdisjoint(value)):
        halves = ([names[half] for names in CLOCKS] for half in (0, 1))
        seconds, nanos = (_whole(next((value[n] for n in names if value.get(n) is not None), 0)) for names in halves)
        return _bounded(seconds * NANOSECONDS + nanos)
    if isinstance(value, str) and (match := _DATE_TIME.fullmatch(value)):
        date_time, fraction, zone = match.groups(default="")
        since = datetime.fromisoformat(date_time + (zone.strip("Zz") or "+00:00")) - _EPOCH
        nanos = int(fraction[:_FRACTION_DIGITS].ljust(_FRACTION_DIGITS, "0"))
        return _bounded((since.days * 86_400 + since.seconds) * NANOSECONDS + nanos)
    return _bounded(_whole(value))


def _whole(value: Any) -> int:
    if isinstance(value, int) and not isinstance(value, bool):
        return value
    if isinstance(value, str) and _WHOLE.fullmatch(value):
        return int(value)
    raise _UnlikeError(f"expected a time, got {str(value)[:40]!r}")


def _bounded(time_ns: int) -> int:
    return time_ns if -(1 << 63) <= time_ns < 1 << 63 else NO_TIME


def _column(kind: Kind, values: list[Any]) -> Column:
    missing = np.array([value is None for value in values], np.bool_)
    if kind == "name":
        return Column(form="names", values=np.array(["" if v is None else v for v in values], dtype=np.str_))
    if kind == "time":
        return Column(
            form="time", values=np.array([NO_TIME if v is None else v for v in values], np.int64), missing=missing
        )
    return Column(
        form="number", values=np.array([0.0 if v is None else v for v in values], np.float64), missing=missing
    )
