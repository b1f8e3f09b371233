"""Tracks and detections from text separated by commas, semicolons or tabs, columns by name; gzip is read as well."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from dirprim_filter.arrays import AnyArray
from dirprim_filter.detections import NO_ID
from dirprim_filter.recording.tables.delimited import Block, DelimitedText
from dirprim_filter.recording.tables.named_columns import (
    FLOATS,
    LABEL,
    SENSOR,
    SIGNAL,
    SIZE,
    places_of,
    refuse_degrees,
    signal_cues,
    vehicle_columns,
)
from dirprim_filter.recording.tables.table import GrowingTable, Table


def read_csv(path: str | Path, *, columns: Mapping[str, str] | None = None) -> Table:
    """The tracks and detections of a csv file; `named_columns` lists its columns.

    Rows without a time or a place, with an infinite number, with a negative speed, and second rows of a vehicle at one
    time are dropped and counted. `course_rad` is kept where a vehicle has it and `speed_mps` in all rows; else the
    course is derived from the positions. So is the speed where it is missing in a row of a vehicle.

    Args:
        path: the file.
        columns: how the table calls a column, by our name for it; left out, as we do. Its unit is ours all the same.

    Raises:
        TableError: a column is missing or in another unit, or a cell is no number.
        OSError: the file cannot be read.
    """
    text = DelimitedText(path)
    line, header = text.header()
    place, unused = places_of(text.path, line, header, columns or {})
    table = GrowingTable()
    for block in text.blocks(n_cells=len(header), has_header=True):
        label = np.char.strip(np.array(block.texts(place[LABEL]), np.str_)) if LABEL in place else None
        sensor = np.char.strip(np.array(block.texts(place[SENSOR]), np.str_)) if SENSOR in place else None
        ids = block.ids(place["track_id"]) if "track_id" in place else [NO_ID] * len(block.cells)
        cue = signal_cues(block.path, block.line, block.texts(place[SIGNAL])) if SIGNAL in place else None
        table.extend(ids, label=label, sensor=sensor, cue=cue, **vehicle_columns(_columns(block, place)))
    rows = table.rows()
    refuse_degrees(text.path, rows)
    return table.whole(rows, unused=unused)


def _columns(block: Block, place: Mapping[str, int]) -> dict[str, AnyArray]:
    columns: dict[str, AnyArray] = {
        name: block.floats(place[name], name) for name in ("x_m", "y_m", *FLOATS, *SIZE) if name in place
    }
    columns["time_ns"] = block.nanoseconds(place["time_s"], "time_s")
    if "group" in place:
        columns["group"] = block.whole_numbers(place["group"], "group")
    return columns
