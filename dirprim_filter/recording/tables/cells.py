"""The columns of a table, whatever file it came from: checked as they are read, so that an error names the line."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.columns import LARGEST_ANGLE
from dirprim_filter.recording.decoding.field_columns import MAX_NAME_LENGTH, NANOSECONDS, NO_TIME, iso_nanoseconds
from dirprim_filter.recording.decoding.json_plan import EXACT
from dirprim_filter.recording.errors import TableError

MAX_SECONDS = 9e9
"""Nanoseconds of a later time do not fit into int64."""
MEND = "mend the cell, or empty it to drop the row"
FLOAT_OR_NONE = re.compile(r"-?\d+\.0|(nan|NaN)?")
"""Ids as pandas writes them where some rows have none."""
NATIONAL_DATE = re.compile(r"\d{1,2}([/.-])\d{1,2}\1\d{2,4}\b")
"""Such as 31/12/2026, of which nobody knows whether the day or the month comes first."""
FORMULA, FORMULA_GUARD = frozenset("=+-@\t\r'"), "'"
"""How a cell begins that spreadsheets run as a formula, and what stands before such an id where it is text."""


class Cells:
    """A table's columns by name.

    Args:
        path: the file.
        table: a `pyarrow.Table`.
        line: (n,) of the file, of each row; left out where it has no lines.
        header: the line that names the columns; 0 where none does.
        decimal_comma: a comma in a number stands before its decimals.

    Attributes:
        path: the file.
        names: of the columns.
    """

    def __init__(
        self, path: Path, table: Any, line: IntArray | None = None, *, header: int = 0,
        decimal_comma: bool = False,
    ) -> None:  # fmt: skip
        self.path, self.names = path, list(table.column_names)
        self.header: int | str = header or "its columns"
        self._table, self._line, self._decimal_comma = table, line, decimal_comma

    def __len__(self) -> int:
        return int(self._table.num_rows)

    def error(self, row: int, expected: str, got: str, remedy: str) -> TableError:
        """Of a row, to be raised."""
        place = f"row {row + 1}" if self._line is None else int(self._line[row])
        return TableError(self.path, place, expected, got, remedy)

    def floats(self, name: str) -> FloatArray:
        """(n,) float64; NaN where there is none.

        Raises:
            TableError: a cell is no number.
        """
        column = self._column(name)
        if pa.types.is_string(column.type):
            texts = self._numerals(column)
            try:
                column = pc.if_else(pc.equal(texts, ""), "nan", texts).cast(pa.float64())
            except pa.ArrowInvalid:  # slowly, for the line
                return np.asarray(self._each(name, texts, _number, "a number", np.nan), np.float64)
        self._check_type(name, column, "numbers")
        return np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), np.float64)

    def numbers(self, names: Iterable[str]) -> FloatArray:
        """(n, k) float64, of k columns; NaN where there is none."""
        return np.column_stack([self.floats(name) for name in names])

    def angles(self, name: str) -> FloatArray:
        """(n,) radians of one turn; NaN where there is none.

        Raises:
            TableError: a cell is no number, or a larger one, such as of degrees.
        """
        angle = self.floats(name)
        if (wrong := np.isfinite(angle) & (np.abs(angle) > LARGEST_ANGLE)).any():
            row = int(np.argmax(wrong))
            way = (
                "make it radians counter-clockwise from east, -pi to pi; degrees are multiplied by pi/180; or leave it "
                f"out by --set format=csv,{name}="
            )
            raise self.error(row, f"radians, of one turn, as {name}", f"{angle[row]:g}", way)
        return angle

    def probabilities(self, name: str) -> FloatArray:
        """(n,) from 0 to 1; NaN where there is none.

        Raises:
            TableError: a cell is no number, or another one.
        """
        share = self.floats(name)
        if (wrong := (share < 0) | (share > 1)).any():
            row, way = int(np.argmax(wrong)), "map the detector's scores to probabilities; percent are divided by 100"
            raise self.error(row, f"a probability, 0 to 1, as {name}", f"{share[row]:g}", way)
        return share

    def whole_numbers(self, name: str, *, missing: int | None = None) -> IntArray:
        """(n,) int64; `missing` where there is none.

        Raises:
            TableError: a cell holds another thing, or nothing and nothing stands for that.
        """
        column = self._column(name)
        if pa.types.is_string(column.type):
            return self._each(name, pc.utf8_trim_whitespace(column), _whole, "a whole number", missing)
        self._check_type(name, column, "whole numbers")
        if missing is None and column.null_count:
            raise self.error(pc.index(column.is_null(), True).as_py(), f"a whole number as {name}", "nothing", MEND)
        try:
            return np.asarray(column.cast(pa.int64()).fill_null(missing or 0).to_numpy(), np.int64)
        except pa.ArrowInvalid as error:
            got = f"{column.type} ({str(error).partition(chr(10))[0]})"
            raise TableError(self.path, f"column {name}", "whole numbers", got, "write it in this type") from error

    def ids(self, name: str) -> tuple[AnyArray, IntArray]:
        """(m,) str, each text once, and (n,) the place of each row's among them; empty where there is none."""
        column = self._column(name)
        if pa.types.is_floating(column.type):
            column = self._whole_ids(name, column)
        try:
            coded = column.cast(pa.string()).fill_null("").combine_chunks().dictionary_encode()
        except pa.ArrowException as error:
            got = str(column.type)
            raise TableError(self.path, f"column {name}", "texts or numbers", got, "write it in this type") from error
        texts = coded.dictionary.to_pylist()
        for at, text in enumerate(texts):
            if len(text) > MAX_NAME_LENGTH or "\0" in text:  # in memory each would take as many
                row = int(np.argmax(coded.indices.to_numpy() == at))
                got = repr(text) if "\0" in text else f"{len(text)}"
                raise self.error(row, f"at most {MAX_NAME_LENGTH} characters, none of them NUL, as {name}", got, MEND)
        if self._line is not None:
            texts = self._plain(name, texts)
        names, place = np.unique(np.array(texts, np.str_), return_inverse=True)
        return names, place[coded.indices.to_numpy()]

    def _whole_ids(self, name: str, column: Any) -> Any:
        """Ids that became floats, as pandas makes them where some rows have none, as whole numbers again."""
        number = column.to_numpy()
        if (wrong := np.isfinite(number) & ((number != np.floor(number)) | (np.abs(number) >= EXACT))).any():
            row = int(np.argmax(wrong))
            raise self.error(row, f"texts or whole numbers as {name}", f"{number[row]}", "write it in this type")
        return pc.if_else(pc.is_finite(column), column, None).cast(pa.int64())

    def _plain(self, name: str, texts: list[str]) -> list[str]:
        """Ids of a text without spaces around, guards of spreadsheets, and the `.0` of pandas."""
        plain = [text.strip(" ") for text in texts]
        if len({*plain}) < len(texts) - plain.count("") + ("" in plain):
            wanted, way = "ids that differ by more than spaces", "give them other names"
            raise TableError(self.path, f"column {name}", wanted, "others", way)
        plain = [text[1:] if text[:1] == FORMULA_GUARD and text[1:2] in FORMULA else text for text in plain]
        return [text.removesuffix(".0") for text in plain] if all(map(FLOAT_OR_NONE.fullmatch, plain)) else plain

    def texts(self, name: str) -> AnyArray:
        """(n,) str without spaces around; empty where there is none."""
        texts, place = self.ids(name)
        return np.asarray(np.char.strip(texts)[place])

    def nanoseconds(self, name: str, *, unit: str = "s") -> IntArray:
        """(n,) int64, of decimal seconds to the nearest nanosecond; `NO_TIME` where there is none.

        A float64 of seconds since 1970 is off by up to 120 ns, so of text the digits count.

        Args:
            name: the column; timestamps are taken whatever the unit.
            unit: "s", which ISO times may stand for; "ns", whole numbers; or "iso".

        Raises:
            TableError: a cell is no time, or too large for seconds.
        """
        column = self._column(name)
        if pa.types.is_timestamp(column.type):
            try:
                return np.asarray(column.cast(pa.timestamp("ns")).cast(pa.int64()).fill_null(NO_TIME).to_numpy())
            except pa.ArrowInvalid as error:
                raise TableError(self.path, f"column {name}", "times until 2262", str(error), MEND) from error
        if unit == "ns":
            return self.whole_numbers(name, missing=NO_TIME)
        if pa.types.is_string(column.type):
            parse, what = (_iso_time, "an ISO time") if unit == "iso" else (instant, "seconds")
            return self._each(name, self._numerals(column), parse, what, NO_TIME)
        if unit == "iso":
            raise TableError(self.path, f"column {name}", "times", str(column.type), "name seconds time_s")
        return self._of_seconds(name, self.floats(name))

    def frame_times(self, name: str, *, frames_per_second: float) -> IntArray:
        """(n,) nanoseconds of numbered frames; `NO_TIME` where the cell holds none.

        Raises:
            TableError: a cell is no number, or too large.
            ValueError: a rate that is not positive.
        """
        if not (np.isfinite(frames_per_second) and frames_per_second > 0):
            raise ValueError(f"frames_per_second: expected a positive number, got {frames_per_second}")
        return self._of_seconds(name, self.floats(name) / frames_per_second)

    def _of_seconds(self, name: str, seconds: FloatArray) -> IntArray:
        known = np.isfinite(seconds)
        if (wrong := known & (np.abs(seconds) > MAX_SECONDS)).any():
            row = int(np.argmax(wrong))
            raise self.error(row, f"seconds as {name}", f"{seconds[row]:g}", "name whole nanoseconds time_ns")
        whole = np.floor(np.where(known, seconds, 0.0))
        rest = np.rint((np.where(known, seconds, 0.0) - whole) * 1e9).astype(np.int64)
        return np.where(known, whole.astype(np.int64) * NANOSECONDS + rest, NO_TIME)

    def _each(
        self, name: str, texts: Any, parse: Callable[[str], float | None], what: str, missing: float | None
    ) -> AnyArray:
        """(n,) what each text says; `missing`, if there is such a thing, where it is empty or says nothing."""
        coded = texts.combine_chunks().dictionary_encode()
        found: list[float] = []
        for at, text in enumerate(coded.dictionary.to_pylist()):
            try:
                value = parse(text) if text or missing is None else missing
            except ValueError as error:
                row, (_, *way) = int(np.argmax(coded.indices.to_numpy() == at)), error.args
                raise self.error(row, f"{what} as {name}", repr(text), *(way or [MEND])) from error
            found.append(missing if value is None and missing is not None else value)  # type: ignore[arg-type]
        return np.asarray(np.array(found)[coded.indices.to_numpy()])

    def _numerals(self, texts: Any) -> Any:
        texts = pc.utf8_trim_whitespace(texts).fill_null("")
        return pc.replace_substring(texts, ",", ".") if self._decimal_comma else texts

    def _check_type(self, name: str, column: Any, expected: str) -> None:
        of = column.type
        if not (pa.types.is_floating(of) or pa.types.is_integer(of) or pa.types.is_null(of)):
            raise TableError(self.path, f"column {name}", expected, str(of), "write it in this type")

    def _column(self, name: str) -> Any:
        if not len(self):
            raise TableError(self.path, "", "rows", "none", "check how the table was made")
        column = self._table[self.names.index(name)]
        if pa.types.is_dictionary(column.type):
            column = column.cast(column.type.value_type)
        if pa.types.is_large_string(column.type) or pa.types.is_string_view(column.type):
            column = column.cast(pa.string())
        return column


def _number(text: str, kind: Callable[[str], Any] = float) -> Any:
    """A number of a kind; none of one with underscores, as 1_000 is a number in Python alone."""
    if "_" in text:
        raise ValueError(text)
    return kind(text)


def is_number(text: str) -> bool:
    """Whether the text is a number, or NaN."""
    try:
        _number(text)
    except ValueError:
        return False
    return True


def _whole(text: str) -> int:
    number: int = _number(text, int)
    if not -(2**63) <= number < 2**63:
        raise ValueError(text)
    return number


def instant(text: str) -> int | None:
    """Nanoseconds of decimal seconds, to the nearest, or of an ISO time; None of NaN.

    Raises:
        ValueError: it is neither, or later than `MAX_SECONDS`; with the way out as a second argument.
    """
    if iso_nanoseconds(text) is not None:
        return _iso_time(text)
    try:
        exact: Decimal = _number(text, Decimal)
    except InvalidOperation as error:
        raise ValueError(text) from error
    if not exact.is_finite():
        return None
    if exact.copy_abs() > MAX_SECONDS:
        raise ValueError(text, "divide by 1e3, 1e6 or 1e9 if it counts ms, us or ns")
    return int((exact * NANOSECONDS).to_integral_value())


def _iso_time(text: str) -> int:
    if (time_ns := iso_nanoseconds(text)) is None:
        is_date = NATIONAL_DATE.match(text)
        raise ValueError(text, "write dates as 2026-12-31, year first" if is_date else "name seconds time_s")
    if abs(time_ns) > MAX_SECONDS * NANOSECONDS:
        raise ValueError(text)
    return time_ns
