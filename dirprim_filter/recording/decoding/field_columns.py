"""Which fields of a message are wanted, and their columns, taken out of a batch of messages.

They are named by paths such as `.objects[].kinematics.pose.position.x`: a step is a field's name; `[]` behind it goes
through all elements of a repeated field, `[2]` to its third. Paths that share what stands up to their last `[]` are
columns of one table, with a row for each element.

Source: the record shredding of Melnik et al., "Dremel: Interactive Analysis of Web-Scale Datasets", 2010, with
row numbers of the parent in place of repetition levels.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Literal, NamedTuple

import numpy as np
from google.protobuf.message import DecodeError

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.recording.container._kernels import gather
from dirprim_filter.recording.container.errors import one_line
from dirprim_filter.recording.decoding import _kernels as kernels

Kind = Literal["number", "name", "time", "presence"]
"""What is wanted of a field: a number; a text, whatever it is; a time; or whether a message is set at all."""

EACH = -1
"""The selector of `[]`; `[k]` is k itself, and a plain step has None."""
_STEP = re.compile(r"\.([A-Za-z_]\w*)(?:\[(\d{0,6})\])?")


class SchemaError(DecodeError):
    """The definition of a schema cannot be read, or lacks a field that is needed; its text is one line."""

    def __init__(self, text: str) -> None:
        super().__init__(one_line(text))


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """A wanted field.

    Attributes:
        path: where it stands.
        kind: what is wanted of it.
        optional: a schema may lack it; it then reads as missing.
    """

    path: str
    kind: Kind = "number"
    optional: bool = False

    @property
    def table(self) -> str:
        """The path up to its last `[]`; empty where there is a value for each message."""
        return "".join(self.path.rpartition("[]")[:2])


@dataclass(slots=True)
class Wanted:
    """What is wanted of one value: itself, under some labels, and what is below it.

    Attributes:
        labels: label and kind under which the value itself is wanted.
        below: by name and selector, what is wanted of its fields.
    """

    labels: list[tuple[str, Kind]] = field(default_factory=list)
    below: dict[str, dict[int | None, Wanted]] = field(default_factory=dict)


class Place(NamedTuple):
    """Where a program stands while it is made.

    Attributes:
        table: the table whose row is written.
        path: from the message to here.
        presence: columns of the table that all are set when what stands here is there.
    """

    table: int = 0
    path: str = ""
    presence: tuple[int, ...] = ()

    def at(self, step: str, *presence: int) -> Place:
        """A step on in the same row."""
        return Place(self.table, f"{self.path}{step}", (*self.presence, *presence))


def steps_of(path: str) -> list[tuple[str, int | None]]:
    """Name and selector of each step.

    Raises:
        ValueError: it is no path.
    """
    steps, at = [], 0
    while match := _STEP.match(path, at):
        name, selector = match.groups()
        steps.append((name, None if selector is None else int(selector) if selector else EACH))
        at = match.end()
    if at != len(path) or not steps:
        raise ValueError(f"field path: expected steps such as .objects[].pose.position.x, got {path!r}")
    return steps


def wanted(fields: Mapping[str, Field]) -> Wanted:
    """The paths of all fields as one tree.

    Raises:
        ValueError: a path is none.
    """
    root = Wanted()
    for label, one in fields.items():
        at = root
        for name, selector in steps_of(one.path):
            at = at.below.setdefault(name, {}).setdefault(selector, Wanted())
        at.labels.append((label, one.kind))
    return root


NO_TIME = -(1 << 63)
"""Nanoseconds of a message or a row that carries no time, or one beyond int64."""
_ISO_TIME = re.compile(
    r"(\d{4}-\d\d-\d\d[Tt ]\d\d:\d\d:\d\d)(?:[.,](\d{1,9})\d*)?([Zz]|[+-]\d\d(?::?\d\d)?)?", re.ASCII
)
MAX_NAME_LENGTH = 256
"""Longer names, in bytes of UTF-8, are no names: as a column of text one of them costs every row its length."""
NANOSECONDS = 1_000_000_000
TIME_END_NS = 1 << 63
FARTHEST_S = (1 << 63) // NANOSECONDS - 1
"""Seconds beyond this, to either side, do not fit into int64 nanoseconds."""
NO_ROWS: tuple[IntArray, IntArray] = (np.empty(0, np.int64), np.empty(0, np.int64))


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """The values of one field, a row each.

    Attributes:
        values: (n,) float64, int64, uint64 or str; or int64, places in the batch, as `form` says.
        missing: (n,) where the message has no such value.
        form: "cells" (of texts in the batch), "bytes" (the same, no text), "values" (none).
    """

    values: AnyArray
    missing: BoolArray | None = None
    form: Literal["values", "cells", "bytes"] = "values"


@dataclass(slots=True, kw_only=True)
class FieldColumns:
    """Tables of a batch; labels that the schema lacks read as missing.

    Attributes:
        fields: what was asked for.
        n_messages: in the batch.
        rows: by table, (n,) the message and (n,) the row of the table above, for each of its rows.
        columns: by label.
        data: (n_bytes,) uint8, where texts stand.
        failures: by number of the message, why it cannot be read.
        notes: what is odd, but was read.
    """

    fields: Mapping[str, Field]
    n_messages: int
    rows: dict[str, tuple[IntArray, IntArray]]
    columns: dict[str, Column]
    data: AnyArray
    failures: dict[int, str] = field(default_factory=dict)
    notes: set[str] = field(default_factory=set)

    @classmethod
    def failed(cls, fields: Mapping[str, Field], n_messages: int, why: Exception) -> FieldColumns:
        """Of messages that all cannot be read."""
        return cls(
            fields=fields, n_messages=n_messages, rows={}, columns={}, data=np.empty(0, np.uint8),
            failures=dict.fromkeys(range(n_messages), str(why)),
        )  # fmt: skip

    def message_of(self, table: str) -> IntArray:
        """(n,) the message of each row; none where the schema lacks the table."""
        return self.rows.get(table, NO_ROWS)[0]

    def parent_of(self, table: str) -> IntArray:
        """(n,) the row in the table above of each row."""
        return self.rows.get(table, NO_ROWS)[1]

    def read(self, label: str, none: float | str = np.nan) -> AnyArray:
        """(n,) floats, whole numbers or texts, as `none` is one, which stands where the message has no such value.

        Texts come as they are, numbers in decimal, bytes in hexadecimal. Texts of more than `MAX_NAME_LENGTH` bytes
        come one byte longer than that; the messages of those that are no UTF-8 are marked as failed.
        """
        column, table = self.columns.get(label), self.fields[label].table
        if column is None:
            return np.full(self.message_of(table).size, none)
        values, missing = column.values, column.missing
        if isinstance(none, float):
            values = values.astype(np.float64, copy=False)
        elif column.form in ("cells", "bytes"):
            values = self._texts(values, table, is_text=column.form == "cells")
        elif isinstance(none, str):
            values = values.astype(np.str_, copy=False)
        elif values.dtype.kind == "f":
            missing = ~np.isfinite(values) if missing is None else missing | ~np.isfinite(values)
            values = np.where(missing, none, values).astype(np.int64)
        else:
            values = values.astype(np.int64, copy=False)
        return values if missing is None else np.where(missing, none, values)

    def lacks(self, label: str) -> bool:
        """Whether the schema, or in JSON all messages, have no such value."""
        column = self.columns.get(label)
        return column is None or (column.missing is not None and bool(column.missing.all()))

    def vectors(self, labels: Sequence[str]) -> FloatArray:
        """(n, k) float64, some columns of one table beside each other; NaN where missing."""
        return np.stack([self.read(label) for label in labels], axis=-1)

    def is_set(self, label: str, default: int = 1) -> BoolArray:
        """(n,) whether the message is set; `default` where the schema does not have it."""
        column = self.columns.get(label)
        return np.asarray((self.read(label, default) if column is None else column.values) > 0)

    def _texts(self, cells: IntArray, table: str, *, is_text: bool) -> AnyArray:
        length = cells & kernels.LONGEST
        width = int(min(length.max(initial=0), MAX_NAME_LENGTH + 1))
        if width == 0:
            return np.full(cells.size, "")
        gathered: AnyArray = np.zeros((cells.size, width), np.uint8)
        start, at = cells >> kernels.TEXT_BITS, width * np.arange(cells.size)
        gather(self.data, start, start + np.minimum(length, width), at, gathered.reshape(-1))
        if not is_text:
            digits = np.frombuffer(b"0123456789abcdef", np.uint8)
            pairs = np.ascontiguousarray(np.stack([digits[gathered >> 4], digits[gathered & 15]], axis=-1))
            pairs[np.arange(width) >= length[:, None]] = 0
            return pairs.reshape(cells.size, 2 * width).view(f"S{2 * width}")[:, 0].astype(np.str_)
        if ((length > 0) & (gathered[np.arange(cells.size), np.minimum(length, width) - 1] == 0)).any():
            self.notes.add("texts end in NUL characters, which are left off: ids that differ by these alone are one")
        if not (gathered & 0x80).any():  # ASCII: one character is one byte
            return gathered.astype(np.uint32).view(f"U{width}")[:, 0]
        names = []
        for row, (cell, size) in enumerate(zip(cells.tolist(), length.tolist(), strict=True)):
            first = cell >> kernels.TEXT_BITS
            text = self.data[first : first + size].tobytes()
            try:
                is_cut = size > MAX_NAME_LENGTH
                name = text.decode(errors="replace" if is_cut else "strict")[: MAX_NAME_LENGTH + 1]
            except UnicodeDecodeError as error:
                self.failures[int(self.message_of(table)[row])] = f"a text that is no UTF-8: {error}"
                name = ""
            names.append(name)
        return np.array(names, dtype=np.str_)

    def fail(self, messages: AnyArray, reason: str) -> None:
        """Say that messages, by number, cannot be read."""
        for message in np.unique(messages).tolist():
            self.failures.setdefault(message, reason)


def nanoseconds(seconds: IntArray, nanos: IntArray) -> IntArray:
    """(n,) int64; `NO_TIME` beyond int64."""
    fits = (np.abs(seconds) < FARTHEST_S) & (np.abs(nanos) < NANOSECONDS * 4)
    total = np.where(fits, seconds, 0) * NANOSECONDS + np.where(fits, nanos, 0)
    for row in np.flatnonzero(~fits).tolist():  # few: exactly, in whole numbers without bounds
        total[row] = bounded(int(seconds[row]) * NANOSECONDS + int(nanos[row]))
    return total


def bounded(time_ns: int) -> int:
    """The time; `NO_TIME` beyond int64."""
    return time_ns if -TIME_END_NS <= time_ns < TIME_END_NS else NO_TIME


def iso_nanoseconds(text: str) -> int | None:
    """Since 1970, of an ISO time, in UTC where it has no zone; None of another text.

    Raises:
        ValueError: there is no such day, hour or zone.
    """
    if (iso := _ISO_TIME.fullmatch(text)) is None:
        return None
    stamp, fraction, zone = iso.groups()
    since = datetime.fromisoformat(stamp + (zone or "Z").upper()) - datetime(1970, 1, 1, tzinfo=UTC)
    return since // timedelta(seconds=1) * NANOSECONDS + int((fraction or "").ljust(9, "0"))


def signed(time_ns: AnyArray) -> IntArray:
    """(n,) int64 of uint64 nanoseconds; `NO_TIME` where they do not fit."""
    return np.where(time_ns < TIME_END_NS, time_ns.astype(np.int64), NO_TIME)
