"""Data sets of road users in their own forms: SDD and TrajNet.

Direction and speed are differenced from the positions. Sources: the readme of the Stanford Drone Dataset; Sadeghian et
al., TrajNet: Towards a Benchmark for Human Trajectory Prediction, 2018.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dirprim_filter.recording.losses import Losses
from dirprim_filter.recording.rows import Rows
from dirprim_filter.recording.tables.files import text_columns
from dirprim_filter.recording.tables.table import Table, table_of

SDD = ("track id", "xmin", "ymin", "xmax", "ymax", "frame", "lost", "occluded", "generated", "label")
TRAJNET = ("frame", "track id", "x", "y")


def read_sdd(path: str | Path, *, metres_per_pixel: float, frames_per_second: float = 30.0) -> Table:
    """The tracks of an `annotations.txt` of the Stanford Drone Dataset: centres of boxes in the pixels of a video.

    North is up in the image, whose y points down. Rows marked lost are dropped and counted; those interpolated between
    annotations ("generated") are kept.

    Args:
        path: the file.
        metres_per_pixel: scale of the video.
        frames_per_second: rate of the video.

    Raises:
        TableError: a row has not ten cells, or a cell is no number.
        ValueError: a scale that is not positive.
        OSError: the file cannot be read.
    """
    if not (np.isfinite(metres_per_pixel) and metres_per_pixel > 0):
        raise ValueError(f"metres_per_pixel: expected a positive number, got {metres_per_pixel}")
    table, losses = text_columns(path, SDD, delimiters=" "), Losses()
    x_min, y_min, x_max, y_max = table.numbers(SDD[1:5]).T
    names, vehicle = table.ids("track id")
    rows = Rows(
        names=names, track_id=vehicle, time_ns=table.frame_times("frame", frames_per_second=frames_per_second),
        position=np.column_stack([x_min + x_max, -(y_min + y_max)]) * (0.5 * metres_per_pixel),
        label=table.texts("label"),
    )  # fmt: skip
    lost = table.floats("lost") != 0
    losses.drop("marked as lost", lost)
    return table_of(rows[~lost], losses=losses)


def read_trajnet(path: str | Path, *, frames_per_second: float) -> Table:
    """The tracks of a text of frame, id, x, y in metres, with spaces or tabs between, as TrajNet, ETH and UCY have.

    Args:
        path: the file.
        frames_per_second: how many frames, as they are numbered, pass in a second: of ETH and UCY 25, where each tenth
            is annotated.

    Raises:
        TableError: a row has not four cells, or a cell is no number.
        ValueError: a rate that is not positive.
        OSError: the file cannot be read.
    """
    table = text_columns(path, TRAJNET, delimiters=" \t")
    names, vehicle = table.ids("track id")
    time_ns = table.frame_times("frame", frames_per_second=frames_per_second)
    whole = np.array([name.removesuffix(".0") for name in names.tolist()], np.str_)
    return table_of(Rows.named(whole[vehicle], time_ns=time_ns, position=table.numbers("xy")))
