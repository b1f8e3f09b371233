"""Estimates as tables, so that they go to other tools.

They have a row for each vehicle and instant and a column for each thing that is estimated; the first columns are those
that are read.
"""

from __future__ import annotations

from io import BufferedWriter
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from dirprim_filter.arrays import IntArray
from dirprim_filter.estimates import Estimates
from dirprim_filter.partial_file import PartialFile
from dirprim_filter.recording.tables.columns import FORMULA, FORMULA_GUARD, is_number
from dirprim_filter.track_ids import as_texts

FORMATS = (".csv", ".parquet")


def write_estimates(estimates: Estimates, path: str | Path, *, force: bool = False) -> None:
    """Write estimates as a table, in the format of the path's suffix; under a temporary name until it is whole.

    Numbers are written with all their digits.

    Args:
        estimates: what to write.
        path: a .csv or .parquet.
        force: overwrite an existing file.

    Raises:
        OutputExistsError: the file exists, and `force` is not set.
        ValueError: another suffix.
        OSError: the file cannot be written.
    """
    form = check_table_format(path)
    table = estimates.to_arrow()
    if form == ".csv":
        names = [_guarded(name) for name in as_texts(estimates.track_id).tolist()]
        table = table.set_column(1, "track_id", pa.array(names))
        table = table.set_column(0, "time_s", _decimal_seconds(estimates.time_ns))
    with PartialFile(path, force=force) as file:
        buffered = BufferedWriter(file)
        if form == ".parquet":
            pa.parquet.write_table(table, buffered)
        else:
            pa.csv.write_csv(table, buffered)
        buffered.flush()
        buffered.detach()  # the file is its owner's to close


def check_table_format(path: str | Path) -> str:
    """The suffix of a table's name: to be asked before the work, not after it.

    Raises:
        ValueError: it is none of `FORMATS`.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in FORMATS:
        raise ValueError(f"{path}: expected a name that ends in {', '.join(FORMATS)}, got {suffix or 'no suffix'}")
    return suffix


def _decimal_seconds(time_ns: IntArray) -> Any:
    """Arrow's decimals are whole numbers of 16 bytes, here of nanoseconds."""
    words = np.column_stack([time_ns, time_ns >> 63]).astype("<i8")
    return pa.Array.from_buffers(pa.decimal128(28, 9), time_ns.size, [None, pa.py_buffer(words.tobytes())])


def _guarded(name: str) -> str:
    """A name that spreadsheets would run as a formula with `FORMULA_GUARD` in front."""
    return FORMULA_GUARD + name if name[:1] in FORMULA and not is_number(name) else name
