"""Tracks from nuScenes, or a data set in its form: the folder of its tables, as `v1.0-mini`.

`sample_annotation` has boxes in the frame of the map, `sample` their times, `instance` and `category` what they are.
Source: Caesar et al., nuScenes: A Multimodal Dataset for Autonomous Driving, CVPR 2020, and its development kit.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.recording.errors import TableError
from dirprim_filter.recording.schemas.attitude import heading
from dirprim_filter.recording.tables.table import Table, table_of
from dirprim_filter.recording.vehicle_rows import VehicleRows
from dirprim_filter.track_ids import Numbers

ANNOTATIONS = "sample_annotation"
NS_PER_US = 1000
XYZW = [1, 2, 3, 0]
"""nuScenes has w first."""
LENGTH_WIDTH_HEIGHT = [1, 0, 2]
"""nuScenes has the width first."""


def read_nuscenes(path: str | Path) -> Table:
    """The annotated tracks of all scenes, a group each; direction and speed are differenced from the positions.

    Args:
        path: the folder of the tables.

    Raises:
        TableError: a table is no JSON, or lacks a field or a record that another names.
        OSError: a table cannot be read.
    """
    files = {name: Path(path) / f"{name}.json" for name in (ANNOTATIONS, "sample", "instance", "category")}
    boxes, samples, instances, categories = (_records(file) for file in files.values())
    try:
        sample, instance, category = ({one["token"]: one for one in of} for of in (samples, instances, categories))
        of_sample = [sample[box["sample_token"]] for box in boxes]
        names = [box["instance_token"] for box in boxes]
        label = [category[instance[name]["category_token"]]["name"] for name in names]
        time_us = np.array([one["timestamp"] for one in of_sample], np.int64)
        scenes = Numbers()
        group = scenes.of([one["scene_token"] for one in of_sample])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise TableError(
            Path(path), "", "tables that fit each other", f"none for {error}", "unpack them anew"
        ) from error
    rows = VehicleRows.of(
        np.array(names, np.str_), time_ns=time_us * NS_PER_US, group=group,
        position=_vectors(files[ANNOTATIONS], boxes, "translation", 3)[:, :2],
        heading=heading(_vectors(files[ANNOTATIONS], boxes, "rotation", 4)[:, XYZW]),
        size=_vectors(files[ANNOTATIONS], boxes, "size", 3)[:, LENGTH_WIDTH_HEIGHT],
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
        vectors = np.array([box[field] for box in boxes], np.float64)
    except (KeyError, TypeError, ValueError) as error:
        raise TableError(path, "", f"{n} numbers as {field} of each", str(error), "unpack it anew") from error
    if vectors.shape != (len(boxes), n):
        raise TableError(path, "", f"{n} numbers as {field} of each", f"{vectors.shape[1:]}", "unpack it anew")
    return vectors
