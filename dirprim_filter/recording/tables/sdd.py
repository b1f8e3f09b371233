"""Tracks from the Stanford Drone Dataset: `annotations.txt`, boxes in the pixels of a video.

Source: the dataset's README: track id, xmin, ymin, xmax, ymax, frame, lost, occluded, generated, "label",
separated by spaces; image y points down. The centre of the box is the position; north is up in the image.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np

from dirprim_filter.arrays import AnyArray
from dirprim_filter.optional_columns import unknown
from dirprim_filter.recording.decoding.field_columns import NO_TIME
from dirprim_filter.recording.errors import TableError
from dirprim_filter.recording.tables.delimited import Block, DelimitedText, NameTable
from dirprim_filter.recording.tables.table import Table, table_of
from dirprim_filter.recording.vehicle_rows import VehicleRows

TRACK_ID, X_MIN, Y_MIN, X_MAX, Y_MAX, FRAME, LOST, LABEL = 0, 1, 2, 3, 4, 5, 6, 9
N_CELLS = 10


def read_sdd(
    path: str | Path,
    *,
    metres_per_pixel: float,
    frames_per_second: float = 30.0,
    labels: Collection[str] | None = None,
) -> Table:
    """The tracks of an `annotations.txt`; direction and speed are differenced from the positions.

    Rows marked lost are dropped and counted; those interpolated between annotations ("generated") are kept.

    Args:
        path: the file.
        metres_per_pixel: scale of the video.
        frames_per_second: rate of the video.
        labels: the kinds of road user to keep, as "Car"; None keeps all.

    Raises:
        TableError: a row has not ten cells, or a cell is no number.
        ValueError: a scale that is not positive.
        OSError: the file cannot be read.
    """
    for name, value in (("metres_per_pixel", metres_per_pixel), ("frames_per_second", frames_per_second)):
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name}: expected a positive number, got {value}")
    text = DelimitedText(path, delimiter=" ")
    ids = NameTable()
    parts: list[VehicleRows] = []
    labels_of: list[AnyArray] = []
    n_lost = n_other = 0
    for block in text.blocks(skip=0, n_cells=N_CELLS):
        lost = block.floats(LOST, "lost") != 0
        other = np.zeros_like(lost) if labels is None else ~np.isin(block.texts(LABEL), list(labels))
        n_lost += int(lost.sum())
        n_other += int((other & ~lost).sum())
        kept = ~(lost | other)
        parts.append(_rows_of(block, ids, metres_per_pixel, frames_per_second)[kept])
        labels_of.append(np.array(block.texts(LABEL), np.str_)[kept])
    if not parts:
        raise TableError(text.path, 1, "rows of annotations", "none", "check how the file was made")
    dropped = {"marked as lost": n_lost, "of another label": n_other}
    rows = VehicleRows.concatenate(parts, np.array(ids.names, np.str_))
    return table_of(rows, label=np.concatenate(labels_of), dropped={why: n for why, n in dropped.items() if n})


def _rows_of(block: Block, ids: NameTable, metres_per_pixel: float, frames_per_second: float) -> VehicleRows:
    named = ((X_MIN, "xmin"), (Y_MIN, "ymin"), (X_MAX, "xmax"), (Y_MAX, "ymax"), (FRAME, "frame"))
    x_min, y_min, x_max, y_max, frame = (block.floats(column, name) for column, name in named)
    known, n = np.isfinite(frame), frame.size
    time_ns = np.rint(np.where(known, frame, 0.0) * (1e9 / frames_per_second)).astype(np.int64)
    return VehicleRows(
        names=np.empty(0, np.str_), vehicle=ids.numbers(block.texts(TRACK_ID)),
        time_ns=np.where(known, time_ns, NO_TIME), group=np.zeros(n, np.int64),
        position=np.column_stack([x_min + x_max, -(y_min + y_max)]) * (0.5 * metres_per_pixel),
        direction=unknown(n), speed=unknown(n), size=unknown(n, 3), heading=unknown(n),
    )  # fmt: skip
