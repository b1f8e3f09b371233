"""What a tracker wrote, to be judged: an MCAP of ours, or a table in one of the formats of `write_estimates`."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np

from dirprim_filter.arrays import AnyArray, IntArray
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.recording.decoding.field_columns import NO_TIME
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.reader import read_estimates
from dirprim_filter.recording.schemas.family import matrices
from dirprim_filter.recording.tables.columns import Columns
from dirprim_filter.recording.tables.files import columns_of
from dirprim_filter.recording.tables.named_columns import check_header
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks

COVARIANCE = ("covariance_xx_m2", "covariance_xy_m2", "covariance_yy_m2")
OPTIONAL = {"course_rad": "direction", "speed_mps": "speed", "unseen_s": "unseen_s"}
"""Columns of a table, and what `TrackedRows` calls them."""


def read_tracked_rows(
    path: str | Path, *, truth: Tracks, one_of_many: bool = False, smoothed: bool = False
) -> TrackedRows:
    """What a tracker estimated, in the groups of a truth.

    A row is of the group that its column `group` or its id, as `group/id`, says, or of the only one. A `.csv`,
    `.parquet` or `.feather` needs the columns `time_s` (or `time_ns`), `track_id`, `x_m` and `y_m`; the covariance,
    `course_rad`, `speed_mps` and `unseen_s` are read where they are there.

    Args:
        path: a .csv, .parquet or .feather, else an MCAP log that `dirprim track` wrote.
        truth: what it is to be compared with.
        one_of_many: the truth is one of its log's groups: ids that name another group are not of it.
        smoothed: of an MCAP log what a smoother wrote beside the filter.

    Raises:
        RecordingError: the file is none of these, or does not say which group its rows are of.
        ValueError: a track has two rows at one time.
        OSError: the file cannot be read.
    """
    form = Path(Path(path).name.removesuffix(".gz")).suffix.lower()
    if form in (".csv", ".parquet", ".feather"):
        columns = _named(columns_of(path))
    else:
        rows = TrackedRows.of(read_estimates(path, smoothed=smoothed))
        columns = {field.name: getattr(rows, field.name) for field in fields(rows) if field.name != "group"}
    if "group" not in columns:
        columns["group"] = _groups(Path(path), as_texts(np.asarray(columns["track_id"])), truth, one_of_many)
    try:
        return TrackedRows(**columns)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _groups(path: Path, names: AnyArray, truth: Tracks, one_of_many: bool) -> IntArray:
    """The group of each row, as its id says; ids without one are of group 0, where others have one."""
    groups = np.unique(truth.group)
    said = np.array([name.partition("/")[0] if "/" in name else "" for name in names.tolist()], dtype=np.str_)
    if groups.size == 1:
        is_number = np.char.isdecimal(said)
        if not (one_of_many and is_number.any()):
            return np.full(names.size, groups[0])
        return np.where(is_number, said, "0").astype(np.int64)
    known = np.isin(said, groups.astype(np.str_))
    if not known.any() or not (known | (0 in groups)).all():
        name = names[~known][0] if not known.all() else "none"
        raise RecordingError(
            f"{path}: expected rows that say which of the truth's {groups.size} groups they are of, by a column "
            f"`group` or an id like {groups[-1]}/{name}, got {name}; or choose one group with --set group=NUMBER"
        )
    return np.where(known, said, "0").astype(np.int64)


def _named(table: Columns) -> dict[str, AnyArray]:
    """The columns of `TrackedRows`, by the names of a table's."""
    check_header(table, table.names, with_ids=True)
    position, unit = table.numbers(("x_m", "y_m")), "ns" if "time_ns" in table.names else "s"
    columns = {
        "track_id": table.texts("track_id"), "position": position,
        "time_ns": table.nanoseconds(f"time_{unit}", unit=unit),
    }  # fmt: skip
    if (wrong := (columns["time_ns"] == NO_TIME) | ~np.isfinite(position).all(axis=1)).any():
        raise table.error(int(np.argmax(wrong)), "a time and a place", "an empty cell", "remove the line")
    if "group" in table.names:
        columns["group"] = table.whole_numbers("group")
    if all(name in table.names for name in COVARIANCE):
        columns["covariance"] = matrices(table.numbers(COVARIANCE))
    return columns | {ours: table.floats(name) for name, ours in OPTIONAL.items() if name in table.names}
