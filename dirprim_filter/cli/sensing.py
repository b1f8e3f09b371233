"""The sensor that a command goes by: of a file, or learned from the first minutes of the log itself."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer

from dirprim_filter.cli.options import AUTO
from dirprim_filter.cli.progress import working
from dirprim_filter.cli.settings import Settings
from dirprim_filter.cli.texts import counted
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.recording.sensor_file import load_sensor
from dirprim_filter.sensor import Sensor

if TYPE_CHECKING:
    from dirprim_filter.evaluation.calibration.own_tracks import OwnTracks
    from dirprim_filter.evaluation.calibration.self_calibration import SelfCalibration

logger = logging.getLogger(__name__)

UNITS = {
    "latency_s": "s", "detection_probability": "per frame", "clutter_density": "per m2 and frame", "outlier_share": "",
    "spread_m": "m", "bias_m": "m", "correlated_share": "of the variance", "correlation_s": "s",
    "birth_density": "per m2 and frame",
}  # fmt: skip
"""Of the numbers of a sensor and a scene."""
MOST_ROWS, MOST_ROWS_UNASKED = 200_000, 10_000
"""Detections that it is learned from, if `auto` is asked for and by default: these take about a second with ids, some
seconds without, as they are tracked under several parameters."""
SENSOR_COUNTS = "its covariances are not used, but the sensor's model; without --sensor they are, --noise for the rest"
LOG_COUNTS = "its covariances are used, and the stated noise where it has none; --sensor goes before them"


def sensor_of(
    sensor: str | None, frames: Iterable[Detections], *, log: Path, noise_m: float | None, is_configured: bool,
    is_live: bool, with_ids: bool, seed: int,
) -> tuple[Sensor | None, OwnTracks | None, Iterable[Detections]]:  # fmt: skip
    """The sensor's model, if its file was given; or what the log shows of it, which is printed; and all its frames.

    Where neither the user nor the log's covariances state the noise, the log is asked; if it does not show how the
    sensor errs, a line says so, and the default noise is left. None: the noise is that of the filter. Of a log without
    ids there are its own tracks too, which tell misses, clutter and births, whoever states the noise.

    Args:
        sensor: a file, or `AUTO`.
        frames: of the log, which is read once: those that are learned from are kept.
        log: its name.
        noise_m: as the user states it.
        is_configured: a file of the user's states the noise, and all the rest.
        is_live: the frames come as they are measured.
        with_ids: the detections' ids count.
        seed: of learning.

    Raises:
        BadParameter: `auto` was asked for, and the log is live.
        ValueError: the file is none; or `auto` was asked for, and the log does not show how the sensor errs.
    """
    if sensor not in (None, AUTO):
        return load_sensor(sensor), None, _beside_covariances(frames, log, SENSOR_COUNTS)
    if is_live:
        why = "a live pipe does not wait for it"
        if sensor == AUTO:
            raise typer.BadParameter(f"auto learns from a log that is whole: {why}", param_hint="--sensor")
        if noise_m is None and not is_configured:
            _say_default(why)
        return None, None, frames
    if is_configured and sensor is None:
        return None, None, _beside_covariances(frames, log, LOG_COUNTS)
    coming = iter(frames)
    first = first_minutes(coming, n_most=MOST_ROWS_UNASKED if sensor is None else MOST_ROWS)
    seen = Detections.concatenate(first if with_ids else [frame.without_ids() for frame in first])
    everything: Iterable[Detections] = chain(first, coming)
    is_bare = np.isnan(seen.covariance[:, 0, 0])
    if sensor is None and (noise_m is not None or not is_bare.all()):
        if noise_m is not None:
            everything = _beside_covariances(everything, log, LOG_COUNTS)
        elif is_bare.any():
            _say_default("some of its rows do")
        return None, _scene(seen, log, FilterConfig().noise_m if noise_m is None else noise_m), everything
    found = _learned(seen, log, seed=seed, is_asked=sensor == AUTO)
    if found is None:
        return None, None, everything
    return found.sensor, found.tracks, _beside_covariances(everything, log, SENSOR_COUNTS)


def configured(
    sensor: Sensor | None, tracks: OwnTracks | None, settings: Settings, filtering: FilterConfig,
    association: TrackingConfig, *, by_map: bool,
) -> tuple[Sensor | None, FilterConfig, TrackingConfig]:  # fmt: skip
    """A sensor and configurations with what is known of it and of the scene, but for what settings state themselves.

    A map knows itself where vehicles are and begin.
    """
    of_sensor = ("detection_probability", "clutter_density")
    if tracks is not None:
        rates = of_sensor if by_map else (*of_sensor, "birth_density", "vehicle_density")
        learned = {name: getattr(tracks.tracking, name) for name in rates if name not in settings}
        association = replace(association, **learned)
    if sensor is None:
        return None, filtering, association
    own: dict[str, Any] = {name: getattr(association, name) for name in of_sensor if name in settings}
    if "outlier_probability" in settings:
        own["outlier_share"] = filtering.outlier_probability
    sensor = replace(sensor, **own)
    return sensor, *sensor.informs(filtering, association)


def _beside_covariances(frames: Iterable[Detections], log: Path, which: str) -> Iterator[Detections]:
    """The frames; at the first that states covariances a line says which of two errors counts."""
    is_said = False
    for frame in frames:
        if not (is_said or np.isnan(frame.covariance[:, 0, 0]).all()):
            logger.warning("%s: %s", log, which)
            is_said = True
        yield frame


def _learned(seen: Detections, log: Path, *, seed: int, is_asked: bool) -> SelfCalibration | None:
    from dirprim_filter.evaluation.calibration.self_calibration import self_calibrate

    with working(f"learning how the sensor of {log.name} errs"):
        try:
            found = self_calibrate(seen, rng=np.random.default_rng(seed))
        except ValueError as error:
            if is_asked:
                raise ValueError(f"{log}: --sensor auto: {error}") from error
            _say_default(str(error))
            return None
    typer.echo("\n".join(_lines(found)))
    return found


def _scene(seen: Detections, log: Path, noise_m: float) -> OwnTracks | None:
    """Of a log without ids whose noise is stated; None with ids."""
    if (seen.track_id != NO_ID).any():
        return None
    from dirprim_filter.evaluation.calibration.own_tracks import own_tracks

    with working(f"learning what the sensor of {log.name} misses"):
        try:
            found = own_tracks(seen, noise_m=noise_m)
        except ValueError as error:
            typer.echo(f"misses, clutter and births: the defaults, unless --set states them: {error}")
            return None
    source, rates = _source(found)
    typer.echo("\n".join([f"scene, learned from {source}", *number_lines(rates)]))
    return found


def _lines(found: SelfCalibration) -> list[str]:
    """What was learned, from what, and what is not known."""
    numbers, tracks = found.sensor.numbers(), found.tracks
    shown = {f"{axis}.{name}": numbers[f"{axis}.{name}"]
             for axis in ("along", "across")
             for name in ("spread_m", "correlated_share", "correlation_s")
             if name != "correlation_s" or numbers[f"{axis}.correlated_share"]}  # fmt: skip
    source = f"{found.n_detections} detections in {counted(found.n_pieces, 'piece')} of track"
    if tracks is not None:
        source, rates = _source(tracks)
        shown |= rates
    return [f"sensor, learned from {source}", *number_lines(shown), *(f"not known: {why}" for why in found.unknown)]


def _say_default(why: str) -> None:
    typer.echo(f"noise: {FilterConfig().noise_m:g} m, unless the log states it: {why}")


def first_minutes(frames: Iterator[Detections], *, n_most: int) -> list[Detections]:
    """The frames of the first five minutes, longer until they are 1,000 rows, but no more than reach so many rows."""
    first: list[Detections] = []
    n_rows = 0
    for frame in frames:
        first.append(frame)
        n_rows += len(frame)
        passed_s = (int(frame.time_ns[0]) - int(first[0].time_ns[0])) * 1e-9 if len(frame) else 0.0
        if n_rows > n_most or (passed_s > 300.0 and n_rows > 1_000):
            break
    return first


def _source(tracks: OwnTracks) -> tuple[str, dict[str, float]]:
    """What tracks of detections without ids are learned from, and their rates."""
    rates = ("detection_probability", "clutter_density", "birth_density")
    source = f"{len(tracks.seen)} detections without ids, {tracks.n_true} of them of vehicles"
    return source, {name: getattr(tracks.tracking, name) for name in rates}


def number_lines(numbers: Mapping[str, float | None], width: Mapping[str, float] | None = None) -> list[str]:
    """A line for each number of a sensor, with half the width of its interval where that is given."""
    lines = []
    for name, value in numbers.items():
        if value is not None and (width is None or name in width):
            uncertain = "" if width is None else f"+- {width[name]:<8.2g} "
            lines.append(f"{name:<24}{value:>10.3g} {uncertain}{UNITS[name.rpartition('.')[2]]}".rstrip())
    return lines
