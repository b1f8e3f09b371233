"""`dirprim learn`: a map of directional primitives from logs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import dirprim_filter as dp
from dirprim_filter.cli import exit_codes, options
from dirprim_filter.cli.reading import Reading
from dirprim_filter.cli.texts import counted


def learn(
    logs: options.LogsOrStore,
    output: options.Output,
    tessellation: options.Tessellation = "joint",
    cell_size: options.CellSize = None,
    cells: options.CellCount = None,
    modes: options.HowModes = "bic",
    primitive: options.HowShaped = "curved",
    sensor: options.SensorFile = None,
    seed: options.Seed = 0,
    force: options.Force = False,
    *,
    reading: Reading,
) -> int:
    """Learn from logs, or a store, how vehicles move.

    `dirprim store learn` has more options for stores, such as --half-life.

    Example: dirprim learn recordings/roundabout_learn.mcap -o map.mcap
    """
    if any(map(_is_store, logs)):
        if len(logs) > 1 or sensor is not None or reading.given:
            raise ValueError(
                f"{logs[0]}: a store is learned from alone, and fixes how its logs are read; leave out the rest"
            )
        from dirprim_filter.cli.store import learn as learn_store

        return learn_store(logs[0], output, tessellation, cell_size, cells, modes, primitive, seed=seed, force=force)
    import numpy as np

    from dirprim_filter.cli.progress import learning_progress
    from dirprim_filter.cli.results import save_learned
    from dirprim_filter.recording.sensor_file import load_sensor
    from dirprim_filter.sensor import without_bias

    sensing = None if sensor is None else load_sensor(sensor)
    how: dict[str, Any] = {
        "tessellation": tessellation, "cell_size": cell_size, "n_cells": cells, "modes": modes, "primitive": primitive,
    }  # fmt: skip
    log, rng = reading.tracks(logs), np.random.default_rng(seed)
    tracks = log.tracks if sensing is None else without_bias(log.tracks, sensing)
    with learning_progress() as bars:
        learned = dp.learn_primitives(tracks, progress=bars.progress, stage=bars.stage, rng=rng, **how)
    said = {"seed": seed, **how, "sensor": None if sensing is None else repr(sensing), **reading.said()}
    counts = f"{counted(tracks.n_tracks, 'track')}, {counted(len(tracks), 'row')}"
    save_learned(learned, output, inputs=logs, said=said, counts=counts, force=force)
    return exit_codes.of_losses(log.losses)


def _is_store(path: Path) -> bool:
    """Whether it is no log: a folder that rosbag2 did not record, or a URL that a store is under."""
    from dirprim_filter.recording.container.remote_file import as_url
    from dirprim_filter.recording.container.ros_bags import METADATA
    from dirprim_filter.recording.errors import RecordingError

    if as_url(str(path)) is None:
        return path.is_dir() and not (path / METADATA).exists()
    from dirprim_filter.store.store import Store

    try:
        return path.suffix != ".mcap" and Store.is_at(path)
    except RecordingError:  # a server of logs may answer anything: who reads it as a log says what is wrong
        return False
