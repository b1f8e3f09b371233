"""Tables as files: text of cells, which may be compressed by gzip; Parquet, Feather and Arrow."""

from __future__ import annotations

import csv
import gzip
import zlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import TextIO

import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet

from dirprim_filter.recording.container.other_formats import READ_BYTES, other_format
from dirprim_filter.recording.errors import TableError
from dirprim_filter.recording.tables.columns import Columns

GZIP, PARQUET = b"\x1f\x8b", b"PAR1"
"""How such files begin, whatever their names."""
DELIMITERS = ",;\t"
"""Between cells; where it is a semicolon, numbers may have a decimal comma."""
SAMPLE_BYTES = 1 << 16
BAD_GZIP = (EOFError, zlib.error, gzip.BadGzipFile)


def text_columns(
    path: str | Path, names: Sequence[str] = (), *, least: int | None = None, delimiters: str = DELIMITERS
) -> Columns:
    """The cells of a text in UTF-8, quoted as RFC 4180 says; lines may be blank.

    Args:
        path: the file.
        names: of the columns; left out, the first row names them.
        least: how many of the names there are at least, as the first row has them; left out, all.
        delimiters: characters; that one stands between cells that the first line has most of.

    Raises:
        TableError: it is a file of another format, no text, or has rows of unlike lengths.
        OSError: the file cannot be read.
    """
    path = Path(path)
    with path.open("rb") as file:
        opening = file.read(READ_BYTES)
    is_compressed = opening.startswith(GZIP)
    if not is_compressed and (known := other_format(opening)):
        raise TableError(path, 1, "a table of text", known.name, known.way)
    sample = b""
    with gzip.open(path) if is_compressed else path.open("rb") as binary, suppress(*BAD_GZIP):
        sample = binary.read(SAMPLE_BYTES)  # what is wrong with it, `_rows` says
    delimiter = max(delimiters, key=sample.lstrip().partition(b"\n")[0].decode(errors="replace").count)
    how = {"encoding": "utf-8-sig", "newline": ""}
    with gzip.open(path, "rt", **how) if is_compressed else path.open(**how) as text:  # type: ignore[call-overload]
        rows = _rows(path, text, delimiter)
        line, first = next(rows, (1, []))
        if names:
            names = names[: max(len(first), least or len(names))]
            rows = chain([(line, first)] if first else [], rows)
        else:
            names = [name.strip() for name in first]
        return Columns.of_cells(path, names, rows, header=line, decimal_comma=delimiter == ";")


def _rows(path: Path, text: TextIO, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """The number of the last line and the cells of each row that is not blank.

    Raises:
        TableError: the file is no text, or its quotes do not fit.
    """
    reader = csv.reader(text, delimiter=delimiter, skipinitialspace=True, strict=True)
    try:
        for row in reader:
            if row and row[-1] == "" and delimiter == " ":
                row.pop()  # of a space at the end of the line
            if row:
                yield reader.line_num, row
    except UnicodeDecodeError as error:
        raise TableError(path, reader.line_num + 1, "UTF-8 text", error.reason, "save the table as UTF-8") from error
    except BAD_GZIP as error:
        remedy = "compress the table anew"
        raise TableError(path, reader.line_num + 1, "a whole gzip file", str(error), remedy) from error
    except csv.Error as error:
        raise TableError(path, reader.line_num, "cells of text", str(error), "mend or remove the line") from error


def arrow_columns(path: str | Path) -> Columns:
    """The columns of a Parquet, Feather or Arrow file.

    Raises:
        TableError: it is none of these.
        OSError: the file cannot be read.
    """
    path = Path(path)
    with path.open("rb") as file:
        read = pa.parquet.read_table if file.read(len(PARQUET)) == PARQUET else pa.feather.read_table
    try:
        return Columns(path, read(path, memory_map=True))
    except (pa.ArrowException, OSError) as error:
        got = str(error).partition("\n")[0]
        raise TableError(path, "", "a Parquet, Feather or Arrow file", got, "write the table anew") from error
