"""Estimates as tables, so that they go to other tools, and what other trackers wrote.

`.csv` and `.parquet` have a row for each vehicle and instant and a column for each thing that is believed; the first
columns are those of `read_csv`. `.txt` is MOTChallenge's: frame, id, a box of the image (here -1), confidence, and x, y
and z in metres; its frames are numbered from 1.

Source: Dendorfer et al., MOTChallenge: A Benchmark for Single-Camera Multiple Target Tracking, IJCV 2021, for `.txt`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedWriter, FileIO
from pathlib import Path

import numpy as np

from dirprim_filter.arrays import AnyArray, IntArray
from dirprim_filter.estimates import Estimates
from dirprim_filter.partial_file import PartialFile
from dirprim_filter.recording.tables.arrow_table import pyarrow
from dirprim_filter.recording.tables.delimited import FORMULA, FORMULA_GUARD, is_number
from dirprim_filter.track_ids import as_texts, numbered

FORMATS = (".csv", ".parquet", ".txt")
NS_PER_S = 1_000_000_000
BLOCK_ROWS = 4096


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
        MissingExtraError: a .parquet, and pyarrow is not installed.
        ValueError: another suffix, or an estimate at a time that is no frame's.
        OSError: the file cannot be written.
    """
    form = check_table_format(path)
    if form == ".parquet":
        arrow = pyarrow(path)
        with _new(path, force=force) as file:
            arrow.parquet.write_table(arrow.table(_columns(estimates)), file)
        return
    lines = _csv_lines(estimates) if form == ".csv" else _mot_lines(estimates, frame_ns)
    with _new(path, force=force) as file:
        file.writelines(line.encode() + b"\n" for line in lines)


def check_table_format(path: str | Path) -> str:
    """The suffix of a table's name: to be asked before the work, not after it.

    Raises:
        ValueError: it is none of `FORMATS`.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in FORMATS:
        raise ValueError(f"{path}: expected a name that ends in {', '.join(FORMATS)}, got {suffix or 'no suffix'}")
    return suffix


def _columns(estimates: Estimates) -> dict[str, AnyArray]:
    """Every column by the name that says its unit."""
    covariance = estimates.covariance
    return {
        "time_ns": estimates.time_ns, "track_id": as_texts(estimates.track_id), "x_m": estimates.position[:, 0],
        "y_m": estimates.position[:, 1], "course_rad": estimates.direction, "speed_mps": estimates.speed,
        "covariance_xx_m2": covariance[:, 0, 0], "covariance_xy_m2": covariance[:, 0, 1],
        "covariance_yy_m2": covariance[:, 1, 1], "direction_resultant": estimates.direction_resultant,
        "speed_std_mps": estimates.speed_std, "existence": estimates.existence, "unseen_s": estimates.unseen_s,
        "effective_sample_size": estimates.effective_sample_size, "log_evidence": estimates.log_evidence,
    }  # fmt: skip


def _csv_lines(estimates: Estimates) -> Iterator[str]:
    columns = _columns(estimates)
    times = columns.pop("time_ns")
    names = columns.pop("track_id")
    yield ",".join(["time_s", "track_id", *columns])
    for start in range(0, times.size, BLOCK_ROWS):
        rows = slice(start, start + BLOCK_ROWS)
        numbers = np.column_stack([column[rows] for column in columns.values()]).tolist()
        for time_ns, name, row in zip(times[rows].tolist(), names[rows].tolist(), numbers, strict=True):
            yield ",".join([_seconds(time_ns), _quoted(name), *map(repr, row)])


def _seconds(time_ns: int) -> str:
    whole, rest = divmod(abs(time_ns), NS_PER_S)
    return f"{'-' if time_ns < 0 else ''}{whole}.{rest:09d}"


def _quoted(name: str) -> str:
    """A cell of RFC 4180; of a text that spreadsheets would run as a formula with `FORMULA_GUARD` in front."""
    if name[:1] in FORMULA and not is_number(name):
        name = FORMULA_GUARD + name
    special = any(character in name for character in ',"\r\n') or name != name.strip()
    return '"' + name.replace('"', '""') + '"' if special else name


def _mot_lines(estimates: Estimates, frame_ns: IntArray | None) -> Iterator[str]:
    frames = np.unique(estimates.time_ns if frame_ns is None else frame_ns)
    frame = np.searchsorted(frames, estimates.time_ns)
    known = np.isin(estimates.time_ns, frames)
    if not known.all():
        missing = int((~known).sum())
        raise ValueError(f"frames: expected one at the time of each estimate, got none for {missing} of {known.size}")
    order = np.lexsort((estimates.time_ns,))
    number = _whole_numbers(estimates.track_id)
    for i in order.tolist():
        x, y = estimates.position[i].tolist()
        yield f"{frame[i] + 1},{number[i]},-1,-1,-1,-1,{estimates.existence[i].item()!r},{x!r},{y!r},0"


def _whole_numbers(track_id: AnyArray) -> IntArray:
    """(n,) ids that MOTChallenge can hold: positive whole numbers."""
    if track_id.dtype.kind == "i" and (track_id > 0).all():
        return track_id
    return numbered(as_texts(track_id))[1] + 1


@contextmanager
def _new(path: str | Path, *, force: bool) -> Iterator[BufferedWriter[FileIO]]:
    """A buffered file that takes its name when it is whole."""
    with PartialFile(path, force=force) as file:
        buffered = BufferedWriter(file)
        yield buffered
        buffered.flush()
        buffered.detach()  # the file is its owner's to close
