"""Maps, beliefs and forecasts as they come, to the rerun viewer and into .rrd files.

One entity for each kind of thing, its instances batched: the viewer slows down with hundreds of entities.
What is true for the whole log is static; all else stands on the log's own time line, exact to the nanosecond.
"""

from __future__ import annotations

import logging
import socket
import subprocess
import uuid
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import Self
from urllib.parse import urlsplit

import numpy as np
import rerun as rr

from dirprim_filter.estimates import Estimates, TrackedFrame
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer import marks, shapes
from dirprim_filter.viewer.batch import FrameBatch, time_column
from dirprim_filter.viewer.blueprint import PLOTS, TRAIL_S, blueprint
from dirprim_filter.viewer.legend import Legend
from tessellation.arrays import FloatArray

logger = logging.getLogger(__name__)

VIEWER_PORT = 9876
VIEWER_URL = f"rerun+http://127.0.0.1:{VIEWER_PORT}/proxy"
STARTING_S = 2.0
"""A viewer that still runs after this time has found a screen."""
PLOT_COLOR = (120, 200, 255)
BATCH_FRAMES = 64
"""Frames that a file gets at a time; a viewer gets each as it comes."""
BUSY_SHARE = 0.75
"""The view is fitted to the square that holds this share of the traffic."""
UNSEEN_S = 0.5
"""The forecasts of a vehicle unseen for longer vanish; one report that fails to come does not make them blink."""


def open_stream(
    application_id: str = "dirprim",
    *,
    save: Path | None = None,
    spawn: bool = False,
    connect: str | None = None,
    force: bool = False,
    particle_stride: int = 1,
) -> RerunSink:
    """A stream to a file, to a viewer started for it, to a running viewer, or to several of them.

    Args:
        application_id: recordings with the same one share the viewer's layout.
        save: an .rrd file. It grows under the name `*.part.rrd` and gets its own when it is whole.
        spawn: start a viewer on this machine and leave it open.
        connect: the address of a running viewer, such as `VIEWER_URL`.
        force: overwrite `save`.
        particle_stride: show one particle in so many.

    Raises:
        ValueError: nowhere to stream to, or a stride below 1.
        FileExistsError: `save` exists and `force` is not given.
        ConnectionError: no viewer answers at `connect`, or none could be started.
    """
    if save is None and not spawn and connect is None:
        raise ValueError("save, spawn, connect: expected at least one place to stream to, got none")
    if particle_stride < 1:
        raise ValueError(f"particle_stride: expected at least 1, got {particle_stride}")
    if save is not None and save.exists() and not force:
        raise FileExistsError(f"{save}: exists already; overwrite it with --force or choose another name")
    stream = rr.RecordingStream(application_id, recording_id=_identity(save, live=spawn or connect is not None))
    stream.set_log_time_enabled(False)
    sinks: list[rr.GrpcSink | rr.FileSink] = []
    if spawn:
        rr.spawn(port=VIEWER_PORT, connect=False, executable_path=_viewer_program(), recording=stream)
        _require_listener(VIEWER_URL, "it needs a screen; without one, save to a file")
        sinks.append(rr.GrpcSink(VIEWER_URL))
    if connect is not None and not (spawn and connect == VIEWER_URL):
        _require_listener(connect, "start one with `rerun`")
        sinks.append(rr.GrpcSink(connect))
    file = None
    if save is not None:
        save.parent.mkdir(parents=True, exist_ok=True)
        file = (save.with_name(f"{save.stem}.part.rrd"), save)
        sinks.append(rr.FileSink(file[0]))
    stream.set_sinks(*sinks)
    return RerunSink(stream, file=file, live=len(sinks) > (save is not None), particle_stride=particle_stride)


def show_file(path: Path) -> None:
    """Open a recording in the viewer that runs on this machine, or in a new one, and leave it open.

    Raises:
        ConnectionError: no viewer could be started.
    """
    command = [_viewer_program() or "rerun", str(path)]
    try:
        viewer = subprocess.Popen(  # noqa: S603 - the SDK's own program, without a shell
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            start_new_session=True,
        )  # fmt: skip
        failed = viewer.wait(timeout=STARTING_S) != 0
    except subprocess.TimeoutExpired:  # it runs
        return
    except OSError as error:
        raise ConnectionError(f"{path}: the viewer {command[0]} did not start ({error})") from error
    if failed:
        raise ConnectionError(f"{path}: the viewer did not start; it needs a screen")


def _identity(save: Path | None, *, live: bool) -> uuid.UUID:
    """The same for a file in every run; but a viewer that is still open must not mix two runs into one."""
    if live or save is None:
        return uuid.uuid4()
    return uuid.uuid5(uuid.NAMESPACE_URL, save.resolve().as_uri())


def _viewer_program() -> str | None:
    """The viewer that came with the SDK: the search path may lack it, or hold one of another version."""
    package = find_spec("rerun_cli")
    program = Path(package.origin).with_name("rerun") if package and package.origin else None
    return str(program) if program and program.exists() else None


def _require_listener(url: str, way_out: str) -> None:
    """Without this the SDK would retry for seconds and then lose what was logged."""
    place = urlsplit(url)
    if place.hostname is None:
        raise ConnectionError(f"{url}: expected an address such as {VIEWER_URL}")
    try:
        socket.create_connection((place.hostname, place.port or VIEWER_PORT), timeout=5.0).close()
    except OSError as error:
        raise ConnectionError(f"{url}: no viewer answers ({error}); {way_out}") from error


class RerunSink:
    """An `EstimateSink` that shows frames in rerun; use it in a `with` block, frames in order of time."""

    def __init__(
        self, stream: rr.RecordingStream, *, file: tuple[Path, Path] | None, live: bool, particle_stride: int
    ) -> None:
        self._stream = stream
        self._file = file
        self._live = live
        self._particle_stride = particle_stride
        self._laid_out = False
        self._batch = FrameBatch(particle_stride=particle_stride)
        self._last_seen: dict[str, tuple[int, FloatArray]] = {}
        self._forecasts: dict[str, FloatArray] = {}
        self._forecast_ns = 0
        self._forecasts_pending = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close(whole=kind is None or issubclass(kind, KeyboardInterrupt))

    def close(self, *, whole: bool = True) -> None:
        """Send what is left and close; a file gets its name if it is whole, else keeps its temporary one."""
        self._send_batch()
        self._show_pending_forecasts()
        if not self._laid_out:
            self._lay_out(shapes.extent(np.empty((0, 2))))
        self._stream.flush()
        self._stream.disconnect()
        if self._file is None:
            return
        part, save = self._file
        self._file = None
        if whole:
            part.replace(save)
        else:
            logger.warning("%s: holds what was written before the error", part)

    # --- What holds for the whole log -----------------------------------------------------------------------

    def log_map(self, primitives: PrimitiveMap) -> None:
        """The cells, their roses coloured by mean speed, and the legend; the view is fitted to them."""
        petals = shapes.rose_petals(primitives)
        fastest = shapes.fastest_speed(petals)
        box = shapes.busy_box(primitives, share=BUSY_SHARE)
        legend = Legend(extent=box, fastest=fastest)
        self._static("/map/cells", marks.cells(primitives.tessellation))
        self._static("/map/roses", marks.roses(petals, fastest=fastest))
        self._static("/map/legend", legend.bar(), legend.ticks())
        self._static("/legend", legend.text())
        self._lay_out(box)

    def log_truth(self, tracks: Tracks) -> None:
        """Outlines of the vehicles where they truly were, for simulated logs."""
        if len(tracks) == 0:
            return
        times, counts = np.unique(tracks.time_ns, return_counts=True)
        # One empty instant after the last: otherwise the last vehicles would stand there for ever.
        after = times[-1] + (int(np.median(np.diff(times))) if len(times) > 1 else 1)
        outlines = marks.truth(tracks).partition(np.append(counts, 0))
        self._stream.send_columns("/truth", [time_column([*times.tolist(), int(after)])], outlines)

    def log_report(self, markdown: str) -> None:
        """A text about the run: configuration, results."""
        self._static("/report", rr.TextDocument(markdown, media_type="text/markdown"))

    # --- What changes with time -----------------------------------------------------------------------------

    def write(self, frame: TrackedFrame) -> None:
        """Show one frame; vehicles that it does not name vanish."""
        believed = frame.estimates
        if not self._laid_out:
            self._lay_out(shapes.extent(np.concatenate([believed.position, frame.detections.position])))
        self._forget_forecasts(frame.time_ns)
        self._batch.add(frame, *self._steps(believed))
        self._see(frame.time_ns, believed)
        if self._live or len(self._batch) >= BATCH_FRAMES:
            self._send_batch()

    def write_forecast(self, time_ns: int, track_id: Sequence[str], paths: FloatArray) -> None:
        """Sampled futures; a vehicle's stay until it goes or forecasts of another time come.

        Args:
            time_ns: when the forecasts were made; after `write` of the frame of that time.
            track_id: n ids of the vehicles.
            paths: (n, n_samples, n_steps, 2) metres, of one shape for one time; lines begin at the vehicle's last
                estimate.
        """
        if time_ns != self._forecast_ns:
            self._show_pending_forecasts()
            self._forecasts = {}
        for name, futures in zip(map(str, track_id), paths, strict=True):
            start = (
                np.full((len(futures), 1, 2), self._last_seen[name][1]) if name in self._last_seen else futures[:, :1]
            )
            self._forecasts[name] = np.concatenate([start, futures], axis=1)
        self._forecast_ns = time_ns
        self._forecasts_pending = True

    def _steps(self, believed: Estimates) -> tuple[list[str], FloatArray]:
        """The step of each vehicle since it was last seen; the layout shows the steps of the last seconds."""
        names = [str(name) for name in believed.track_id]
        known = [row for row, name in enumerate(names) if name in self._last_seen]
        start = np.array([self._last_seen[names[row]][1] for row in known]).reshape(-1, 2)
        return [names[row] for row in known], np.stack([start, believed.position[known]], axis=1)

    def _see(self, time_ns: int, believed: Estimates) -> None:
        oldest_ns = time_ns - int(TRAIL_S * 1e9)
        self._last_seen = {name: seen for name, seen in self._last_seen.items() if seen[0] >= oldest_ns}
        names = map(str, believed.track_id)
        self._last_seen |= {name: (time_ns, place) for name, place in zip(names, believed.position, strict=True)}

    def _forget_forecasts(self, time_ns: int) -> None:
        """Drop the forecasts of vehicles that have gone."""
        self._show_pending_forecasts()
        since_ns = time_ns - int(UNSEEN_S * 1e9)
        here = {name for name, (seen_ns, _) in self._last_seen.items() if seen_ns >= since_ns}
        kept = {name: paths for name, paths in self._forecasts.items() if name in here}
        if len(kept) < len(self._forecasts):
            self._forecasts = kept
            self._show_forecasts(time_ns)

    def _show_pending_forecasts(self) -> None:
        if self._forecasts_pending:
            self._show_forecasts(self._forecast_ns)
        self._forecasts_pending = False

    def _show_forecasts(self, time_ns: int) -> None:
        names = list(self._forecasts)
        paths = np.stack(list(self._forecasts.values())) if names else np.empty((0, 1, 1, 2))
        lines = marks.forecasts(names, paths).partition([paths.shape[0] * paths.shape[1]])
        self._stream.send_columns("/forecasts", [time_column([time_ns])], lines)

    # --- The stream -----------------------------------------------------------------------------------------

    def _send_batch(self) -> None:
        for entity, times, columns in self._batch.columns():
            self._stream.send_columns(entity, [times], columns)
        self._batch = FrameBatch(particle_stride=self._particle_stride)

    def _static(self, path: str, *what: rr.AsComponents) -> None:
        self._stream.log(path, *what, static=True)

    def _lay_out(self, box: FloatArray) -> None:
        for path, style in marks.STYLES.items():
            self._static(path, style)
        for path, name in PLOTS.items():
            self._static(path, rr.SeriesLines(names=name, colors=PLOT_COLOR, widths=1.5))
        self._stream.send_blueprint(blueprint(box, live=self._live))
        self._laid_out = True
