"""Tables whose columns say by their names what they hold and in which unit: csv, Parquet, Feather.

`time_s, x_m, y_m` and, if there, `track_id, heading_rad, course_rad, speed_mps, group, length_m, width_m, height_m`,
`sensor`, `turn_signal` (left, right or none) and `label` (or `category` or `class`); other columns are not used. Rows
without an id are detections, of that sensor, with the covariances `covariance_xx_m2`, `covariance_xy_m2` and
`covariance_yy_m2`, and their probability `confidence`. x is east and y north in metres, the heading (yaw of the body)
and the course over ground are radians counter-clockwise from east, the size of the body is in metres; an empty cell of
a size, an angle, a signal or a label is one that is unknown. In place of `time_s` stand `time_ns`, whole nanoseconds,
or `time` or `timestamp`, ISO times; in place of `x_m` and `y_m`, `latitude_deg` and `longitude_deg`. With
`origin_latitude_deg` and `origin_longitude_deg`, the same in all rows, `x_m` and `y_m` are of that plane.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.columns import GLOBE, NAMES, ORIGIN
from dirprim_filter.origin import Origin
from dirprim_filter.primitives.cues import signalled
from dirprim_filter.recording.decoding.field_columns import NANOSECONDS, NO_TIME
from dirprim_filter.recording.errors import TableError
from dirprim_filter.recording.losses import FAR, Losses
from dirprim_filter.recording.rows import LEFT_OUT, Rows
from dirprim_filter.recording.schemas.family import matrices
from dirprim_filter.recording.tables.cells import Cells
from dirprim_filter.recording.tables.files import cells_of
from dirprim_filter.recording.tables.table import Table, table_of
from dirprim_filter.recording.transforms.geodesy import median_of, on_plane
from dirprim_filter.track_ids import Numbers

ID = re.compile(r"(track|vehicle|object|agent|car|obj|veh)?[ _-]?id|track|vehicle|mmsi", re.IGNORECASE)
"""What other tables call the column of ids: without its name their tracks would be taken for detections."""
WORDS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+")
"""Of names such as time_ms, timeMs, and Time [ms]."""
TIMES = {"time_s": "s", "time_ns": "ns", "time": "iso"}
"""The columns of times, and how they count."""
PLACE, SIZE, COVARIANCE = NAMES["position"], NAMES["size"], NAMES["covariance"]
SIGNALS = ("left", "right", "none", "")
MEASURED = ("heading_rad", "course_rad", "speed_mps", *SIZE)
ALSO = {
    "time": ("timestamp",), "label": ("category", "class"), "latitude_deg": ("latitude", "lat"),
    "longitude_deg": ("longitude", "lon", "lng"),
}  # fmt: skip
"""What else a table may call a column; the first that it has counts."""
COLUMNS = (
    "time_s", "track_id", *PLACE, *MEASURED, "group", "sensor", "turn_signal", "label", "time_ns", "time", *GLOBE,
    *COVARIANCE, *ORIGIN, "confidence",
)  # fmt: skip
"""All that are known."""
REMEDY: Mapping[str, str] = {
    "ms": "divide by 1e3", "us": "divide by 1e6", "ns": "divide by 1e9", "ft": "multiply by 0.3048",
    "cm": "divide by 100", "mm": "divide by 1000", "feet": "multiply by 0.3048", "rad": "multiply by 180/pi",
    "km": "multiply by 1000", "px": "multiply by the metres per pixel",
    "deg": "multiply by pi/180, and make it counter-clockwise from east", "kmh": "divide by 3.6",
    "kph": "divide by 3.6", "mph": "multiply by 0.44704", "fps": "multiply by 0.3048", "kn": "multiply by 0.514444",
    "degrees": "multiply by pi/180, and make it counter-clockwise from east", "knots": "multiply by 0.514444",
    "frames": "divide by the frames per second",
}  # fmt: skip
"""By the unit that a name ends with; a time whose name begins with frame counts them."""
UNREAD = "; or leave it out by --set format=csv,{}="
TO_NS = {"s": "multiply by 1e9", "ms": "multiply by 1e6", "us": "multiply by 1e3"}


def read_named(path: str | Path, *, columns: Mapping[str, str] | None = None, origin: Origin | None = None) -> Table:
    """The tracks and detections of a csv, Parquet, Feather or Arrow file; the module lists its columns.

    Rows without a time or a place, with an infinite number, with a negative speed, and second rows of a vehicle at one
    time are dropped and counted. `course_rad` is kept where a vehicle has it and `speed_mps` in all rows; else the
    course is derived from the positions. So is the speed where it is missing in a row of a vehicle.

    Args:
        path: the file; between the cells of a csv, which gzip may compress, stand commas, semicolons or tabs.
        columns: how the table calls a column, by our name for it; left out, as we do. Its unit is ours all the same.
            Of several columns for the group, with `+` between, each combination is a group. A column that is called ""
            is one of the table's that is not read.
        origin: of the plane; left out, the one that the table states, or else the median of the first latitudes and
            longitudes.

    Raises:
        TableError: a column is missing, in another unit or of another type, or a cell is no number.
        MissingExtraError: places are latitudes, and pyproj is not installed.
        OSError: the file cannot be read.
    """
    table = cells_of(path)
    name_of, unused = _names(table, columns or {})

    def maybe(name: str, read: Callable[[str], Any]) -> Any:
        return read(name_of[name]) if name in name_of else LEFT_OUT

    names, vehicle = maybe("track_id", table.ids) or (np.array([""]), np.zeros(len(table), np.int64))
    position, origin, is_geodetic = positions(table, name_of, origin)
    size = {name: table.floats(name_of[name]) for name in SIZE if name in name_of}
    errs = COVARIANCE[0] in name_of
    rows = Rows(
        names=names, track_id=vehicle, time_ns=times(table, name_of), position=position,
        heading=maybe("heading_rad", table.angles), direction=maybe("course_rad", table.angles),
        speed=maybe("speed_mps", table.floats), cue=maybe("turn_signal", lambda name: _cues(table, name)),
        group=maybe("group", lambda name: _groups(table, name)), label=maybe("label", table.texts),
        covariance=matrices(table.numbers(name_of[name] for name in COVARIANCE)) if errs else LEFT_OUT,
        confidence=maybe("confidence", table.probabilities),
        size=np.column_stack([size.get(name, np.full(len(table), np.nan)) for name in SIZE]) if size else LEFT_OUT,
    )  # fmt: skip
    early, losses, sensor = _too_early(table, rows.time_ns), Losses(), maybe("sensor", table.texts)
    far = np.asarray(np.isinf(position).any(axis=1) & is_geodetic)
    losses.drop(FAR, far)
    made = table_of(table.path, rows[~far], sensor=None if sensor is None else sensor[~far], losses=losses)
    return replace(made, used=[*name_of], unused=unused, too_early=early).on_plane(origin, is_geodetic=is_geodetic)


def _too_early(table: Cells, time_ns: IntArray) -> TableError | None:
    """Of the first row of a time before 1970, with the way out for all; None where there is none."""
    if not (early := (time_ns < 0) & (time_ns != NO_TIME)).any():
        return None
    row, way = int(np.argmax(early)), f"add {-int(time_ns[early].min() // NANOSECONDS)} s to all"
    return table.error(row, "times from 0 on, as MCAP holds no earlier ones", f"{time_ns[row]} ns", way)


def _cues(table: Cells, name: str) -> FloatArray:
    """(n, 2) as in `Detections.cue`."""
    side = np.strings.lower(table.texts(name))
    if (wrong := ~np.isin(side, SIGNALS)).any():
        row = int(np.argmax(wrong))
        raise table.error(
            row, f"{', '.join(SIGNALS[:3])} as {name}", repr(str(side[row])), "mend the cell, or empty it"
        )
    return signalled(side == "left", side == "right")


def times(table: Cells, name_of: Mapping[str, str]) -> IntArray:
    """(n,) nanoseconds, of the first column of `TIMES` that the table has; `NO_TIME` where there is none."""
    name, unit = next((name_of[name], unit) for name, unit in TIMES.items() if name in name_of)
    return table.nanoseconds(name, unit=unit)


def positions(
    table: Cells, name_of: Mapping[str, str], origin: Origin | None
) -> tuple[FloatArray, Origin | None, bool]:  # fmt: skip
    """(n, 2) metres, the origin of their plane, and whether the table says where on the Earth they are."""
    if PLACE[0] not in name_of:
        geodetic = table.numbers(name_of[name] for name in GLOBE)
        origin = origin or median_of(geodetic)
        return on_plane(origin, geodetic), origin, True
    position = table.numbers(name_of[name] for name in PLACE)
    if ORIGIN[0] not in name_of or not len(table):
        return position, origin, False
    stated = table.numbers(name_of[name] for name in ORIGIN)
    if (other := (stated != stated[0]).any(axis=1)).any():
        raise table.error(int(np.argmax(other)), "the origin of the first row", "another", "split the table by origin")
    own = Origin.parse(",".join(map(str, stated[0].tolist())))
    moved = origin is not None and not own.is_of(origin)
    return (on_plane(origin, position, own) if moved else position), origin or own, True


def _groups(table: Cells, name: str) -> IntArray:
    """The groups of a column; of several the combinations, numbered as they first come."""
    if name in table.names:
        return table.whole_numbers(name)
    parts = [table.texts(part).tolist() for part in name.split("+")]
    return Numbers().of(["\0".join(cells) for cells in zip(*parts, strict=True)])


def _names(table: Cells, renamed: Mapping[str, str]) -> tuple[dict[str, str], list[str]]:
    """How the table calls the columns that it has, by our names; and those that are not used.

    Raises:
        TableError: a column is missing, is there twice, or is in another unit.
    """
    left_out = [name for name, column in renamed.items() if not column]
    renamed = {name: column for name, column in renamed.items() if column}
    header, place = [name for name in table.names if name not in left_out], table.header
    parts = [part for column in renamed.values() for part in ([column] if column in header else column.split("+"))]
    if missing := [part for part in (*left_out, *parts) if part not in (table.names if part in left_out else header)]:
        got = ", ".join(table.names) or "none"
        raise TableError(table.path, place, f"column {missing[0]}", got, "name one that is there")
    for name, column in renamed.items():
        _check_unit(table, name, column)
    own = [name for name in header if name not in parts and name not in renamed]
    name_of = dict(renamed)
    for name in COLUMNS:
        found = [known for known in (name, *ALSO.get(name, ())) if known in own]
        if found and name not in renamed:
            name_of[name] = found[0]
    if not name_of.keys() >= {*COVARIANCE}:  # a part of a covariance is none
        name_of = {name: column for name, column in name_of.items() if name not in COVARIANCE}
    check_header(table, [*own, *name_of])
    return name_of, [name for name in header if name not in (*name_of.values(), *parts)]


def _check_unit(table: Cells, name: str, column: str) -> None:
    """Raises where a column's name ends with another unit than ours of it."""
    ours, words = name.rpartition("_")[2], [word.lower() for word in WORDS.findall(column)]
    unit = words[-1] if len(words) > 1 else ""
    if name == "time_s" and words[:1] in (["frame"], ["frames"]) and unit in ("", "id", "number", "index", "no", "nr"):
        unit = "frames"
    remedies = {**REMEDY, **TO_NS} if ours == "ns" else REMEDY
    has_unit = name in (*PLACE, *GLOBE, *MEASURED, *TIMES) and unit in remedies
    if has_unit and unit != ours and (ours, unit) != ("deg", "degrees"):
        got = f"{column}, which its name says is in {unit}"
        raise TableError(table.path, table.header, f"column {name}", got, f"{remedies[unit]}, and name it {name}")


def check_header(table: Cells, names: Sequence[str], *, with_ids: bool = False) -> None:
    """Every column that is needed is there, and none that is known is there twice, or in another unit.

    Args:
        table: whose columns they are.
        names: of its columns, and ours of them.
        with_ids: an id is needed, as it is where a column looks like one.

    Raises:
        TableError: otherwise.
    """
    path, place, known = table.path, table.header, [*COLUMNS, *(also for of in ALSO.values() for also in of)]
    if twice := [name for name in known if table.names.count(name) > 1]:
        raise TableError(path, place, f"one column {twice[0]}", f"{table.names.count(twice[0])}", "remove the others")
    where = GLOBE if GLOBE[0] in names else PLACE
    ids = ["track_id"] if with_ids or any(map(ID.fullmatch, names)) else []
    required = [next((name for name in TIMES if name in names), "time_s"), *ids, *where]
    for name in (*required, *MEASURED):
        stem = name.partition("_")[0]
        units = {stem: "convert it where the unit differs"} if name not in SIZE else {}
        units |= {f"{stem}_{unit}": remedy for unit, remedy in REMEDY.items()}
        if name not in names and (other := [column for column in names if column in units]):
            way = f"{units[other[0]]}, and name it {name}" + UNREAD.format(other[0]) * (name in MEASURED)
            raise TableError(path, place, f"column {name}", other[0], way)
    if missing := [name for name in required if name not in names]:
        between = ", with commas, semicolons or tabs between them" if len(names) < 2 else ""
        raise TableError(
            path, place, f"columns {', '.join(required)}{between}", ", ".join(table.names) or "none",
            f"name the columns so, or say by --set format=csv,{missing[0]}=NAME how the table calls them, or of which "
            f"data set it is; missing: {', '.join(missing)}",
        )  # fmt: skip
