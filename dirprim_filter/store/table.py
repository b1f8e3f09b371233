"""A summary as a Parquet table of integers, zstd-compressed: what any tool can query, in few bytes.

Columns, a row for each step, place or sum:
    kind: "step", "passed" or "leader".
    begins: of a step, whether its vehicle came into sight here; if not, the row above is the step before.
    hour, fold, ticks: of a step, when the vehicle came into sight: hours since 1970-01-01; the fold of its name; how
        long the step is, in 50 ms.
    east, north, direction, speed: of a step, bins of its state; of "passed", square and way; of "leader", `east` is the
        number of the sum.
    count: of a step, 1, or how many steps on the row below is; of "passed", vehicles; of "leader", recordings.
    sum_east, ..., sum_speed: at the first step of those alike, see `Summary.steps`; of "leader", `sum_east` is the sum.
    spread_east, ..., spread_speed: there, how many are alike times the sum of squares, less the square of the sum.

Steps are alike where the steps before and after them are, too: `Summary.steps` has one key for all of them. Here they
stand in the order of ways that they can be chained into (see `pseudo_tracks`): a state is mostly near the one above.
Of an archive there are knots alone (see `knots`), each with what it is by itself: no spreads.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from dirprim_filter.arrays import IntArray
from dirprim_filter.recording.errors import MissingExtraError, RecordingError
from dirprim_filter.store.knots import Knots
from dirprim_filter.store.lattice import NONE, Lattice, packed, unpacked
from dirprim_filter.store.pseudo_tracks import kinds_in_ways
from dirprim_filter.store.steps import BEFORE, HERE, WHEN, packed_when, tally_in_order, unpacked_when
from dirprim_filter.store.summary import Summary
from dirprim_filter.store.tallies import Tally

if TYPE_CHECKING:
    from dirprim_filter.store.remote_folder import RemoteFile

FORMAT = b"dirprim_summary"
VERSION, OF_KNOTS = 2, 3
"""Of tables of all steps, and of knots."""
KINDS = ("step", "passed", "leader")
MOST_ROWS = 50_000_000
"""Of a file, and steps that its rows stand for: what says more is not believed."""
STATE = ("east", "north", "direction", "speed")
SUMS = ("count", *(f"sum_{name}" for name in STATE))
SPREADS = tuple(f"spread_{name}" for name in STATE)
KEY = ("begins", "hour", "fold", "ticks", *STATE)
COLUMNS = (*KEY, *SUMS, *SPREADS)
WIDE = (*SUMS, *SPREADS)
"""These take 64 bits, the others 32: the same in all files, so that they can be read as one."""
ENCODING = {
    **dict.fromkeys(STATE[:2], "DELTA_BINARY_PACKED"), **dict.fromkeys((*STATE[2:], *SUMS[1:]), "BYTE_STREAM_SPLIT"),
}  # fmt: skip
"""Of columns whose values are mostly near the ones above, and of small numbers; the others have dictionaries."""
OF_EACH = (*STATE, *SUMS)
"""Columns of knots, which are far apart, byte by byte: high bytes are alike."""


def write_summary(summary: Summary, file: Any) -> None:
    """Write a summary to an open file: the same bytes for the same summary.

    Raises:
        MissingExtraError: pyarrow is not installed.
    """
    pq, table = _table(summary, _of_steps(summary), VERSION)
    pq.write_table(
        table, file, compression="zstd", compression_level=9, column_encoding=ENCODING,
        use_dictionary=[name for name in ("kind", *COLUMNS) if name not in ENCODING],
    )  # fmt: skip


def write_knots(knots: Knots, summary: Summary, file: Any) -> None:
    """Write a summary whose steps follow from knots to an open file, in few bytes: the same for the same of both.

    Raises:
        MissingExtraError: pyarrow is not installed.
    """
    keys = (knots.begins, *unpacked_when(knots.when, summary.lattice), *unpacked(knots.state))
    columns = [*keys, knots.apart, *knots.parts.T]
    pq, table = _table(summary, dict(zip(COLUMNS, columns, strict=False)), OF_KNOTS)
    with pq.ParquetWriter(
        file, table.schema, compression="zstd", compression_level=19, write_statistics=False, store_schema=False,
        column_encoding=dict.fromkeys(OF_EACH, "BYTE_STREAM_SPLIT"),
        use_dictionary=[name for name in ("kind", *COLUMNS) if name not in OF_EACH],
    ) as writer:  # fmt: skip
        writer.write_table(table)
        writer.add_key_value_metadata(table.schema.metadata)  # which is else written with the schema alone


def _table(summary: Summary, steps: dict[str, IntArray], version: int) -> tuple[Any, Any]:
    """Of pyarrow the module for files, and the table of a summary, of whose steps there are some columns."""
    pa, pq = _pyarrow()
    parts = {"step": steps, "passed": _of_passed(summary.passed), "leader": _of_leader(summary.leader)}
    lengths = [len(next(iter(parts[kind].values()))) for kind in KINDS]
    none = np.zeros(max(lengths), np.int64)
    columns: dict[str, Any] = {"kind": pa.array(np.repeat(KINDS, lengths)).dictionary_encode()}
    for name in COLUMNS:
        column = np.concatenate([parts[kind].get(name, none[:n]) for kind, n in zip(KINDS, lengths, strict=True)])
        columns[name] = pa.array(column, pa.int64() if name in WIDE else pa.int32())
    about = {"version": version, "lattice": asdict(summary.lattice), "frame": summary.frame}
    return pq, pa.table(columns).replace_schema_metadata({FORMAT: json.dumps(about, sort_keys=True)})


class Counts(NamedTuple):
    """What a summary counts beside steps, see `Summary`."""

    whens: Tally
    passed: Tally
    leader: Tally

    @classmethod
    def none(cls) -> Self:
        """Of nothing."""
        return cls(Tally.none(1, 1), Tally.none(1, 1), Tally.none(1, 2))

    @classmethod
    def total(cls, parts: list[Self]) -> Self:
        """The sums of all parts, of which there is at least one."""
        return cls(*(Tally.total(list(column)) for column in zip(*parts, strict=True)))


def read_summary(path: str | PathLike[str] | RemoteFile) -> Summary:
    """Read what `write_summary` wrote.

    Raises:
        RecordingError: the file is no such table, or damaged.
        MissingExtraError: pyarrow is not installed.
        OSError: it cannot be read.
    """
    with _opened(path, COLUMNS) as (about, of):
        lattice, counts = Lattice(**about["lattice"]), _counts(about, of)
        steps = (_filled if about["version"] == OF_KNOTS else _steps)(lattice, of["step"])
        return Summary(
            lattice=lattice, frame=str(about["frame"]), steps=steps, passed=counts.passed, leader=counts.leader
        )


def read_counts(path: str | PathLike[str] | RemoteFile, lattice: Lattice) -> Counts:
    """Read what `write_summary` wrote of counts on a lattice, but for the steps.

    Raises:
        RecordingError: the lattice is another, or as `read_summary`, as are the others.
        MissingExtraError: see there.
        OSError: see there.
    """
    with _opened(path, ("hour", "fold", "ticks", "east", "north", "direction", "count", "sum_east")) as (about, of):
        if Lattice(**about["lattice"]) != lattice:
            raise ValueError(f"counts on {about['lattice']}")
        return _counts(about, of)


@contextmanager
def _opened(
    path: str | PathLike[str] | RemoteFile, names: tuple[str, ...]
) -> Iterator[tuple[Any, dict[str, dict[str, IntArray]]]]:
    """What a file says about itself, and some columns of each kind of rows."""
    pa, pq = _pyarrow()
    with (Path(path) if isinstance(path, str | PathLike) else path).open("rb") as opened:
        try:
            file = pq.ParquetFile(opened)
            about = json.loads((file.schema_arrow.metadata or {}).get(FORMAT, b"{}"))
            _check(about.get("version"), file.metadata.num_rows)
            table = file.read(["kind", *names])
            kind = np.asarray(table["kind"].cast(pa.string()))
            rows = [np.flatnonzero(kind == which) for which in KINDS]
            columns = [(name, np.asarray(table[name])) for name in names]
            yield (
                about,
                {
                    which: {name: column[own].astype(np.int64) for name, column in columns}
                    for which, own in zip(KINDS, rows, strict=True)
                },
            )
        except (pa.ArrowException, OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            if isinstance(error, OSError) and error.errno is not None:  # of the disk; pyarrow's own have no number
                raise
            raise RecordingError(
                f"{path}: expected statistics of a recording, version {VERSION} or {OF_KNOTS}, got {error}; forget the "
                "log and add it again"
            ) from error


def _check(version: object, n_rows: int) -> None:
    if version not in {VERSION, OF_KNOTS} or n_rows > MOST_ROWS:
        raise ValueError(f"a table of version {version} with {n_rows} rows")


def _counts(about: Any, of: dict[str, dict[str, IntArray]]) -> Counts:
    step, passed, leader = (of[which] for which in KINDS)
    when = packed_when(step["hour"], step["fold"], step["ticks"], Lattice(**about["lattice"]))
    place = packed(passed["east"], passed["north"], passed["direction"], np.zeros_like(passed["east"]))
    return Counts(
        Tally.of(when[:, None], step["count"][:, None]),
        Tally.of(place[:, None], passed["count"][:, None]),
        Tally.of(leader["east"][:, None], np.column_stack([leader["count"], leader["sum_east"]])),
    )


def _steps(lattice: Lattice, step: dict[str, IntArray]) -> Tally:
    when = packed_when(step["hour"], step["fold"], step["ticks"], lattice)
    state = packed(step["east"], step["north"], step["direction"], step["speed"])
    begins = step["begins"] != 0
    if not begins[:1].all():
        raise ValueError("a first step that another came before")
    sums = tally_in_order(when, state, begins, np.column_stack([step[name] for name in (*SUMS, *SPREADS)]))
    squares = (sums.value[:, 5:] + sums.value[:, 1:5] ** 2) // sums.value[:, :1]
    return Tally(key=sums.key, value=np.column_stack([sums.value[:, :5], squares]))


def _filled(lattice: Lattice, step: dict[str, IntArray]) -> Tally:
    knots = Knots(
        step["begins"] != 0, packed_when(step["hour"], step["fold"], step["ticks"], lattice),
        packed(*(step[name] for name in STATE)), np.column_stack([step[f"sum_{name}"] for name in STATE]),
        step["count"],
    )  # fmt: skip
    knots.check(lattice, MOST_ROWS)
    return knots.steps(lattice)


def _of_steps(summary: Summary) -> dict[str, IntArray]:
    kind = kinds_in_ways(summary.steps, summary.lattice)
    key, value = summary.steps.key[kind], summary.steps.value[kind]
    value = np.column_stack([value[:, :5], value[:, :1] * value[:, 5:] - value[:, 1:5] ** 2])
    _, first = np.unique(kind, return_index=True)
    again = np.ones(kind.size, np.bool_)
    again[first] = False
    value[again] = 0
    value[:, 0] = 1
    keys = (key[:, BEFORE] == NONE, *unpacked_when(key[:, WHEN], summary.lattice), *unpacked(key[:, HERE]))
    return dict(zip(COLUMNS, [*keys, *value.T], strict=True))


def _of_passed(passed: Tally) -> dict[str, IntArray]:
    east, north, way, _ = unpacked(passed.key[:, 0])
    return {"east": east, "north": north, "direction": way, "count": passed.value[:, 0]}


def _of_leader(leader: Tally) -> dict[str, IntArray]:
    return {"east": leader.key[:, 0], "count": leader.value[:, 0], "sum_east": leader.value[:, 1]}


def _pyarrow() -> tuple[Any, Any]:
    try:
        import pyarrow as pa  # noqa: PLC0415 (an extra)
        import pyarrow.parquet as pq  # noqa: PLC0415
    except ImportError as error:
        raise MissingExtraError("a store of statistics", library="pyarrow", extra="fleet") from error
    return pa, pq
