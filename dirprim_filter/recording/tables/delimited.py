"""Text tables: lines of cells to columns of numbers, a block of rows at a time.

Source: RFC 4180 for quoting. A wrong cell is reported with its line.
"""

from __future__ import annotations

import csv
import gzip
import zlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from decimal import Decimal, InvalidOperation
from itertools import islice
from pathlib import Path
from typing import NoReturn, TextIO

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.recording.container.other_formats import READ_BYTES, other_format
from dirprim_filter.recording.decoding.field_columns import NO_TIME
from dirprim_filter.recording.errors import TableError

BLOCK_ROWS = 2048
"""Rows held as text at one time: few enough for the processor's cache."""

EXACT_SECONDS = 1e6
"""Below this a float64 of seconds is within a quarter of a nanosecond of the decimal it was read from."""
MAX_SECONDS = 9e9
"""Nanoseconds of a later time do not fit into int64."""

GZIP = b"\x1f\x8b"
"""How a compressed file begins, whatever its name."""
DELIMITERS = ",;\t"
"""Between cells; where it is a semicolon, numbers may have a decimal comma."""

FORMULA, FORMULA_GUARD = frozenset("=+-@\t\r'"), "'"
"""How a cell begins that spreadsheets run as a formula, and what stands before such an id where it is text."""


class DelimitedText:
    """The cells of a text file, which may be compressed by gzip.

    Args:
        path: the file, UTF-8.
        delimiters: characters; that one stands between cells that the first line has most of.

    Raises:
        TableError: it is a file of another format.
        OSError: the file cannot be read.
    """

    def __init__(self, path: str | Path, *, delimiters: str = DELIMITERS) -> None:
        self.path = Path(path)
        with self.path.open("rb") as file:
            opening = file.read(READ_BYTES)
        self._is_compressed = opening.startswith(GZIP)
        if not self._is_compressed and (known := other_format(opening)):
            raise TableError(self.path, 1, "a table of text", known.name, known.way)
        self._delimiter = self._found_delimiter(delimiters)

    def _open(self) -> TextIO:
        if self._is_compressed:
            return gzip.open(self.path, "rt", encoding="utf-8-sig", newline="")
        return self.path.open(encoding="utf-8-sig", newline="")

    def _found_delimiter(self, delimiters: str) -> str:
        try:
            with self._open() as file:
                header = next((line for line in file if line.strip()), "")
        except (UnicodeDecodeError, EOFError, zlib.error, gzip.BadGzipFile):
            return delimiters[0]  # `rows` says what is wrong
        return max(delimiters, key=header.count)

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """The number of the last line and the cells of each row that is not blank.

        Raises:
            TableError: the file is no text, or its quotes do not fit.
        """
        with self._open() as file:
            reader = csv.reader(file, delimiter=self._delimiter, skipinitialspace=True, strict=True)
            try:
                for row in reader:
                    if row and row[-1] == "" and self._delimiter == " ":
                        row.pop()  # of a space at the end of the line
                    if row:
                        yield reader.line_num, row
            except UnicodeDecodeError as error:
                raise TableError(
                    self.path, reader.line_num + 1, "UTF-8 text", str(error.reason), "save the table as UTF-8"
                ) from error
            except (EOFError, zlib.error, gzip.BadGzipFile) as error:
                raise TableError(
                    self.path, reader.line_num + 1, "a whole gzip file", str(error), "compress the table anew"
                ) from error
            except csv.Error as error:
                raise TableError(
                    self.path, reader.line_num, "cells of text", str(error), "mend or remove the line"
                ) from error

    def header(self) -> tuple[int, list[str]]:
        """The first row: the number of its line, and what its cells name."""
        line, cells = next(self.rows(), (1, []))
        return line, [name.strip() for name in cells]

    def blocks(self, *, n_cells: int, has_header: bool = False) -> Iterator[Block]:
        """Rows, some at a time, behind the header if there is one.

        Raises:
            TableError: there is none, one has not `n_cells` cells, or as `rows`.
        """
        rows = self.rows()
        line = next(rows, (0, []))[0] if has_header else 0
        part = list(islice(rows, BLOCK_ROWS))
        if not part:
            what = "rows after the header" if has_header else "rows"
            raise TableError(self.path, line + 1, what, "none", "check how the table was made")
        while part:
            block = Block(
                self.path, [line for line, _ in part], [cells for _, cells in part],
                decimal_comma=self._delimiter == ";",
            )  # fmt: skip
            if set(map(len, block.cells)) != {n_cells}:
                row = next(i for i, cells in enumerate(block.cells) if len(cells) != n_cells)
                block.fail(row, f"{n_cells} cells", f"{len(block.cells[row])}", "mend or remove the line")
            yield block
            part = list(islice(rows, BLOCK_ROWS))


class Block:
    """Some rows of a text table, all of one length.

    Args:
        path: the table.
        line: (n) of each row.
        cells: (n) of each row.
        decimal_comma: a comma in a number stands before its decimals.
    """

    def __init__(
        self, path: Path, line: Sequence[int], cells: Sequence[list[str]], *, decimal_comma: bool = False
    ) -> None:
        self.path = path
        self.line = line
        self.cells = cells
        self._decimal_comma = decimal_comma

    def fail(self, row: int, expected: str, got: str, remedy: str) -> NoReturn:
        """Raise the error of a row.

        Raises:
            TableError: always.
        """
        raise TableError(self.path, self.line[row], expected, got, remedy)

    def texts(self, column: int) -> list[str]:
        """(n) the cells of a column."""
        return [cells[column] for cells in self.cells]

    def ids(self, column: int) -> list[str]:
        """(n) the cells of a column of ids, without a guard."""
        texts = self.texts(column)
        if not any(text.startswith(FORMULA_GUARD) for text in texts):
            return texts
        return [text[1:] if text[:1] == FORMULA_GUARD and text[1:2] in FORMULA else text for text in texts]

    def _decimals(self, column: int) -> list[str]:
        """(n) the cells of a column of numbers, with a decimal point."""
        texts = self.texts(column)
        return [text.replace(",", ".") for text in texts] if self._decimal_comma else texts

    def floats(self, column: int, name: str) -> FloatArray:
        """(n,) the numbers of a column; NaN where a cell is empty.

        Raises:
            TableError: a cell is no number.
        """
        texts = self._decimals(column)
        with suppress(ValueError):
            numbers = np.fromiter(map(float, texts), np.float64, len(texts))
            if "_" not in "".join(texts):  # 1_000 is a number in Python alone
                return numbers
        texts_or_nan = [text if text.strip() else "nan" for text in texts]
        row = next((row for row, text in enumerate(texts_or_nan) if not is_number(text)), None)
        if row is not None:
            self.fail(row, f"a number as {name}", repr(texts[row]), "mend the cell, or empty it to drop the row")
        return np.fromiter(map(float, texts_or_nan), np.float64, len(texts))

    def whole_numbers(self, column: int, name: str) -> IntArray:
        """(n,) the whole numbers of a column.

        Raises:
            TableError: a cell is no whole number, or none that fits into int64.
        """
        texts = self.texts(column)
        with suppress(ValueError, OverflowError):
            numbers = np.fromiter(map(int, texts), np.int64, len(texts))
            if "_" not in "".join(texts):
                return numbers
        row = next(row for row, text in enumerate(texts) if not _is_int64(text))
        return self.fail(row, f"a whole number as {name}", repr(texts[row]), "mend or remove the line")

    def frame_times(self, column: int, *, frames_per_second: float) -> IntArray:
        """(n,) nanoseconds of numbered frames; `NO_TIME` where the cell holds none.

        Raises:
            TableError: a cell is no number, or too large.
            ValueError: a rate that is not positive.
        """
        if not (np.isfinite(frames_per_second) and frames_per_second > 0):
            raise ValueError(f"frames_per_second: expected a positive number, got {frames_per_second}")
        seconds = self.floats(column, "frame") / frames_per_second
        return self._in_nanoseconds(seconds, "frame", "mend or remove the line")

    def _in_nanoseconds(self, seconds: FloatArray, name: str, remedy: str) -> IntArray:
        too_large = np.abs(seconds) > MAX_SECONDS
        if (too_large & np.isfinite(seconds)).any():
            row = int(np.argmax(too_large & np.isfinite(seconds)))
            self.fail(row, f"seconds as {name}", f"{seconds[row]:g}", remedy)
        known = np.isfinite(seconds)
        return np.where(known, np.rint(np.where(known, seconds, 0.0) * 1e9).astype(np.int64), NO_TIME)

    def nanoseconds(self, column: int, name: str) -> IntArray:
        """(n,) decimal seconds to the nearest nanosecond; `NO_TIME` where the cell holds none.

        A float64 of seconds since 1970 is off by up to 120 ns, so large times are taken from their digits.

        Raises:
            TableError: a cell is no number, or too large for seconds.
        """
        seconds = self.floats(column, name)
        time_ns = self._in_nanoseconds(seconds, name, "divide by 1e3, 1e6 or 1e9 if it counts ms, us or ns")
        texts = self._decimals(column)
        for row in np.flatnonzero((np.abs(seconds) >= EXACT_SECONDS) & np.isfinite(seconds)).tolist():
            time_ns[row] = exact_nanoseconds(texts[row])
        return time_ns


def exact_nanoseconds(seconds: str) -> int:
    """Decimal seconds to the nearest nanosecond.

    Raises:
        ValueError: it is no number, not finite, or more than `MAX_SECONDS`.
    """
    try:
        exact = Decimal(seconds)
    except InvalidOperation as error:
        raise ValueError(f"expected decimal seconds, got {seconds!r}") from error
    if not exact.is_finite() or exact.copy_abs() > MAX_SECONDS:
        raise ValueError(f"expected at most {MAX_SECONDS:g} s, got {seconds!r}")
    return int((exact * 1_000_000_000).to_integral_value())


def is_number(text: str) -> bool:
    """Whether the text is a number, or NaN."""
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text


def _is_int64(text: str) -> bool:
    try:
        return "_" not in text and -(2**63) <= int(text) < 2**63
    except ValueError:
        return False
