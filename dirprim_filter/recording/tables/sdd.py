"""Tracks from the Stanford Drone Dataset: `annotations.txt`, boxes in the pixels of a video.

Source: the dataset's README: track id, xmin, ymin, xmax, ymax, frame, lost, occluded, generated, "label",
separated by spaces; image y points down. The centre of the box is the position; north is up in the image.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np

from dirprim_filter.recording.tables.delimited import DelimitedText
from dirprim_filter.recording.tables.table import GrowingTable, Table

TRACK_ID, FRAME, LOST, LABEL = 0, 5, 6, 9
CORNERS = {1: "xmin", 2: "ymin", 3: "xmax", 4: "ymax"}
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
    if not (np.isfinite(metres_per_pixel) and metres_per_pixel > 0):
        raise ValueError(f"metres_per_pixel: expected a positive number, got {metres_per_pixel}")
    table = GrowingTable()
    for block in DelimitedText(path, delimiters=" ").blocks(n_cells=N_CELLS):
        lost = block.floats(LOST, "lost") != 0
        label = np.array(block.texts(LABEL), np.str_)
        other = np.zeros_like(lost) if labels is None else ~np.isin(label, list(labels))
        table.losses.drop("marked as lost", lost)
        table.losses.drop("of another label", other & ~lost)
        x_min, y_min, x_max, y_max = (block.floats(column, name) for column, name in CORNERS.items())
        table.extend(
            block.texts(TRACK_ID), kept=~(lost | other), label=label,
            time_ns=block.frame_times(FRAME, frames_per_second=frames_per_second),
            position=np.column_stack([x_min + x_max, -(y_min + y_max)]) * (0.5 * metres_per_pixel),
        )  # fmt: skip
    return table.whole()
