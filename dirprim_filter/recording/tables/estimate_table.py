"""Estimates as tables, so that they go to other tools.

`.csv` and `.parquet` have a row for each vehicle and instant and a column for each thing that is estimated; the first
columns are those that are read. `.txt` is MOTChallenge's: frame, id, a box of the image (here -1), confidence, and x, y
and z in metres; its frames are numbered from 1.

Source: Dendorfer et al., MOTChallenge: A Benchmark for Single-Camera Multiple Target Tracking, IJCV 2021, for `.txt`.
"""

from __future__ import annotations

from io import BufferedWriter
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.estimates import Estimates
from dirprim_filter.partial_file import PartialFile
from dirprim_filter.recording.tables.columns import FORMULA, FORMULA_GUARD, is_number
from dirprim_filter.track_ids import as_texts, numbered

FORMATS = (".csv", ".parquet", ".txt")


def write_estimates(
    estimates: Estimates, path: str | Path, *, frame_ns: IntArray | None = None, force: bool = False
) -> None:
    """Write estimates as a table, in the format of the path's suffix; under a temporary name until it is whole.

    Numbers are written with all their digits. In `.txt` ids that are no positive whole numbers become their place among
    all ids, from 1.

    Args:
        estimates: what to write.
        path: a .csv, .parquet or .txt.
        frame_ns: (k,) for `.txt`, the times of its frames; left out, those at which there are estimates.
        force: overwrite an existing file.

    Raises:
        OutputExistsError: the file exists, and `force` is not set.
        ValueError: another suffix, or an estimate at a time that is no frame's.
        OSError: the file cannot be written.
    """
    form = check_table_format(path)
    table = pa.table(_mot(estimates, frame_ns)) if form == ".txt" else estimates.to_arrow()
    if form == ".csv":
        names = [_guarded(name) for name in as_texts(estimates.track_id).tolist()]
        table = table.set_column(1, "track_id", pa.array(names))
        table = table.set_column(0, "time_s", _decimal_seconds(estimates.time_ns))
    with PartialFile(path, force=force) as file:
        buffered = BufferedWriter(file)
        if form == ".parquet":
            pa.parquet.write_table(table, buffered)
        else:
            pa.csv.write_csv(table, buffered, pa.csv.WriteOptions(include_header=form == ".csv"))
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


def _mot(estimates: Estimates, frame_ns: IntArray | None) -> dict[str, IntArray | FloatArray]:
    """The ten columns of MOTChallenge, in order of time."""
    frames = np.unique(estimates.time_ns if frame_ns is None else frame_ns)
    known = np.isin(estimates.time_ns, frames)
    if not known.all():
        missing = int((~known).sum())
        raise ValueError(f"frames: expected one at the time of each estimate, got none for {missing} of {known.size}")
    order = np.argsort(estimates.time_ns, kind="stable")
    name, none = estimates.track_id, np.full(known.size, -1)
    number = name if name.dtype.kind == "i" and (name > 0).all() else numbered(as_texts(name))[1] + 1
    x, y = estimates.position.T
    columns = (np.searchsorted(frames, estimates.time_ns) + 1, number, *[none] * 4, estimates.existence, x, y, 0 * none)
    return {str(place): column[order] for place, column in enumerate(columns)}
