"""A summary as a Parquet table of integers, zstd-compressed: what any tool can query, in few bytes.

Columns, a row for each key of the summary's tallies:
    kind: "step", "passed" or "leader".
    hour, fold: of a step, when the vehicle came into sight: hours since 1970-01-01; and the fold of its name.
    east, north, direction, speed: of a step, bins of its state; of "passed", square and way; of "leader", `east` is the
        number of the sum.
    before, after: of a step, whether the vehicle was in sight a step before, and a step later.
    before_east, ... after_speed: how those states differ from the step's, in bins.
    count, sum_east, ..., sum_speed: of a step, see `Summary.steps`; of "passed", vehicles; of "leader", recordings and
        the sum.
    spread_east, ..., spread_speed: of a step, count times the sum of squares, less the square of the sum: mostly 0.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from dirprim_filter.arrays import IntArray
from dirprim_filter.recording.errors import MissingExtraError, RecordingError
from dirprim_filter.store.lattice import NONE, Lattice, packed, unpacked
from dirprim_filter.store.steps import AFTER, BEFORE, HERE, WHEN
from dirprim_filter.store.summary import Summary
from dirprim_filter.store.tallies import Tally

FORMAT = b"dirprim_summary"
VERSION = 1
KINDS = ("step", "passed", "leader")
MOST_ROWS = 50_000_000
"""Of a file: what says more is not believed."""
STATE = ("east", "north", "direction", "speed")
SUMS = ("count", *(f"sum_{name}" for name in STATE))
SPREADS = tuple(f"spread_{name}" for name in STATE)
COLUMNS = (
    "hour", "fold", *STATE, "before", "after", *(f"before_{name}" for name in STATE),
    *(f"after_{name}" for name in STATE), *SUMS, *SPREADS,
)  # fmt: skip
WIDE = (*SUMS, *SPREADS)
"""These take 64 bits, the others 32: the same in all files, so that they can be read as one."""


def write_summary(summary: Summary, file: Any) -> None:
    """Write a summary to an open file: the same bytes for the same summary.

    Raises:
        MissingExtraError: pyarrow is not installed.
    """
    pa, pq = _pyarrow()
    parts = {"step": _of_steps(summary), "passed": _of_passed(summary.passed), "leader": _of_leader(summary.leader)}
    lengths = [len(next(iter(parts[kind].values()))) for kind in KINDS]
    none = np.zeros(max(lengths), np.int64)
    columns: dict[str, Any] = {"kind": pa.array(np.repeat(KINDS, lengths)).dictionary_encode()}
    for name in COLUMNS:
        column = np.concatenate([parts[kind].get(name, none[:n]) for kind, n in zip(KINDS, lengths, strict=True)])
        columns[name] = pa.array(column, pa.int64() if name in WIDE else pa.int32())
    about = {"version": VERSION, "lattice": asdict(summary.lattice), "frame": summary.frame}
    table = pa.table(columns).replace_schema_metadata({FORMAT: json.dumps(about, sort_keys=True)})
    pq.write_table(table, file, compression="zstd", compression_level=9)


def read_summary(path: str | PathLike[str]) -> Summary:
    """Read what `write_summary` wrote.

    Raises:
        RecordingError: the file is no such table, or damaged.
        MissingExtraError: pyarrow is not installed.
        OSError: it cannot be read.
    """
    pa, pq = _pyarrow()
    with Path(path).open("rb") as opened:
        try:
            file = pq.ParquetFile(opened)
            about = json.loads((file.schema_arrow.metadata or {}).get(FORMAT, b"{}"))
            _check(about.get("version"), file.metadata.num_rows)
            table = file.read(["kind", *COLUMNS])
            kind = np.asarray(table["kind"].cast(pa.string()))
            columns = {name: np.asarray(table[name]).astype(np.int64) for name in COLUMNS}
            return _summary(Lattice(**about["lattice"]), str(about["frame"]), kind, columns)
        except (pa.ArrowException, OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            if isinstance(error, OSError) and error.errno is not None:  # of the disk; pyarrow's own have no number
                raise
            raise RecordingError(
                f"{path}: expected statistics of a recording, version {VERSION}, got {error}; forget the log and add "
                "it again"
            ) from error


def _check(version: object, n_rows: int) -> None:
    if version != VERSION or n_rows > MOST_ROWS:
        raise ValueError(f"a table of version {version} with {n_rows} rows")


def _summary(lattice: Lattice, frame: str, kind: IntArray, column: dict[str, IntArray]) -> Summary:
    step, passed, leader = ({name: values[kind == which] for name, values in column.items()} for which in KINDS)
    when = step["hour"] * lattice.n_folds + step["fold"]
    here = [step[name] for name in STATE]
    states = [
        np.where(
            step[of] == 1, _state([own + step[f"{of}_{name}"] for own, name in zip(here, STATE, strict=True)]), NONE
        )
        for of in ("before", "after")
    ]
    count, *sums = (step[name] for name in SUMS)
    squares = [(step[f"spread_{name}"] + total**2) // count for name, total in zip(STATE, sums, strict=True)]
    square = np.column_stack([passed["east"], passed["north"]])
    return Summary(
        lattice=lattice, frame=frame,
        steps=Tally.of(
            np.column_stack([when, states[0], _state(here), states[1]]), np.column_stack([count, *sums, *squares])
        ),
        passed=Tally.of(packed(square, passed["direction"], passed["speed"])[:, None], passed["count"][:, None]),
        leader=Tally.of(leader["east"][:, None], np.column_stack([leader["count"], leader["sum_east"]])),
    )  # fmt: skip


def _state(bins: list[IntArray]) -> IntArray:
    return packed(np.column_stack(bins[:2]), bins[2], bins[3])


def _of_steps(summary: Summary) -> dict[str, IntArray]:
    """By place, for neighbours compress best side by side."""
    by_place = np.argsort(summary.steps.key[:, HERE], kind="stable")
    key, value = summary.steps.key[by_place], summary.steps.value[by_place]
    hour, fold = np.divmod(key[:, WHEN], summary.lattice.n_folds)
    here = _bins(key[:, HERE])
    columns = {"hour": hour, "fold": fold, **dict(zip(STATE, here, strict=True))}
    for name, of in (("before", BEFORE), ("after", AFTER)):
        known = key[:, of] != NONE
        columns[name] = known.astype(np.int64)
        there = _bins(np.where(known, key[:, of], key[:, HERE]))
        columns |= {f"{name}_{axis}": b - a for axis, a, b in zip(STATE, here, there, strict=True)}
    spread = value[:, :1] * value[:, 5:] - value[:, 1:5] ** 2
    return columns | dict(zip((*SUMS, *SPREADS), [*value.T[:5], *spread.T], strict=True))


def _of_passed(passed: Tally) -> dict[str, IntArray]:
    east, north, way, _ = _bins(passed.key[:, 0])
    return {"east": east, "north": north, "direction": way, "count": passed.value[:, 0]}


def _of_leader(leader: Tally) -> dict[str, IntArray]:
    return {"east": leader.key[:, 0], "count": leader.value[:, 0], "sum_east": leader.value[:, 1]}


def _bins(state: IntArray) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    square, turn, pace = unpacked(state)
    return square[:, 0], square[:, 1], turn, pace


def _pyarrow() -> tuple[Any, Any]:
    try:
        import pyarrow as pa  # noqa: PLC0415 (an extra)
        import pyarrow.parquet as pq  # noqa: PLC0415
    except ImportError as error:
        raise MissingExtraError("a store of statistics", library="pyarrow", extra="fleet") from error
    return pa, pq
