"""Detections or tracks from a JSON file: an array of frames, or a frame in each line.

A frame is read as a JSON message of a log is: by the paths of its fields, such as `.objs[].id`.
"""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dirprim_filter.recording.decoding.json_plan import JsonPlan
from dirprim_filter.recording.errors import TableError
from dirprim_filter.recording.losses import Losses
from dirprim_filter.recording.schemas.family import FieldMapping
from dirprim_filter.recording.tables.table import Table, table_of
from dirprim_filter.recording.transforms.geodesy import Origin, on_plane
from dirprim_filter.track_ids import numbered


def read_json(path: str | Path, mapping: FieldMapping, *, origin: Origin | None = None) -> Table:
    """The objects of a JSON file's frames.

    Args:
        path: the file; UTF-8.
        mapping: where a frame contains its objects, its time included.
        origin: of the plane, where places are longitudes and latitudes; left out, the first place.

    Raises:
        TableError: the file is no JSON, or no frame of it holds such objects.
        MissingExtraError: pyproj is not installed.
        ValueError: the mapping has no time.
        OSError: the file cannot be read.
    """
    path, family = Path(path), mapping.family()
    if not family.fields.keys() & {"time", "time_s"}:
        raise ValueError(f"fields: expected time= or time_s=, got {mapping}")
    frames = _frames(path)
    columns = JsonPlan(family.fields).run([json.dumps(frame).encode() for frame in frames])
    rows = family.objects(columns, np.full(len(frames), path.stem))
    losses = Losses(dropped=Counter(columns.failures.values()))
    if not len(rows):
        got = next(iter(losses.dropped), f"{len(frames)} frames without one")
        raise TableError(path, 1, f"objects at {mapping}", got, "compare the paths with the file")
    if "latitude" in mapping.paths:
        place = np.column_stack([rows.position, rows.height])
        rows = replace(rows, position=on_plane(origin, place)[:, :2])
    names, vehicle = numbered(rows.track_id)
    return table_of(
        replace(rows, names=np.array(names, np.str_), track_id=vehicle, time_ns=rows.stamp_ns), losses=losses
    )


def _frames(path: Path) -> list[Any]:
    """The elements of the array, or of the lines.

    Raises:
        TableError: neither.
    """
    text = path.read_text(encoding="utf-8", errors="replace")
    if text.lstrip()[:1] == "[":
        return list(_parsed(path, 1, text))
    lines = enumerate(text.splitlines(), start=1)
    return [_parsed(path, number, line) for number, line in lines if line.strip()]


def _parsed(path: Path, line: int, text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        remedy = "a file is an array of frames, or has one in each line"
        raise TableError(path, line, "JSON", str(error), remedy) from error
