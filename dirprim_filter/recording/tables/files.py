"""Tables as files: text of cells, which may be compressed by gzip; Parquet, Feather and Arrow."""

from __future__ import annotations

import csv
import gzip
import io
import re
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.feather
import pyarrow.parquet

from dirprim_filter.recording.container.budget import most_bytes
from dirprim_filter.recording.container.errors import GZIP, READ_BYTES, other_format
from dirprim_filter.recording.errors import TableError
from dirprim_filter.recording.name_patterns import form_of
from dirprim_filter.recording.tables.cells import Cells

PARQUET, ARROW = b"PAR1", (b"ARROW1", b"FEA1")
"""How such files begin, whatever their names."""
DELIMITERS = ",;\t"
"""Between cells; where it is a semicolon, numbers may have a decimal comma."""
STATED_DELIMITER = re.compile(rb"\s*sep=([,;\t])\r?\n")
"""How spreadsheets state it, in a line before the names."""
SAMPLE_BYTES = 1 << 16
WORD = 8
"""Bytes of a number."""


def text_cells(path: str | Path, names: Sequence[str] = ()) -> Cells:
    """The cells of a text in UTF-8, quoted as RFC 4180 says; lines may be blank.

    Args:
        path: the file.
        names: of the columns, between whose cells any spaces and tabs stand; left out, the first row names them, and
            between cells stands that of `DELIMITERS` that it has most of.

    Raises:
        TableError: it is a file of another format, no text, or has rows of unlike lengths.
        OSError: the file cannot be read.
    """
    path = Path(path)
    data = _contents(path)
    if names:
        data = b"\n".join(b"\t".join(line.replace(b'"', b"").split()) for line in data.splitlines())
    try:
        data.decode()
        if stated := STATED_DELIMITER.match(data):
            data = b"\n" * data[: stated.end()].count(b"\n") + data[stated.end() :]
        first = (data.lstrip(b"\r\n")[:SAMPLE_BYTES].splitlines() or [b""])[0].decode(errors="ignore")
        delimiter = stated[1].decode() if stated else max("\t" if names else DELIMITERS, key=first.count)
        header = 0 if names else data[: data.find(first.encode())].count(b"\n") + 1
        names = names or [name.strip() for name in next(csv.reader([first], delimiter=delimiter, strict=True), ())]
        table = _parsed(path, data, names, header, delimiter)
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise TableError(path, line, "UTF-8 text", error.reason, "save the table as UTF-8") from error
    except (csv.Error, pa.ArrowException) as error:
        got = str(error).partition("\n")[0]
        raise TableError(path, "", "rows of cells", got, "write the table anew") from error
    is_held = np.zeros(len(table), np.bool_)
    for column in table.columns:
        is_held |= pc.not_equal(column, "").to_numpy()
    lines = np.flatnonzero(is_held) + header + 1  # of texts whose cells hold no line breaks
    return Cells(path, table.filter(is_held), lines, header=header, decimal_comma=delimiter == ";")


def _contents(path: Path) -> bytes:
    with path.open("rb") as file:
        opening = file.read(READ_BYTES)
    is_compressed = opening.startswith(GZIP)
    if not is_compressed and (known := other_format(opening)):
        raise TableError(path, 1, "a table of text", *known)
    try:
        data = _unpacked(path) if is_compressed else path.read_bytes()
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise TableError(path, "", "a whole gzip file", str(error), "compress the table anew") from error
    return data.removeprefix(b"\xef\xbb\xbf")


def _unpacked(path: Path) -> bytes:
    limit = most_bytes(path.stat().st_size)
    with gzip.open(path) as file:
        data = file.read(limit + 1)
    if len(data) > limit:
        raise _too_large(path, limit, "unpack it first by `gunzip`")
    return data


def _too_large(path: Path, limit: int, remedy: str) -> TableError:
    return TableError(path, "", f"at most {limit >> 20} MiB in memory of so small a file", "more", remedy)


def _parsed(path: Path, data: bytes, names: Sequence[str], header: int, delimiter: str) -> Any:
    """The table of texts, with an empty row for each blank line."""
    if not data.strip():
        return pa.table([pa.array([], pa.string())] * len(names), names=[*names])
    wrong = list[Any]()

    def handle(row: Any) -> str:
        wrong.append(row)
        return "skip"

    table = pa.csv.read_csv(
        io.BytesIO(data),
        pa.csv.ReadOptions(column_names=names, skip_rows=header, use_threads=False),
        pa.csv.ParseOptions(
            delimiter=delimiter, newlines_in_values=True, ignore_empty_lines=False, invalid_row_handler=handle
        ),
        pa.csv.ConvertOptions(column_types=dict.fromkeys(names, pa.string()), strings_can_be_null=False),
    )
    for row in wrong[:1]:
        cells = f"{row.expected_columns} cells"
        raise TableError(path, row.number, cells, str(row.actual_columns), "mend or remove the line")
    if len(table) and any("\n" in str(column[-1]) for column in table.columns):
        raise TableError(path, "", "quotes in pairs", "one that is not closed", "close it, or remove it")
    return table


def cells_of(path: str | Path) -> Cells:
    """The columns of a Parquet, Feather or Arrow file, as it is named or begins; else of a text.

    Raises:
        TableError: it is none of these.
        OSError: the file cannot be read.
    """
    path = Path(path)
    with path.open("rb") as file:
        opening = file.read(READ_BYTES)
    if form_of(path) not in ("parquet", "feather") and not opening.startswith((PARQUET, *ARROW)):
        return text_cells(path)
    try:
        table = _parquet(path) if opening.startswith(PARQUET) else pa.feather.read_table(path, memory_map=True)
        table.validate(full=True)  # else offsets beyond their buffers are followed
        if sum(map(_unfolded_bytes, table.columns)) > (limit := most_bytes(path.stat().st_size)):
            raise _too_large(path, limit, "write a .csv of it")
        return Cells(path, table)
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:  # names of columns are texts too
        got = str(error).partition("\n")[0]
        raise TableError(path, "", "a Parquet, Feather or Arrow file", got, "write the table anew") from error


def _parquet(path: Path) -> Any:
    """Texts as places in a dictionary, as which they are stored; a file that claims more rows than fit is refused."""
    about, limit = pa.parquet.read_metadata(path), most_bytes(path.stat().st_size)
    sizes = [group.total_byte_size for group in map(about.row_group, range(about.num_row_groups))]
    if about.num_rows * about.num_columns * WORD > limit or max(sizes, default=0) > limit:
        raise _too_large(path, limit, "write a .csv of it")
    texts = [of.name for of in about.schema.to_arrow_schema() if pa.types.is_string(of.type)]
    return pa.parquet.read_table(path, memory_map=True, read_dictionary=texts)


def _unfolded_bytes(column: Any) -> int:
    """Of a column in memory, each row with a value of its own."""
    if not pa.types.is_dictionary(column.type) or not pa.types.is_string(column.type.value_type):
        return int(column.nbytes)
    return sum(
        len(chunk) * WORD + (pc.sum(pc.take(pc.binary_length(chunk.dictionary), chunk.indices)).as_py() or 0)
        for chunk in column.chunks
    )
