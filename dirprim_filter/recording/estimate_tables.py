"""Estimates as tables, to other tools and from them.

`.csv` and `.parquet` have a row for each vehicle and instant and a column for each thing that is estimated; the first
columns are those that are read.
"""

from __future__ import annotations

from dataclasses import fields
from io import BufferedWriter
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from dirprim_filter.arrays import AnyArray, IntArray
from dirprim_filter.estimates import Assignments, Estimates
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.origin import Origin
from dirprim_filter.partial_file import PartialFile
from dirprim_filter.recording.decoding.field_columns import NO_TIME
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.losses import Losses
from dirprim_filter.recording.name_patterns import WRITTEN_TABLES, is_table
from dirprim_filter.recording.reader import read_estimates
from dirprim_filter.recording.schemas.family import matrices
from dirprim_filter.recording.tables.cells import FORMULA, FORMULA_GUARD, Cells, is_number
from dirprim_filter.recording.tables.files import cells_of
from dirprim_filter.recording.tables.named_columns import COVARIANCE, check_header, positions, times
from dirprim_filter.recording.transforms.geodesy import check_kind, needing_pyproj
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks

EXACT_NS = 1 << 52
"""Up to here, 52 days, the float nearest to a time is nearer to it than to any other."""


def write_estimates(estimates: Estimates | Assignments, path: str | Path, *, force: bool = False) -> None:
    """Write estimates, or what detections were assigned to, as a table, in the format of the path's suffix.

    It has a temporary name until it is whole. Numbers are written with all their digits.

    Args:
        estimates: what to write.
        path: a .csv or .parquet.
        force: overwrite an existing file.

    Raises:
        OutputExistsError: the file exists, and `force` is not set.
        ValueError: another suffix.
        OSError: the file cannot be written.
    """
    form = Path(path).suffix.lower()
    if form not in WRITTEN_TABLES:
        known = ", ".join(WRITTEN_TABLES)
        raise ValueError(f"{path}: expected a name that ends in {known}, got {form or 'no suffix'}")
    with needing_pyproj():
        table = estimates.to_arrow()
    if form == ".csv":
        for i, name in enumerate(table.column_names):
            if name in ("track_id", "assigned"):
                texts = as_texts(getattr(estimates, name)).tolist()
                table = table.set_column(i, name, pa.array(map(_guarded, texts), pa.string()))
        table = table.set_column(0, "time_s", _exact_seconds(estimates.time_ns))
    with PartialFile(path, force=force) as file:
        buffered = BufferedWriter(file)
        if form == ".parquet":
            pa.parquet.write_table(table, buffered)
        else:
            pa.csv.write_csv(table, buffered)
        buffered.flush()
        buffered.detach()  # the file is its owner's to close


def _exact_seconds(time_ns: IntArray) -> Any:
    """Floats as long as each nanosecond has its own, for of decimals Arrow writes 0 as 0E-9."""
    if np.abs(time_ns).max(initial=0) < EXACT_NS:
        return pa.array(time_ns / 1e9)
    # Arrow's decimals are whole numbers of 16 bytes, here of nanoseconds.
    words = np.column_stack([time_ns, time_ns >> 63]).astype("<i8")
    return pa.Array.from_buffers(pa.decimal128(28, 9), time_ns.size, [None, pa.py_buffer(words.tobytes())])


def _guarded(name: str) -> str:
    """A name that spreadsheets would run as a formula with `FORMULA_GUARD` in front."""
    return FORMULA_GUARD + name if name[:1] in FORMULA and not is_number(name) else name


OPTIONAL = {"course_rad": "direction", "speed_mps": "speed", "unseen_s": "unseen_s"}
"""Cells of a table, and what `TrackedRows` calls them."""


def read_tracked_rows(
    path: str | Path, *, truth: Tracks, one_of_many: bool = False, smoothed: bool = False,
    losses: Losses | None = None, meets: str = "",
) -> TrackedRows:  # fmt: skip
    """What a tracker estimated, in the groups and on the plane of a truth.

    A row is of the group that its column `group` or its id, as `group/id`, says, or of the only one. A table needs the
    columns `time_s` (or `time_ns` or `time`), `track_id`, `x_m` and `y_m`, or latitude and longitude; the covariance,
    `course_rad`, `speed_mps` and `unseen_s` are read where they are there.

    Args:
        path: a table, see `is_table`, else an MCAP log that `dirprim track` wrote.
        truth: what it is to be compared with.
        one_of_many: the truth is one of its log's groups: ids that name another group are not of it.
        smoothed: of an MCAP log what a smoother wrote beside the filter.
        losses: gets what of such a log could not be read.
        meets: the name of the truth: where one of the two has no origin, both have none. Left out: that is as it is.

    Raises:
        RecordingError: the file is none of these, does not say which group its rows are of, or is of another plane.
        ValueError: a track has two rows at one time.
        OSError: the file cannot be read.
    """
    if is_table(path):
        columns, is_geodetic = _named(cells_of(path), truth.origin)
    else:
        estimates = read_estimates(path, smoothed=smoothed, losses=losses)
        is_geodetic = estimates.origin is not None
        with needing_pyproj():
            rows = TrackedRows.of(estimates.on_plane(truth.origin))
        columns = {field.name: getattr(rows, field.name) for field in fields(rows) if field.name != "group"}
    if meets:
        check_kind(path, is_geodetic=is_geodetic, origin=truth.origin, meets=meets)
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


def _named(table: Cells, origin: Origin | None) -> tuple[dict[str, AnyArray], bool]:
    """The columns of `TrackedRows`, by the names of a table's; and whether it says where on the Earth they are."""
    check_header(table, table.names, with_ids=True)
    name_of = {name: name for name in table.names}
    position, _, is_geodetic = positions(table, name_of, origin)
    columns = {"track_id": table.texts("track_id"), "position": position, "time_ns": times(table, name_of)}
    if (wrong := (columns["time_ns"] == NO_TIME) | ~np.isfinite(position).all(axis=1)).any():
        raise table.error(int(np.argmax(wrong)), "a time and a place", "an empty cell", "remove the line")
    if "group" in table.names:
        columns["group"] = table.whole_numbers("group")
    if all(name in table.names for name in COVARIANCE):
        columns["covariance"] = matrices(table.numbers(COVARIANCE))
    columns |= {ours: table.floats(name) for name, ours in OPTIONAL.items() if name in table.names}
    return columns, is_geodetic
