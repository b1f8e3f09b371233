"""The columns of tables by their names, which say the unit: of csv, Parquet and Arrow alike.

`time_s, x_m, y_m` and, if there, `track_id, heading_rad, course_rad, speed_mps, group, length_m, width_m, height_m`,
`sensor`, `turn_signal` (left, right or none) and `label` (or `category` or `class`); other columns are not used. Rows
without an id are detections, of that sensor. x is east and y north in metres, the heading (yaw of the body) and the
course over ground are radians counter-clockwise from east, the size of the body is in metres; an empty cell of a size,
an angle, a signal or a label is one that is unknown.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray
from dirprim_filter.optional_columns import unknown
from dirprim_filter.primitives.cues import signalled
from dirprim_filter.recording.errors import TableError
from dirprim_filter.recording.vehicle_rows import VehicleRows

REQUIRED = ("time_s", "track_id", "x_m", "y_m")
"""Of tracks; detections have no id."""
DETECTED = ("time_s", "x_m", "y_m")
ID = re.compile(r"(track|vehicle|object|agent|car|obj|veh)?[ _-]?id|track|vehicle|mmsi", re.IGNORECASE)
"""What other tables call the column of ids: without its name their tracks would be taken for detections."""
TIME_NS = "time_ns"
"""Whole nanoseconds, which formats with numbers of their own may have in place of `time_s`."""
SIZE = ("length_m", "width_m", "height_m")
FLOATS = {"heading_rad": "heading", "course_rad": "direction", "speed_mps": "speed"}
"""What the columns of `VehicleRows` are called."""
LABEL = "label"
SENSOR = "sensor"
SIGNAL = "turn_signal"
SIGNALS = ("left", "right", "none", "")
LABELS = (LABEL, "category", "class")
"""The first of these that a table has says what its vehicles are."""
KNOWN = (*REQUIRED, *FLOATS, "group", *SIZE, SENSOR, SIGNAL, LABEL)
LARGEST_ANGLE = 6.3
"""A turn, rounded."""

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


def parse_columns(text: str) -> dict[str, str]:
    """Of `x_m=Easting,y_m=Northing` how a table calls columns, by our names.

    Raises:
        ValueError: a part is not NAME=COLUMN, or its name is none of ours or there twice.
    """
    columns: dict[str, str] = {}
    for part in text.split(","):
        name, _, column = (word.strip() for word in part.partition("="))
        if name not in (*KNOWN, TIME_NS) or not column or name in columns:
            raise ValueError(f"columns: expected NAME=COLUMN, each of {', '.join(KNOWN)} once, got {part!r}")
        columns[name] = column
    return columns


def places_of(
    path: Path,
    line: int | str,
    header: Sequence[str],
    columns: Mapping[str, str],
    *,
    required: Sequence[str] = DETECTED,
) -> tuple[dict[str, int], list[str]]:
    """Which column of a table is which, by our names; and those that are not used.

    Args:
        path: the table.
        line: of the header; stands in the error.
        header: the names of all columns.
        columns: how the table calls a column, by our name for it; its unit is ours all the same.
        required: the names that must be there.

    Raises:
        TableError: a column is missing, is there twice, or is in another unit.
    """
    missing = [column for column in columns.values() if column not in header]
    if missing:
        raise TableError(path, line, f"column {missing[0]}", ", ".join(header) or "none", "name one that is there")
    ours = {column: name for name, column in columns.items()}
    names = [ours.get(name, f"({name})" if name in columns else name) for name in header]
    if any(ID.fullmatch(name) for name in names):
        required = (required[0], "track_id", *required[1:])
    check_header(path, line, names, required)
    label = next((name for name in LABELS if name in names), LABEL)
    names = [LABEL if name == label else name for name in names]
    place = {name: names.index(name) for name in _known(required) if name in names}
    return place, [name for i, name in enumerate(names) if i not in place.values()]


def check_header(path: Path, line: int | str, columns: list[str], required: Sequence[str] = REQUIRED) -> None:
    """Every required column is there once, and none that we know is in another unit.

    Raises:
        TableError: otherwise.
    """
    known = _known(required)
    twice = [name for name in (*known, *LABELS[1:]) if columns.count(name) > 1]
    if twice:
        raise TableError(path, line, f"one column {twice[0]}", f"{columns.count(twice[0])}", "remove the others")
    for name in known[:-1]:
        stem = name.partition("_")[0]
        other = [c for c in columns if (c == stem and name not in SIZE) or (c in REMEDY and c.startswith(f"{stem}_"))]
        if name not in columns and other:
            remedy = REMEDY.get(other[0], "convert it where the unit differs")
            raise TableError(path, line, f"column {name}", other[0], f"{remedy}, and name it {name}")
    missing = [name for name in required if name not in columns]
    if missing:
        between = ", with commas, semicolons or tabs between them" if len(columns) < 2 else ""
        raise TableError(
            path, line, f"columns {', '.join(required)}{between}", ", ".join(columns) or "none",
            f"name the columns so, or say by --columns {missing[0]}=NAME how the table calls them; missing: "
            f"{', '.join(missing)}",
        )  # fmt: skip


def _known(required: Sequence[str]) -> list[str]:
    """The names of columns that are read, where these are required: a table has one column of times."""
    return list(dict.fromkeys((*required, *KNOWN[1:])))


def vehicle_columns(columns: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
    """Columns by our names, with `time_ns` for the times, as `VehicleRows` takes them."""
    same = {name: columns[name] for name in (TIME_NS, "group") if name in columns}
    same |= {ours: columns[name] for name, ours in FLOATS.items() if name in columns}
    if any(name in columns for name in SIZE):
        nothing = unknown(len(columns["x_m"]))
        same["size"] = np.column_stack([columns.get(name, nothing) for name in SIZE])
    return same | {"position": np.column_stack([columns["x_m"], columns["y_m"]])}


def signal_cues(path: Path, line: Sequence[int] | None, texts: Sequence[str] | AnyArray) -> FloatArray:
    """(n,) texts of turn signals -> (n, 2) as in `Detections.cue`.

    Raises:
        TableError: one is not of `SIGNALS`; at its line where lines (n,) are known.
    """
    side = np.strings.lower(np.strings.strip(np.asarray(texts, np.str_)))
    wrong = np.flatnonzero(~np.isin(side, SIGNALS))
    if wrong.size:
        place = f"column {SIGNAL}" if line is None else line[wrong[0]]
        raise TableError(
            path, place, f"{', '.join(SIGNALS[:3])} as {SIGNAL}", repr(texts[wrong[0]]), "mend the cell, or empty it"
        )
    return signalled(side == "left", side == "right")


def refuse_degrees(path: Path, rows: VehicleRows) -> None:
    """Angles are radians, of one turn.

    Raises:
        TableError: one is not.
    """
    for name, ours in list(FLOATS.items())[:2]:
        angle = np.abs(getattr(rows, ours))
        if (angle[np.isfinite(angle)] > LARGEST_ANGLE).any():
            largest = f"{np.max(angle[np.isfinite(angle)]):g}"
            remedy = f"{REMEDY['heading_deg']} if it is in degrees, else bring it to -pi to pi"
            raise TableError(path, f"column {name}", "radians, of one turn", largest, remedy)
