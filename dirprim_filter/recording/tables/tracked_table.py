"""What a tracker wrote, to be judged: an MCAP of ours, or a table in one of the formats of `write_estimates`."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.recording.decoding.field_columns import NO_TIME
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.reader import read_estimates
from dirprim_filter.recording.schemas.field_groups import matrices
from dirprim_filter.recording.tables.arrow_table import ArrowTable
from dirprim_filter.recording.tables.delimited import Block, DelimitedText
from dirprim_filter.recording.tables.named_columns import REQUIRED, check_header
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks

COVARIANCE = ("covariance_xx_m2", "covariance_xy_m2", "covariance_yy_m2")
NAMES = {
    "track_id": "track_id", "time_ns": "time_ns", "group": "group", "unseen_s": "unseen_s", "course_rad": "direction",
    "speed_mps": "speed",
}  # fmt: skip
"""Columns of a table, and what `TrackedRows` calls them."""
OPTIONAL = (*COVARIANCE, "course_rad", "speed_mps", "unseen_s")
MOT_COLUMNS = 10
NOWHERE = -1.0
"""A coordinate that MOTChallenge leaves out."""


def read_tracked_rows(
    path: str | Path, *, truth: Tracks, one_of_many: bool = False, smoothed: bool = False
) -> TrackedRows:
    """What a tracker says, in the groups of a truth.

    A row is of the group that its column `group` or its id, as `group/id`, says, or of the only one. A `.csv` or
    `.parquet` needs the columns `time_s` (in parquet `time_ns`), `track_id`, `x_m` and `y_m`; the covariance,
    `course_rad`, `speed_mps` and `unseen_s` are read where they are there. A `.txt` numbers the instants of the truth
    from 1 as its frames.

    Args:
        path: a .csv, .parquet or .txt, else an MCAP log that `dirprim track` wrote.
        truth: what it is to be compared with.
        one_of_many: the truth is one of its log's groups: ids that name another group are not of it.
        smoothed: of an MCAP log what a smoother wrote beside the filter.

    Raises:
        RecordingError: the file is none of these, or does not say which group its rows are of.
        ValueError: a track has two rows at one time.
        OSError: the file cannot be read.
    """
    form = Path(Path(path).name.removesuffix(".gz")).suffix.lower()
    if form == ".csv":
        columns = _of_csv(Path(path))
    elif form == ".parquet":
        columns = _of_parquet(Path(path))
    elif form == ".txt":
        columns = _of_mot(Path(path), truth)
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
    group = np.zeros(names.size, np.int64)
    known = np.zeros(names.size, np.bool_)
    for number in groups.tolist():
        of = said == str(number)
        group[of], known[of] = number, True
    if not known.any() or not (known | (0 in groups)).all():
        name = names[~known][0] if not known.all() else "none"
        raise RecordingError(
            f"{path}: expected rows that say which of the truth's {groups.size} groups they are of, by a column "
            f"`group` or an id like {groups[-1]}/{name}, got {name}; or choose one group with --group"
        )
    return group


def _of_csv(path: Path) -> dict[str, AnyArray]:
    text = DelimitedText(path)
    line, names = text.header()
    check_header(path, line, names)
    place = {name: names.index(name) for name in (*REQUIRED, "group", *OPTIONAL) if name in names}
    blocks = [_block(block, place) for block in text.blocks(n_cells=len(names), has_header=True)]
    return _joined({name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]})


def _block(block: Block, place: dict[str, int]) -> dict[str, AnyArray]:
    time_ns = block.nanoseconds(place["time_s"], "time_s")
    columns: dict[str, AnyArray] = {"track_id": np.array(block.ids(place["track_id"]), dtype=np.str_)}
    columns |= {
        name: block.floats(at, name) for name, at in place.items() if name not in ("time_s", "track_id", "group")
    }
    wrong = (time_ns == NO_TIME) | ~np.isfinite(columns["x_m"]) | ~np.isfinite(columns["y_m"])
    if wrong.any():
        block.fail(int(np.argmax(wrong)), "a time and a place", "an empty cell", "remove the line")
    if "group" in place:
        columns["group"] = block.whole_numbers(place["group"], "group")
    return columns | {"time_ns": time_ns}


def _of_parquet(path: Path) -> dict[str, AnyArray]:
    table = ArrowTable(path)
    table.require(("time_ns", *REQUIRED[1:]))
    floats = ("x_m", "y_m", *OPTIONAL)
    columns = {name: table.floats(name) for name in floats if name in table.names}
    columns |= {name: table.whole_numbers(name) for name in ("time_ns", "group") if name in table.names}
    return _joined(columns | {"track_id": table.texts("track_id")})


def _joined(columns: dict[str, AnyArray]) -> dict[str, AnyArray]:
    """Columns of numbers made into those of `TrackedRows`."""
    made: dict[str, AnyArray] = {name: columns[key] for key, name in NAMES.items() if key in columns}
    made["position"] = np.column_stack([columns["x_m"], columns["y_m"]])
    if all(name in columns for name in COVARIANCE):
        xx, xy, yy = (np.asarray(columns[name], np.float64) for name in COVARIANCE)
        made["covariance"] = matrices(xx, xy, yy)
    return made


def _of_mot(path: Path, truth: Tracks) -> dict[str, AnyArray]:
    instants = np.unique(truth.time_ns)
    parts: list[tuple[IntArray, list[str], FloatArray]] = []
    for block in DelimitedText(path, delimiters=",").blocks(n_cells=MOT_COLUMNS):
        frame = block.whole_numbers(0, "frame")
        position = np.column_stack([block.floats(7, "x"), block.floats(8, "y")])
        wrong = (frame < 1) | (frame > instants.size)
        if wrong.any():
            row = int(np.argmax(wrong))
            expected = f"a frame from 1 to {instants.size}, the truth's instants"
            block.fail(row, expected, str(frame[row]), "give the truth that was tracked, or a table with times")
        if not np.isfinite(position).all() or (position == NOWHERE).all():
            row = int(np.argmax(~np.isfinite(position).all(axis=1)))
            block.fail(row, "x and y in metres", "none", "give positions in the plane, not boxes of an image")
        parts.append((frame, block.texts(1), position))
    frames, names, places = zip(*parts, strict=True)
    return {
        "track_id": np.array([name.strip() for part in names for name in part], dtype=np.str_),
        "time_ns": instants[np.concatenate(frames) - 1], "position": np.concatenate(places),
    }  # fmt: skip
