"""Tracks from TrajNet, and ETH and UCY in its form: text of frame, id, x and y in metres.

Source: Sadeghian et al., TrajNet: Towards a Benchmark for Human Trajectory Prediction, 2018. Frames are numbered as in
the video, of which not each is annotated, so the rate is that of the video, not of the rows.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dirprim_filter.recording.tables.delimited import DelimitedText
from dirprim_filter.recording.tables.table import GrowingTable, Table

FRAME, TRACK_ID, X, Y = range(4)


def read_trajnet(path: str | Path, *, frames_per_second: float) -> Table:
    """The tracks of a text of frame, id, x, y, with spaces or tabs between; direction and speed are differenced.

    Args:
        path: the file.
        frames_per_second: how many frames, as they are numbered, pass in a second: of ETH and UCY 25, where each tenth
            is annotated.

    Raises:
        TableError: a row has not four cells, or a cell is no number.
        ValueError: a rate that is not positive.
        OSError: the file cannot be read.
    """
    table = GrowingTable()
    for block in DelimitedText(path, delimiters=" \t").blocks(n_cells=4):
        table.extend(
            [name.removesuffix(".0") for name in block.texts(TRACK_ID)],
            time_ns=block.frame_times(FRAME, frames_per_second=frames_per_second),
            position=np.column_stack([block.floats(X, "x"), block.floats(Y, "y")]),
        )
    return table.whole()
