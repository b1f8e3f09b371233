"""Trackers of others in an experiment: a command that is run for each seed, or tables that one wrote before."""

from __future__ import annotations

import csv
import os
import re
import shlex
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import typer

from dirprim_filter.arrays import IntArray
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.evaluation.scenes import Scene
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.evaluation.tracking import Other
from dirprim_filter.evaluation.tracking_experiment import TrackingExperiment
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.estimate_tables import read_tracked_rows
from dirprim_filter.tracks import Tracks

DETECTIONS, INSTANTS, ESTIMATES, SEED = "{detections}", "{instants}", "{estimates}", "{seed}"
"""What stands in a command for its files, and in either for the seed of the run."""


@dataclass(frozen=True, slots=True)
class Command:
    """A tracker that is started for each run; a process group of its own, which ends with it.

    Attributes:
        name: of the row.
        words: the program and its arguments.
        noise_m: metres, of detections that state no covariance.
        limit_s: seconds after which it is stopped.
    """

    name: str
    words: tuple[str, ...]
    noise_m: float
    limit_s: float

    def __call__(self, scenes: Sequence[Scene], seed: int) -> TrackedRows:
        """What it writes of a run.

        Raises:
            ValueError: it cannot be started, fails, takes too long, or writes no estimates.
        """
        with tempfile.TemporaryDirectory(prefix="dirprim-") as folder:
            files = {what: Path(folder) / f"{what[1:-1]}.csv" for what in (DETECTIONS, INSTANTS, ESTIMATES)}
            _write(files[DETECTIONS], _detections(scenes, self.noise_m))
            _write(files[INSTANTS], _instants(scenes, [np.unique(scene.truth.time_ns) for scene in scenes]))
            stands_for = {what: str(path) for what, path in files.items()} | {SEED: str(seed)}
            names = re.compile("|".join(map(re.escape, stands_for)))
            words = [names.sub(lambda found: stands_for[found[0]], word) for word in self.words]
            written = files[ESTIMATES]
            try:
                self._run(words, written)
                with written.open("rb") as file:  # what it is, whatever name the command was given for it
                    suffix = {b"\x89MCA": ".mcap", b"PAR1": ".parquet"}.get(file.read(4), ".csv")
                written = written.rename(written.with_suffix(suffix))
                return _read(written, scenes)
            except (RecordingError, ValueError, OSError) as error:
                said = str(error).replace(str(written), ESTIMATES)
                raise ValueError(f"{self.name}, seed {seed}: {said}") from error

    def _run(self, words: list[str], written: Path) -> None:
        with (reported := written.with_name("reported")).open("wb") as errors:
            try:
                process = subprocess.Popen(  # noqa: S603  the user's own command, a list, no shell
                    words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=errors, start_new_session=True
                )
            except OSError as error:
                raise ValueError(f"cannot start {words[0]}: {error.strerror}") from error
            try:
                code = process.wait(self.limit_s)
            except subprocess.TimeoutExpired as error:
                raise ValueError(f"stopped after {self.limit_s:g} s; --set time_limit_s=... allows more") from error
            finally:
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        if code:
            with reported.open("rb") as file:
                file.seek(max(reported.stat().st_size - 4096, 0))  # where the last line is
                lines = file.read().decode(errors="replace").strip().splitlines()
            raise ValueError(f"ended with {code}: {lines[-1] if lines else 'it reported nothing'}")
        if not written.is_file():
            raise ValueError(f"ended well and wrote no {ESTIMATES}")


def others_of(
    commands: Sequence[str], patterns: Sequence[str], experiment: TrackingExperiment, *, limit_s: float
) -> tuple[dict[str, Other], list[Path]]:
    """The trackers of `--method NAME=COMMAND` and `--estimates PATTERN`, by the names of their rows; their tables.

    Raises:
        BadParameter: a command cannot be started or names no files, a table is not there, or a name is used twice.
    """
    found, tables = list[tuple[str, str, Other]](), list[Path]()
    for text in commands:
        name, _, line = text.partition("=")
        found.append(("--method", name, Command(name, _words(name, line), experiment.noise_m, limit_s)))
    for pattern in patterns:
        if SEED not in pattern and experiment.n_seeds > 1:
            _refuse("--estimates", f"{pattern}: expected {SEED} in its name, for there are {experiment.n_seeds} runs")
        for seed in range(experiment.seed, experiment.seed + experiment.n_seeds):
            tables.append(Path(pattern.replace(SEED, str(seed))))
            if not tables[-1].is_file():
                _refuse("--estimates", f"{tables[-1]}: there is no such file")
        read = partial(_written, pattern)
        found.append(("--estimates", Path(pattern).name, read))
    for i, (option, name, _) in enumerate(found):
        if not name or name in experiment.methods or name in [other for _, other, _ in found[:i]]:
            _refuse(option, f"expected another name for each row, got {name!r}")
    return {name: track for _, name, track in found}, tables


def _words(name: str, line: str) -> tuple[str, ...]:
    try:
        words = tuple(shlex.split(line))
    except ValueError as error:
        _refuse("--method", f"{name}: {error}")
    if not (DETECTIONS in line and ESTIMATES in line):
        _refuse("--method", f"{name}: expected a command with {DETECTIONS} and {ESTIMATES}, got {line!r}")
    if shutil.which(words[0]) is None:
        _refuse("--method", f"{name}: {words[0]}: there is no such program, or it may not be executed")
    return words


def _refuse(option: str, why: str) -> NoReturn:
    raise typer.BadParameter(why, param_hint=option)


def _written(pattern: str, scenes: Sequence[Scene], seed: int) -> TrackedRows:
    """What a tracker's table of an earlier run has."""
    return _read(Path(pattern.replace(SEED, str(seed))), scenes)


def _read(path: Path, scenes: Sequence[Scene]) -> TrackedRows:
    return read_tracked_rows(path, truth=Tracks.concatenate(scene.truth for scene in scenes))


def _write(path: Path, columns: dict[str, list[Any]]) -> None:
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(columns)
        table.writerows(zip(*columns.values(), strict=True))


def _detections(scenes: Sequence[Scene], noise_m: float) -> dict[str, list[Any]]:
    """Rows of all scenes, one after the other; ids where the sensor states them."""
    seen = Detections.concatenate(scene.seen for scene in scenes)
    covariance = np.where(np.isnan(seen.covariance), noise_m**2 * np.eye(2), seen.covariance)
    columns = _instants(scenes, [scene.seen.time_ns for scene in scenes])
    if (seen.track_id != NO_ID).any():
        columns["track_id"] = seen.track_id.tolist()
    columns |= {"x_m": seen.position[:, 0].tolist(), "y_m": seen.position[:, 1].tolist()}
    for name, (i, j) in {"xx": (0, 0), "xy": (0, 1), "yy": (1, 1)}.items():
        columns[f"covariance_{name}_m2"] = covariance[:, i, j].tolist()
    if np.isfinite(seen.confidence).any():
        columns["confidence"] = ["" if np.isnan(of) else of for of in seen.confidence.tolist()]
    return columns


def _instants(scenes: Sequence[Scene], times_ns: Sequence[IntArray]) -> dict[str, list[Any]]:
    """Times of each scene, to the nanosecond, and its group where there are several."""
    times = [f"{Decimal(time_ns).scaleb(-9):f}" for of in times_ns for time_ns in of.tolist()]
    columns: dict[str, list[Any]] = {"time_s": times}
    if len(scenes) > 1:
        columns["group"] = [scene.group for scene, of in zip(scenes, times_ns, strict=True) for _ in range(len(of))]
    return columns
