"""A run that is streamed to an .rrd file, and what stands in such a file, as arrays."""

from pathlib import Path

import numpy as np
from rerun.chunk import RrdReader

from dirprim_filter.viewer.sink import RerunSink
from dirprim_filter.viewer.stream import TIMELINE

DRIVERS = [*Path("/usr/share/vulkan/icd.d").glob("*.json"), *Path("/etc/vulkan/icd.d").glob("*.json")]
"""Of Vulkan, without one of which the viewer draws nothing."""


def write_run(path, frames, primitives=None, truth=None, **options):
    with RerunSink(save=path, **options) as sink:
        if primitives is not None:
            sink.log_map(primitives)
        if truth is not None:
            sink.log_truth(truth)
        sink.log_run({})
        for frame in frames:
            sink.write(frame)
    return path


def rows_of(path, entity, column, *, timeline=TIMELINE):
    """(time, values) of each row of one entity, ascending in time; None is static."""
    rows: list[tuple[int | None, np.ndarray]] = []
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        if chunk.entity_path != entity or column not in batch.schema.names:
            continue
        timed = timeline in batch.schema.names
        times = batch.column(timeline).to_numpy().astype(np.int64).tolist() if timed else [None] * batch.num_rows
        values = [_array(v) for v in batch.column(column).to_pylist()]
        rows += [(t, v) for t, v in zip(times, values, strict=True) if v.ndim]
    return sorted(rows, key=lambda row: row[0] or 0)


def values_of(path, entity, column):
    """Those of its rows, in order of time."""
    return [values for _, values in rows_of(path, entity, column)]


def _array(values):
    """Of lines with different lengths an array of objects."""
    try:
        return np.array(values)
    except ValueError:
        return np.array([*values, None], object)[:-1]
