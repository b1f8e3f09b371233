"""The sensor that a command goes by: of a file, or learned from the log itself."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from dirprim_filter.cli import losses
from dirprim_filter.cli.counts import counted
from dirprim_filter.cli.options import AUTO

if TYPE_CHECKING:
    from dirprim_filter.cli.reading import Reading
    from dirprim_filter.detections import Detections
    from dirprim_filter.evaluation.calibration.self_calibration import SelfCalibration
    from dirprim_filter.sensor import Sensor

UNITS = {
    "latency_s": "s", "detection_probability": "per frame", "clutter_density": "per m2 and frame", "outlier_share": "",
    "spread_m": "m", "bias_m": "m", "correlated_share": "of the variance", "correlation_s": "s",
}  # fmt: skip
"""Of a sensor's numbers."""
LEARNED_FROM_S = 300.0
"""Seconds of a log that a sensor is learned from."""
MOST_ROWS, MOST_ROWS_UNASKED = 200_000, 10_000
"""Detections that it is learned from, if `auto` is asked for and by default: these take some three seconds."""


def is_pipe(log: Path) -> bool:
    """Whether a log is standard input, or another pipe."""
    return str(log) == "-" or log.is_fifo()


def sensor_of(
    sensor: str | None, log: Path, reading: Reading, *, noise_m: float | None, config: Path | None, with_ids: bool,
    seed: int,
) -> Sensor | None:  # fmt: skip
    """The sensor's model, if its file was given; or what the log shows of it, which is printed.

    Where nothing is stated, by the user or by the log's covariances, a file or folder is asked; if it does not show how
    the sensor errs, a line says so, and the default noise is left. None: the noise is that of the filter.

    Raises:
        BadParameter: the noise was given as well; or `auto` was asked for, and the log cannot be read twice, or its ids
            are not to be used.
        ValueError: the file is none; or `auto` was asked for, and the log does not show how the sensor errs.
    """
    from dirprim_filter.recording.sensor_file import load_sensor

    is_here = log.is_file() or log.is_dir()
    if sensor is None:
        if noise_m is not None or config is not None:
            return None
        if not (is_here and with_ids):
            elsewhere = "a pipe is read once" if is_pipe(log) else "a URL would be fetched twice, as by --sensor auto"
            _say_default("without ids no vehicle is named again" if is_here else elsewhere)
            return None
        return _learned(log, reading, seed=seed, is_asked=False)
    if noise_m is not None:
        raise typer.BadParameter("a sensor's model contains the noise: give one of the two", param_hint="--noise")
    if sensor != AUTO:
        return load_sensor(sensor)
    if is_pipe(log):
        raise typer.BadParameter("auto reads the log twice, which a pipe cannot: give a file", param_hint="--sensor")
    if not with_ids:
        raise typer.BadParameter("auto learns from vehicles that are named again: leave out one", param_hint="--no-ids")
    return _learned(log, reading, seed=seed, is_asked=True)


def _learned(log: Path, reading: Reading, *, seed: int, is_asked: bool) -> Sensor | None:
    import numpy as np

    from dirprim_filter.cli.progress import working
    from dirprim_filter.evaluation.calibration import self_calibrate

    with working(f"learning how the sensor of {log.name} errs"):
        with losses.said_later():
            detections = _first_minutes(log, reading, n_most=MOST_ROWS if is_asked else MOST_ROWS_UNASKED)
        if not is_asked and not np.isnan(detections.covariance[:, 0, 0]).all():
            return None
        try:
            found = self_calibrate(detections, rng=np.random.default_rng(seed))
        except ValueError as error:
            if is_asked:
                raise ValueError(f"{log}: --sensor auto: {error}") from error
            _say_default(str(error))
            return None
    typer.echo(learned_text(found))
    return found.sensor


def _say_default(why: str) -> None:
    from dirprim_filter.config import FilterConfig

    typer.echo(f"noise: {FilterConfig().noise_m:g} m, unless the log states it: {why}")


def _first_minutes(log: Path, reading: Reading, *, n_most: int) -> Detections:
    from dirprim_filter.detections import Detections

    frames: list[Detections] = []
    n_rows = 0
    for frame in reading.detections(log, motion=False):
        frames.append(frame)
        n_rows += len(frame)
        passed_s = (int(frame.time_ns[0]) - int(frames[0].time_ns[0])) * 1e-9 if len(frame) else 0.0
        if n_rows > n_most or passed_s > LEARNED_FROM_S:
            break
    return Detections.concatenate(frames)


def learned_text(found: SelfCalibration) -> str:
    """A line for each number, and for what is not known."""
    lines = [f"sensor, learned from {found.n_detections} detections in {counted(found.n_pieces, 'piece')} of track"]
    numbers = found.sensor.numbers()
    for axis in ("along", "across"):
        lasts = ("correlation_s",) if numbers[f"{axis}.correlated_share"] else ()
        for own in ("spread_m", "correlated_share", *lasts):
            lines.append(f"{axis + '.' + own:<24}{numbers[f'{axis}.{own}']:>10.3g} {UNITS[own]}")
    return "\n".join([*lines, *(f"not known: {line}" for line in found.unknown)])
