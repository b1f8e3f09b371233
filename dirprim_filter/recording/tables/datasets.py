"""Data sets of road users in their own forms: SDD, TrajNet, Argoverse 2, nuScenes.

Direction and speed of all are differenced from the positions. Sources: the readme of the Stanford Drone Dataset;
Sadeghian et al., TrajNet: Towards a Benchmark for Human Trajectory Prediction, 2018; Wilson et al., Argoverse 2, 2021,
and its api, av2; Caesar et al., nuScenes: A Multimodal Dataset for Autonomous Driving, CVPR 2020, and its kit.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.recording.errors import TableError
from dirprim_filter.recording.losses import Losses
from dirprim_filter.recording.schemas.attitude import heading, rotated
from dirprim_filter.recording.tables.files import arrow_columns, text_columns
from dirprim_filter.recording.tables.named_columns import SIZE
from dirprim_filter.recording.tables.table import Table, table_of
from dirprim_filter.recording.vehicle_rows import VehicleRows
from dirprim_filter.track_ids import Numbers

SDD = ("track id", "xmin", "ymin", "xmax", "ymax", "frame", "lost", "occluded", "generated", "label")
TRAJNET = ("frame", "track id", "x", "y")
ANNOTATIONS, POSES = "annotations.feather", "city_SE3_egovehicle.feather"
"""Boxes in the axes of the vehicle at their time, and its poses in the city, of Argoverse 2."""
QUATERNION, PLACE = ("qx", "qy", "qz", "qw"), ("tx_m", "ty_m", "tz_m")
NUSCENES = "sample_annotation"
XYZW, LENGTH_WIDTH_HEIGHT = [1, 2, 3, 0], [1, 0, 2]
"""nuScenes has w and the width first."""


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
    rows = VehicleRows(
        names=names, vehicle=vehicle, time_ns=table.frame_times("frame", frames_per_second=frames_per_second),
        position=np.column_stack([x_min + x_max, -(y_min + y_max)]) * (0.5 * metres_per_pixel),
    )  # fmt: skip
    lost = table.floats("lost") != 0
    losses.drop("marked as lost", lost)
    return table_of(rows[~lost], label=table.texts("label")[~lost], losses=losses)


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
    return table_of(VehicleRows.of(whole[vehicle], time_ns=time_ns, position=table.numbers("xy")))


def read_argoverse(path: str | Path) -> Table:
    """The annotated tracks of a log of the Argoverse 2 sensor data set, in the city's frame.

    Rows without a pose of the vehicle at their very time are dropped and counted.

    Args:
        path: the folder of the log, or its `annotations.feather`.

    Raises:
        TableError: a file lacks a column, or one is of another type.
        OSError: a file cannot be read.
    """
    folder = Path(path) if Path(path).is_dir() else Path(path).parent
    boxes, poses = arrow_columns(folder / ANNOTATIONS), arrow_columns(folder / POSES)
    poses.require(("timestamp_ns", *QUATERNION, *PLACE))
    boxes.require(("timestamp_ns", "track_uuid", "category", *SIZE, *QUATERNION, *PLACE))
    time_ns, pose_ns = (of.whole_numbers("timestamp_ns") for of in (boxes, poses))
    order = np.argsort(pose_ns, kind="stable")
    at = order[np.minimum(np.searchsorted(pose_ns, time_ns, sorter=order), order.size - 1)]
    turn, place = poses.numbers(QUATERNION)[at], poses.numbers(PLACE)[at]
    known = (pose_ns[at] == time_ns) & turn.any(axis=1)
    towards = rotated(turn, rotated(boxes.numbers(QUATERNION), np.broadcast_to([1.0, 0.0, 0.0], (len(boxes), 3))))
    names, vehicle = boxes.ids("track_uuid")
    rows = VehicleRows(
        names=names, vehicle=vehicle, time_ns=time_ns, size=boxes.numbers(SIZE),
        position=(rotated(turn, boxes.numbers(PLACE)) + place)[:, :2],
        heading=np.arctan2(towards[:, 1], towards[:, 0]),
    )  # fmt: skip
    losses = Losses()
    losses.drop("without a pose of the vehicle at their time", ~known)
    return table_of(rows[known], label=boxes.texts("category")[known], losses=losses, files=(boxes.path, poses.path))


def read_nuscenes(path: str | Path) -> Table:
    """The annotated tracks of all scenes of nuScenes, or a data set in its form, a group each, in the map's frame.

    Args:
        path: the folder of the tables, as `v1.0-mini`.

    Raises:
        TableError: a table is no JSON, or lacks a field or a record that another names.
        OSError: a table cannot be read.
    """
    files = {name: Path(path) / f"{name}.json" for name in (NUSCENES, "sample", "instance", "category")}
    boxes, samples, instances, categories = map(_records, files.values())
    try:
        sample, instance, category = ({one["token"]: one for one in of} for of in (samples, instances, categories))
        of_sample = [sample[box["sample_token"]] for box in boxes]
        names = [box["instance_token"] for box in boxes]
        label = [category[instance[name]["category_token"]]["name"] for name in names]
        time_us = np.array([one["timestamp"] for one in of_sample], np.int64)
        group = Numbers().of([one["scene_token"] for one in of_sample])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        remedy = "unpack them anew"
        raise TableError(Path(path), "", "tables that fit each other", f"none for {error}", remedy) from error
    rows = VehicleRows.of(
        np.array(names, np.str_), time_ns=time_us * 1000, group=group,
        position=_vectors(files[NUSCENES], boxes, "translation", 3)[:, :2],
        heading=heading(_vectors(files[NUSCENES], boxes, "rotation", 4)[:, XYZW]),
        size=_vectors(files[NUSCENES], boxes, "size", 3)[:, LENGTH_WIDTH_HEIGHT],
    )  # fmt: skip
    return table_of(rows, label=np.array(label, np.str_), files=tuple(files.values()))


def _records(path: Path) -> list[dict[str, Any]]:
    try:
        records = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise TableError(path, "", "JSON", str(error), "unpack it anew") from error
    if not isinstance(records, list) or not records or not all(isinstance(one, dict) for one in records):
        raise TableError(path, "", "an array of records", type(records).__name__, "give the folder of nuScenes' tables")
    return records


def _vectors(path: Path, boxes: list[dict[str, Any]], field: str, n: int) -> FloatArray:
    """(n_boxes, n) of a field."""
    try:
        vectors = np.array([box[field] for box in boxes], np.float64).reshape(len(boxes), n)
    except (KeyError, TypeError, ValueError) as error:
        raise TableError(path, "", f"{n} numbers as {field} of each", str(error), "unpack it anew") from error
    return vectors
