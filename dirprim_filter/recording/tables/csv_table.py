"""Tracks from text separated by commas, semicolons or tabs, columns by name; gzip is read as well.

`time_s, track_id, x_m, y_m` and, if there, `heading_rad, course_rad, speed_mps, group, length_m, width_m, height_m` and
`label` (or `category` or `class`); other columns are not used. A name says its unit: x east and y north in metres, the
heading (yaw of the body) and the course over ground in radians counter-clockwise from east, the size of the body in
metres; an empty cell of a size, an angle or a label is one that is unknown.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from dirprim_filter.optional_columns import unknown
from dirprim_filter.recording.errors import TableError
from dirprim_filter.recording.tables.delimited import Block, DelimitedText, NameTable
from dirprim_filter.recording.tables.table import Table, table_of
from dirprim_filter.recording.vehicle_rows import VehicleRows

logger = logging.getLogger(__name__)

REQUIRED = ("time_s", "track_id", "x_m", "y_m")
SIZE = ("length_m", "width_m", "height_m")
OPTIONAL = ("heading_rad", "course_rad", "speed_mps", "group", *SIZE)
LABEL = "label"
LABELS = (LABEL, "category", "class")
"""The first of these that a table has says what its vehicles are."""
ANGLES = {"course_rad": "direction", "heading_rad": "heading"}

REMEDY: Mapping[str, str] = {
    "time_ms": "divide by 1e3", "time_us": "divide by 1e6", "time_ns": "divide by 1e9",
    "x_ft": "multiply by 0.3048", "y_ft": "multiply by 0.3048",
    "x_cm": "divide by 100", "y_cm": "divide by 100", "x_km": "multiply by 1000", "y_km": "multiply by 1000",
    "x_px": "multiply by the metres per pixel", "y_px": "multiply by the metres per pixel",
    "heading_deg": "multiply by pi/180, and make it counter-clockwise from east",
    "course_deg": "multiply by pi/180, and make it counter-clockwise from east",
    "speed_kmh": "divide by 3.6", "speed_kph": "divide by 3.6", "speed_mph": "multiply by 0.44704",
    "speed_fps": "multiply by 0.3048", "speed_kn": "multiply by 0.514444",
    "length_ft": "multiply by 0.3048", "width_ft": "multiply by 0.3048", "height_ft": "multiply by 0.3048",
    "length_cm": "divide by 100", "width_cm": "divide by 100", "height_cm": "divide by 100",
}  # fmt: skip

TURN = 2 * np.pi


def read_csv(path: str | Path, *, columns: Mapping[str, str] | None = None) -> Table:
    """The tracks of a csv file.

    Rows without a time or a place, with an infinite number, with a negative speed, and second rows of a vehicle at one
    time are dropped and counted. `course_rad` is kept where a vehicle has it and `speed_mps` in all rows; else the
    course is derived from the positions. So is the speed where it is missing in a row of a vehicle.

    Args:
        path: the file.
        columns: how the table calls a column, by our name for it; left out, as we do. Its unit is ours all the same.

    Raises:
        ValueError: `columns` has a name that is none of ours.
        TableError: a column is missing or in another unit, or a cell is no number.
        OSError: the file cannot be read.
    """
    text = DelimitedText(path, delimiter=None)
    line, header = next(text.rows(), (1, []))
    names = _renamed(text.path, line, [name.strip() for name in header], columns or {})
    check_header(text.path, line, names)
    place = {name: names.index(name) for name in (*REQUIRED, *OPTIONAL, LABEL) if name in names}
    unused = [name for i, name in enumerate(names) if i not in place.values()]
    ids = NameTable()
    parts, labels = [], []
    for block in text.blocks(skip=1, n_cells=len(names)):
        parts.append(_rows_of(block, place, ids))
        if LABEL in place:
            labels.append(np.char.strip(np.array(block.texts(place[LABEL]), np.str_)))
    if not parts:
        raise TableError(text.path, line + 1, "rows after the header", "none", "check how the table was made")
    rows = VehicleRows.concatenate(parts, np.array(ids.names, np.str_))
    for name, of in ANGLES.items():
        angle = np.abs(getattr(rows, of))
        if (angle > TURN).any():
            logger.warning("%s: %s reaches %g; is it in degrees?", path, name, np.nanmax(angle))
    return replace(table_of(rows, label=np.concatenate(labels) if labels else None), unused=unused)


def parse_columns(text: str) -> dict[str, str]:
    """Of `x_m=Easting,y_m=Northing` how a table calls columns, by our names.

    Raises:
        ValueError: a part is not NAME=COLUMN, or its name is none of ours or there twice.
    """
    known = (*REQUIRED, *OPTIONAL, LABEL)
    columns: dict[str, str] = {}
    for part in text.split(","):
        name, _, column = (word.strip() for word in part.partition("="))
        if name not in known or not column or name in columns:
            raise ValueError(f"columns: expected NAME=COLUMN, each of {', '.join(known)} once, got {part!r}")
        columns[name] = column
    return columns


def _renamed(path: Path, line: int, header: list[str], columns: Mapping[str, str]) -> list[str]:
    """The names of a header as we call them; one of our names whose column is elsewhere is no longer ours."""
    missing = [column for column in columns.values() if column not in header]
    if missing:
        raise TableError(path, line, f"column {missing[0]}", ", ".join(header) or "none", "name one that is there")
    ours = {column: name for name, column in columns.items()}
    names = [ours.get(name, f"({name})" if name in columns else name) for name in header]
    if LABEL not in names:
        other = next((name for name in LABELS if name in names), None)
        names = [LABEL if name == other else name for name in names]
    return names


def _rows_of(block: Block, place: dict[str, int], ids: NameTable) -> VehicleRows:
    vehicle = ids.numbers(block.texts(place["track_id"]))
    n = vehicle.size
    floats = {
        name: block.floats(place[name], name) for name in ("x_m", "y_m", *ANGLES, "speed_mps", *SIZE) if name in place
    }
    has_size = any(name in place for name in SIZE)
    return VehicleRows(
        names=np.empty(0, np.str_),
        vehicle=vehicle,
        time_ns=block.nanoseconds(place["time_s"], "time_s"),
        position=np.column_stack([floats["x_m"], floats["y_m"]]),
        direction=floats.get("course_rad", unknown(n)),
        speed=floats.get("speed_mps", unknown(n)),
        group=block.whole_numbers(place["group"], "group") if "group" in place else np.zeros(n, np.int64),
        size=np.column_stack([floats.get(name, unknown(n)) for name in SIZE]) if has_size else unknown(n, 3),
        heading=floats.get("heading_rad", unknown(n)),
    )


def check_header(path: Path, line: int, columns: list[str]) -> None:
    """Every required column is there once, and none that we know is in another unit.

    Raises:
        TableError: otherwise.
    """
    known = (*REQUIRED, *OPTIONAL, LABEL)
    twice = [name for name in known if columns.count(name) > 1]
    if twice:
        raise TableError(path, line, f"one column {twice[0]}", f"{columns.count(twice[0])}", "remove the others")
    for name in known[:-1]:
        stem = name.partition("_")[0]
        other = [c for c in columns if (c == stem and name not in SIZE) or (c in REMEDY and c.startswith(f"{stem}_"))]
        if name not in columns and other:
            remedy = REMEDY.get(other[0], "convert it where the unit differs")
            raise TableError(path, line, f"column {name}", other[0], f"{remedy}, and name it {name}")
    missing = [name for name in REQUIRED if name not in columns]
    if missing:
        raise TableError(
            path, line, f"columns {', '.join(REQUIRED)}, separated by commas", ", ".join(columns) or "none",
            f"name the columns so, or say by --columns {missing[0]}=NAME how the table calls them; missing: "
            f"{', '.join(missing)}",
        )  # fmt: skip
