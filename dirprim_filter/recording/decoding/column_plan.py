"""A schema's wanted fields as a program of the compiled walks, and its run over a batch of messages."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from typing import Literal

import numpy as np

from dirprim_filter.arrays import AnyArray, IntArray, read_only
from dirprim_filter.recording.decoding import _kernels as kernels
from dirprim_filter.recording.decoding.field_columns import (
    Column,
    Field,
    FieldColumns,
    Place,
    SchemaError,
    Wanted,
    nanoseconds,
    wanted,
)

Form = Literal["int", "unsigned", "float", "double", "cells", "bytes", "presence"]
"""How the 64 bits of a cell are to be read."""
CELL_TYPES = {"double": np.float64, "unsigned": np.uint64}
"""Of those that they are as they stand, but of whole numbers."""
REASONS = {
    kernels.CUT: "a message that ends within a field",
    kernels.OVERLONG: "a length that reaches beyond the message, or beyond its bound",
    kernels.ENCAPSULATION: "an encapsulation that is not read",
    kernels.WIRE_TYPE: "a field of a wire type that protobuf does not have",
    kernels.TOO_MANY: f"more than {kernels.MAX_ELEMENTS} elements of one field",
    kernels.UNEVEN: "bytes behind its last field, as where structures are @final and have no sizes in front",
}
CLOCKS: tuple[tuple[str, str], ...] = (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"), ("seconds", "nanos"))
"""Names of the fields of a time: ROS 2, Foxglove in JSON, ROS 1, and protobuf."""
ENCAPSULATIONS = {
    0x00: "plain CDR", 0x02: "PL_CDR", 0x06: "CDR2", 0x08: "delimited CDR2", 0x0A: "PL_CDR2", 0x10: "CDR2",
    0x12: "PL_CDR2", 0x14: "delimited CDR2", 0x28B4: "zstd that does not decompress, or to far more than it is",
}  # fmt: skip
"""Those of DDS by number, without the bit of the byte order."""


def encapsulation_name(number: int) -> str:
    """For people."""
    return f"encapsulation {number:#06x} ({ENCAPSULATIONS.get(number & ~1, 'unknown')})"


def _reason(status: int) -> str:
    reason, found = REASONS[status & (1 << kernels.STATUS_BITS) - 1], status >> kernels.STATUS_BITS
    return f"{encapsulation_name(found)}, which is not read" if found else reason


class OutputTables:
    """Which tables and columns a program writes; given out while the program is made.

    Attributes:
        schema: its name.
        fields: what is wanted, and the halves of times.
        wanted: the same as one tree, without the halves.
        tables: number by path.
        defaults: a row of each: the message, the row above, then its columns.
        columns: by label, table, column and form.
        clocks: by label, those of its seconds and its nanoseconds.
        presence: by table and column, the columns that are above 0 where its value is there.
    """

    def __init__(self, schema: str, fields: Mapping[str, Field]) -> None:
        self.schema = schema
        self.fields, self.wanted = dict(fields), wanted(fields)
        self.tables: dict[str, int] = {"": 0}
        self.defaults: list[list[int]] = [[0, 0]]
        self.columns: dict[str, tuple[int, int, Form]] = {}
        self.clocks: dict[str, tuple[str, ...]] = {}
        self.presence: dict[tuple[int, int], list[int]] = {}

    def error(self, text: str) -> SchemaError:
        """Of the schema, to be raised."""
        return SchemaError(f"{self.schema}: {text}")

    def table(self, path: str) -> int:
        """The number of a table, made at first."""
        if path not in self.tables:
            self.tables[path] = len(self.defaults)
            self.defaults.append([0, 0])
        return self.tables[path]

    def column(self, table: int, default: int = 0) -> int:
        """A new column."""
        self.defaults[table].append(default)
        return len(self.defaults[table]) - 1

    def value(self, want: Wanted, at: Place, form: Form, default: int = 0) -> int:
        """A column for a value that is there when all of the place's presence are set; its number."""
        column = self.column(at.table, default)
        for label, kind in want.labels:
            if kind == "time" and form not in ("int", "unsigned"):
                way = "; time_s= takes seconds" if form in ("float", "double") else ""
                raise self.error(f"expected a time at {self.fields[label].path}, got a {form}{way}")
            if kind == "presence" and form != "presence":
                raise self.error(f"expected a message at {self.fields[label].path}, got a {form}")
            if kind == "number" and form in ("cells", "bytes"):
                raise self.error(f"expected a number at {self.fields[label].path}, got text")
            self.columns[label] = (at.table, column, form)
        if at.presence:
            self.presence[at.table, column] = list(at.presence)
        return column

    def clock(self, label: str, members: Container[str], below: dict[str, dict[int | None, Wanted]]) -> None:
        """Ask for the halves of a time, among the `members` of its message.

        Raises:
            SchemaError: they are not those of a time, or are a half of one.
        """
        path, is_half = self.fields[label].path, "/" in label
        names = next((names for names in CLOCKS if all(name in members for name in names)), None)
        if names is None or is_half:
            raise self.error(f"expected a time at {path}, got another message")
        self.clocks[label] = tuple(f"{label}/{part}" for part in names)
        for half, part in zip(self.clocks[label], names, strict=True):
            self.fields[half] = Field(path=f"{path}.{part}")
            below.setdefault(part, {}).setdefault(None, Wanted()).labels.append((half, "number"))

    def check(self) -> None:
        """The schema has all fields that are not optional.

        Raises:
            SchemaError: names those that it lacks.
        """
        has = self.columns.keys() | self.clocks.keys()
        if lacking := [one.path for label, one in self.fields.items() if label not in has and not one.optional]:
            raise self.error(f"expected the fields {', '.join(lacking)}, which its definition lacks")


SLACK, MOST_TIMES = 1.25, 16
"""Room beside what the messages read so far let expect, and at most so many times what they held: so much memory is
taken for rows that are there, whatever sizes a file claims."""
MOST_CELLS = 1 << 21
"""Of several messages together: of tiny elements a megabyte makes a million rows."""
Walk = Callable[..., bool]
"""A kernel: of data, starts, stops, tables, status, room for its work, and its program."""


class TooManyRowsError(ValueError):
    """Messages hold so many elements, or are encoded so differently, that fewer are to be read at a time."""


class ColumnPlan:
    """A compiled plan: a walk, how many numbers a row of its room has, and the tables that it writes."""

    def __init__(self, output: OutputTables, walk: Walk, depth: int, *program: AnyArray | int) -> None:
        self._output = output
        self._walk = walk
        self._program = program
        self._width = np.array([len(row) for row in output.defaults], np.int64)
        self._defaults = np.array([cell for row in output.defaults for cell in row], np.int64)
        self._default_base = np.cumsum(self._width) - self._width
        self._capacity = np.full(self._width.size, 64, np.int64)
        self._room = (5, max(depth, self._width.size))

    def read(self, data: AnyArray, start: IntArray, stop: IntArray) -> FieldColumns:
        """The columns of the messages that stand in (n_bytes,) uint8 `data`, from (n,) `start` to (n,) `stop`.

        Raises:
            TooManyRowsError: of more than one message.
        """
        data = read_only(data)
        n = len(start)
        status = np.zeros(n, np.int64)
        count = np.zeros(self._width.size, np.int64)
        self._capacity[0] = max(self._capacity[0], n)
        while True:
            size = self._capacity * self._width
            base = np.cumsum(size) - size
            cells = np.empty(int(size.sum()), np.int64)
            count[:] = 0
            status[:] = 0
            tables = kernels.Tables(cells, base, self._width, self._capacity, count, self._defaults, self._default_base)
            if not self._walk(data, start, stop, tables, status, np.zeros(self._room, np.int64), *self._program):
                break
            wider = self._wider(count, stop - start)
            if n > 1 and int((wider * self._width).sum()) > MOST_CELLS:
                raise TooManyRowsError
            self._capacity = wider
        written = [
            np.ascontiguousarray(cells[b : b + c * w].reshape(c, w).T)
            for b, c, w in zip(base, count, self._width.tolist(), strict=True)
        ]
        failed = np.flatnonzero(status)
        columns = FieldColumns(
            fields=self._output.fields,
            n_messages=n,
            rows={path: (written[i][0], written[i][1]) for path, i in self._output.tables.items()},
            columns={label: self._column(written, *place) for label, place in self._output.columns.items()},
            data=data,
            failures={i: _reason(int(status[i])) for i in failed.tolist()},
        )
        for label, halves in self._output.clocks.items():
            seconds, nanos = (columns.columns[half] for half in halves)
            time_ns = nanoseconds(seconds.values.astype(np.int64), nanos.values.astype(np.int64))
            columns.columns[label] = Column(values=time_ns, missing=seconds.missing)
        return columns

    def _wider(self, count: IntArray, size: IntArray) -> IntArray:
        """Capacities for all messages, by what those took of each table that were read before one was full.

        All tables at once: when each was widened by itself as it filled, the first batch was walked a hundred times.

        Args:
            count: (n_tables,) rows so far, the first of messages.
            size: (n_messages,) bytes of each.
        """
        times = min(SLACK * float(size.sum()) / max(int(size[: count[0]].sum()), 1), MOST_TIMES)
        doubled = np.where(count >= self._capacity, 2 * self._capacity, self._capacity)
        return np.maximum(doubled, (count * times).astype(np.int64))

    def _column(self, tables: Sequence[AnyArray], table: int, column: int, form: Form) -> Column:
        cells = tables[table][column]
        presence = self._output.presence.get((table, column))
        missing = np.asarray((tables[table][presence] <= 0).any(axis=0)) if presence else None
        if form == "cells" or form == "bytes":  # noqa: PLR1714 - mypy follows this
            return Column(form=form, values=cells, missing=missing)
        if form == "float":
            cells = cells.astype(np.uint32).view(np.float32).astype(np.float64)
        elif form in CELL_TYPES:
            cells = cells.view(CELL_TYPES[form])
        return Column(values=cells, missing=missing)
