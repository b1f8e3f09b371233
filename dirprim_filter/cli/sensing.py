"""The sensor that a command goes by: of a file, or learned from the first minutes of the log itself."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from dirprim_filter.cli.options import AUTO
from dirprim_filter.cli.texts import counted

if TYPE_CHECKING:
    from dirprim_filter.detections import Detections
    from dirprim_filter.evaluation.calibration.own_tracks import OwnTracks
    from dirprim_filter.evaluation.calibration.self_calibration import SelfCalibration
    from dirprim_filter.sensor import Sensor

logger = logging.getLogger(__name__)

UNITS = {
    "latency_s": "s", "detection_probability": "per frame", "clutter_density": "per m2 and frame", "outlier_share": "",
    "spread_m": "m", "bias_m": "m", "correlated_share": "of the variance", "correlation_s": "s",
    "birth_density": "per m2 and frame",
}  # fmt: skip
"""Of the numbers of a sensor and a scene."""
LEARNED_FROM_S, FEWEST_ROWS = 300.0, 1_000
"""Seconds of a log that a sensor is learned from; of sensors that look seldom, as many as these detections take."""
MOST_ROWS, MOST_ROWS_UNASKED = 200_000, 10_000
"""Detections that it is learned from, if `auto` is asked for and by default: these take less than a second."""


SENSOR_COUNTS = "its covariances are not used, but the sensor's model; without --sensor they are, --noise for the rest"
LOG_COUNTS = "its covariances are used, and the stated noise where it has none; --sensor goes before them"


def sensor_of(
    sensor: str | None, frames: Iterable[Detections], *, log: Path, is_stated: bool, is_live: bool, with_ids: bool,
    seed: int,
) -> tuple[Sensor | None, OwnTracks | None, Iterable[Detections]]:  # fmt: skip
    """The sensor's model, if its file was given; or what the log shows of it, which is printed; and all its frames.

    Where neither the user nor the log's covariances state the noise, the log is asked; if it does not show how the
    sensor errs, a line says so, and the default noise is left. None: the noise is that of the filter. Of a log without
    ids there are its own tracks too.

    Args:
        sensor: a file, or `AUTO`.
        frames: of the log, which is read once: those that are learned from are kept.
        log: its name.
        is_stated: the user has stated the noise.
        is_live: the frames come as they are measured.
        with_ids: the detections' ids count.
        seed: of learning.

    Raises:
        BadParameter: `auto` was asked for, and the log is live.
        ValueError: the file is none; or `auto` was asked for, and the log does not show how the sensor errs.
    """
    from dirprim_filter.recording.sensor_file import load_sensor

    if sensor not in (None, AUTO):
        return load_sensor(sensor), None, _beside_covariances(frames, log, SENSOR_COUNTS)
    if is_live:
        why = "a live pipe does not wait for it"
        if sensor == AUTO:
            raise typer.BadParameter(f"auto learns from a log that is whole: {why}", param_hint="--sensor")
        if not is_stated:
            _say_default(why)
        return None, None, frames
    if is_stated and sensor is None:
        return None, None, _beside_covariances(frames, log, LOG_COUNTS)
    found, frames = _learned(frames, log, seed=seed, is_asked=sensor == AUTO, with_ids=with_ids)
    if found is None:
        return None, None, frames
    return found.sensor, found.tracks, _beside_covariances(frames, log, SENSOR_COUNTS)


def _beside_covariances(frames: Iterable[Detections], log: Path, which: str) -> Iterator[Detections]:
    """The frames; at the first that states covariances a line says which of two errors counts."""
    import numpy as np

    is_said = False
    for frame in frames:
        if not (is_said or np.isnan(frame.covariance[:, 0, 0]).all()):
            logger.warning("%s: %s", log, which)
            is_said = True
        yield frame


def _learned(
    frames: Iterable[Detections], log: Path, *, seed: int, is_asked: bool, with_ids: bool
) -> tuple[SelfCalibration | None, Iterable[Detections]]:
    import numpy as np

    from dirprim_filter.cli.progress import working
    from dirprim_filter.detections import Detections
    from dirprim_filter.evaluation.calibration.self_calibration import self_calibrate

    coming = iter(frames)
    with working(f"learning how the sensor of {log.name} errs"):
        first = first_minutes(coming, n_most=MOST_ROWS if is_asked else MOST_ROWS_UNASKED)
        everything = chain(first, coming)
        detections = Detections.concatenate(first)
        if not is_asked and not np.isnan(detections.covariance[:, 0, 0]).all():
            return None, everything
        detections = detections if with_ids else detections.without_ids()
        try:
            found = self_calibrate(detections, rng=np.random.default_rng(seed))
        except ValueError as error:
            if is_asked:
                raise ValueError(f"{log}: --sensor auto: {error}") from error
            _say_default(str(error))
            return None, everything
    typer.echo("\n".join(_lines(found)))
    return found, everything


def _lines(found: SelfCalibration) -> list[str]:
    """What was learned, from what, and what is not known."""
    numbers, tracks = found.sensor.numbers(), found.tracks
    shown = {f"{axis}.{name}": numbers[f"{axis}.{name}"]
             for axis in ("along", "across")
             for name in ("spread_m", "correlated_share", "correlation_s")
             if name != "correlation_s" or numbers[f"{axis}.correlated_share"]}  # fmt: skip
    source = f"{found.n_detections} detections in {counted(found.n_pieces, 'piece')} of track"
    if tracks is not None:
        source = f"{len(tracks.seen)} detections without ids, {found.n_detections} of them of vehicles"
        shown |= {name: numbers[name] for name in ("detection_probability", "clutter_density")}
        shown["birth_density"] = tracks.tracking.birth_density
    unknown = [f"not known: {line}" for line in found.unknown]
    return [f"sensor, learned from {source}", *number_lines(shown), *unknown]


def _say_default(why: str) -> None:
    from dirprim_filter.config import FilterConfig

    typer.echo(f"noise: {FilterConfig().noise_m:g} m, unless the log states it: {why}")


def first_minutes(frames: Iterator[Detections], *, n_most: int) -> list[Detections]:
    """The frames of the first minutes, longer of a log of few rows, but no more than reach so many rows."""
    first: list[Detections] = []
    n_rows = 0
    for frame in frames:
        first.append(frame)
        n_rows += len(frame)
        passed_s = (int(frame.time_ns[0]) - int(first[0].time_ns[0])) * 1e-9 if len(frame) else 0.0
        if n_rows > n_most or (passed_s > LEARNED_FROM_S and n_rows > FEWEST_ROWS):
            break
    return first


def number_lines(numbers: Mapping[str, float | None], width: Mapping[str, float] | None = None) -> list[str]:
    """A line for each number of a sensor, with half the width of its interval where that is given."""
    lines = []
    for name, value in numbers.items():
        if value is not None and (width is None or name in width):
            uncertain = "" if width is None else f"+- {width[name]:<8.2g} "
            lines.append(f"{name:<24}{value:>10.3g} {uncertain}{UNITS[name.rpartition('.')[2]]}".rstrip())
    return lines
