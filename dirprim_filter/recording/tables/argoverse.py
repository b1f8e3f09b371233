"""Tracks from a log of the Argoverse 2 sensor data set, by pyarrow (extra `parquet`).

`annotations.feather` has boxes in the axes of the vehicle at their time, `city_SE3_egovehicle.feather` its poses in the
city. Source: Wilson et al., Argoverse 2, NeurIPS Datasets and Benchmarks 2021, and its api, av2.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.recording.losses import Losses
from dirprim_filter.recording.schemas.attitude import rotated
from dirprim_filter.recording.tables.arrow_table import ArrowTable
from dirprim_filter.recording.tables.named_columns import SIZE
from dirprim_filter.recording.tables.table import Table, table_of
from dirprim_filter.recording.vehicle_rows import VehicleRows

ANNOTATIONS, POSES = "annotations.feather", "city_SE3_egovehicle.feather"
TIME, TRACK_ID, LABEL = "timestamp_ns", "track_uuid", "category"
QUATERNION = ("qx", "qy", "qz", "qw")
PLACE = ("tx_m", "ty_m", "tz_m")


def read_argoverse(path: str | Path) -> Table:
    """The annotated tracks of a log, in the city's frame; direction and speed are differenced from the positions.

    Rows without a pose of the vehicle at their very time are dropped and counted.

    Args:
        path: the folder of the log, or its `annotations.feather`.

    Raises:
        TableError: a file lacks a column, or one is of another type.
        MissingExtraError: pyarrow is not installed.
        OSError: a file cannot be read.
    """
    folder = Path(path) if Path(path).is_dir() else Path(path).parent
    boxes, poses = ArrowTable(folder / ANNOTATIONS), ArrowTable(folder / POSES)
    poses.require((TIME, *QUATERNION, *PLACE))
    boxes.require((TIME, TRACK_ID, LABEL, *SIZE, *QUATERNION, *PLACE))
    time_ns, pose_ns = boxes.whole_numbers(TIME), poses.whole_numbers(TIME)
    order = np.argsort(pose_ns, kind="stable")
    at = order[np.minimum(np.searchsorted(pose_ns, time_ns, sorter=order), order.size - 1)]
    turn, place = _columns(poses, QUATERNION)[at], _columns(poses, PLACE)[at]
    known = (pose_ns[at] == time_ns) & turn.any(axis=1)
    forward = rotated(_columns(boxes, QUATERNION), np.broadcast_to([1.0, 0.0, 0.0], (time_ns.size, 3)))
    towards = rotated(turn, forward)
    rows = VehicleRows.of(
        boxes.texts(TRACK_ID), time_ns=time_ns,
        position=(rotated(turn, _columns(boxes, PLACE)) + place)[:, :2],
        heading=np.arctan2(towards[:, 1], towards[:, 0]), size=_columns(boxes, SIZE),
    )  # fmt: skip
    losses = Losses()
    losses.drop("without a pose of the vehicle at their time", ~known)
    return table_of(rows[known], label=boxes.texts(LABEL)[known], losses=losses, files=(boxes.path, poses.path))


def _columns(table: ArrowTable, names: tuple[str, ...]) -> FloatArray:
    """(n, k) of k columns."""
    return np.column_stack([table.floats(name) for name in names])
