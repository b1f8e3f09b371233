"""Maps, beliefs and forecasts as they come, to the rerun viewer and into .rrd files.

One entity for each kind of thing, its instances batched: the viewer slows down with hundreds of entities.
What is true for the whole log is static; all else stands on the log's own time line, exact to the nanosecond.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sized
from itertools import chain, compress
from types import TracebackType
from typing import Any, Self

import numpy as np
import rerun as rr

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.background import Background
from dirprim_filter.detections import Detections
from dirprim_filter.drawing import shapes
from dirprim_filter.drawing.sight import has_no_forecast
from dirprim_filter.estimates import Particles, TrackedFrame
from dirprim_filter.forecasting import Forecasts
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer import marks
from dirprim_filter.viewer.batch import Columns, Drawn, Step, Steps, columns, smoothed_columns
from dirprim_filter.viewer.blueprint import TRAIL_S, Layout
from dirprim_filter.viewer.curves import Metrics, curve_names
from dirprim_filter.viewer.direction_panel import polar_styles
from dirprim_filter.viewer.focus import Focus, Look
from dirprim_filter.viewer.lifetimes import Lifetimes
from dirprim_filter.viewer.stream import Stream, time_column
from dirprim_filter.viewer.texts import legend, run_report

BATCH_FRAMES = 64
"""Frames that a file gets at a time;"""
LIVE_S = 0.1
"""a viewer gets them so often: one by one, a fast run would wait for its viewer."""
IN_FOCUS = 100
"""Particles of the vehicle in focus, where none were asked for."""
FRESH_S = 1.2
"""A forecast is shown until the next, and for so long at most."""
BUSY_SHARE = 0.75
"""The view is fitted to the square that holds this share of the traffic."""
BOX_PATH = "/view"
"""Gives the part of the plane that the view is fitted to."""


class RerunSink:
    """An `EstimateSink` that shows frames in rerun; use it in a `with` block, frames in order of time.

    Args:
        stream: where they go.
        n_particles: of each vehicle, drawn in every frame; 0: only some of the vehicle in focus.
        focus: id of the vehicle to follow; None: the one with the largest innovations.

    Attributes:
        stream: as given.
    """

    def __init__(self, stream: Stream, *, n_particles: int = 0, focus: str | None = None) -> None:
        self.stream = stream
        self._n_particles = n_particles
        self._box: FloatArray | None = None
        self._laid_out = False
        self._primitives: PrimitiveMap | None = None
        self._focus, self._lines, self._metrics = Focus(focus), Lifetimes(), Metrics()
        self._drawn: list[Drawn] = []
        self._smoothed: list[tuple[TrackedFrame, Step]] = []
        self._steps, self._smoothed_steps = Steps(), Steps()
        self._not_forecast: set[str] = set()
        self._forecast_ns: int | None = None
        self._background = Background("dirprim-rerun")
        self._sent_s = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close(whole=kind is None or issubclass(kind, KeyboardInterrupt))

    def flush(self) -> None:
        """Send what is left."""
        self._send_batch()
        self._background.wait()
        self._send_smoothed()
        if not self._laid_out:
            self._begin(tracked=False)
        self.stream.flush()

    def close(self, *, whole: bool = True) -> None:
        """Send what is left and close; a file gets its name if it is whole, else keeps its temporary one."""
        try:
            try:
                self.flush()
            finally:
                self._background.end()
        except BaseException:
            whole = False
            raise
        finally:
            self.stream.close(whole=whole)

    # --- What holds for the whole log -----------------------------------------------------------------------

    def log_map(self, primitives: PrimitiveMap) -> None:
        """The cells, their roses coloured by mean speed, and the legend; the view is fitted to them."""
        petals = shapes.rose_petals(primitives)
        fastest = shapes.fastest_speed(petals)
        self._primitives, self._box = primitives, shapes.busy_box(primitives, share=BUSY_SHARE)
        self.stream.log("/map/cells", marks.cells(primitives.tessellation))
        self.stream.log("/map/roses", marks.roses(petals, fastest=fastest))
        for path, parts in legend(primitives, extent=self._box, fastest=fastest):
            self.stream.log(path, *parts)

    def log_truth(self, tracks: Tracks) -> None:
        """Outlines and trails of the vehicles from the truth, to which the estimates are compared."""
        if len(tracks) == 0:
            return
        self._metrics.compare_to(tracks)
        if self._box is None:
            self._box = shapes.extent(tracks.position)
        times, counts = np.unique(tracks.time_ns, return_counts=True)
        self.stream.log("/truth", marks.truth_style(int(counts.max())))
        # One empty instant after the last: otherwise the last vehicles would stand there for ever.
        after = times[-1] + (int(np.median(np.diff(times))) if len(times) > 1 else 1)
        outlines = marks.truth(tracks).partition(np.append(counts, 0))
        self.stream.send_columns("/truth", time_column([*times.tolist(), int(after)]), outlines)
        start, end = _steps_of(tracks)
        when, counts = np.unique(tracks.time_ns[end], return_counts=True)
        if when.size:
            trails = marks.true_trails(np.stack([tracks.position[start], tracks.position[end]], axis=1))
            self.stream.send_columns("/truth/trails", time_column(when.tolist()), trails.partition(counts))

    def log_detections(self, detections: Detections) -> None:
        """Detections of a log without estimates."""
        frames = list(detections.frames())
        if not frames:
            return
        if self._box is None:
            self._box = shapes.extent(detections.position)
        drawn = marks.detections(np.concatenate([f.position for f in frames]), [len(f) for f in frames])
        self.stream.send_columns("/detections", time_column([int(f.time_ns[0]) for f in frames]), drawn)

    def log_report(self, markdown: str) -> None:
        """A text about the run: configuration, results."""
        self.stream.log("/report", rr.TextDocument(markdown, media_type="text/markdown"))

    def log_run(self, made_with: Mapping[str, str], results: Mapping[str, str]) -> None:
        """What the run was made with and what came of it, in figures of its own and in those given; may come again."""
        self.log_report(run_report(made_with, self._metrics.results() | dict(results)))

    # --- What changes with time -----------------------------------------------------------------------------

    def write(self, frame: TrackedFrame) -> None:
        """Show one frame; vehicles that it does not name vanish."""
        if self._box is None:
            self._box = shapes.extent(np.concatenate([frame.estimates.position, frame.detections.position]))
        if not self._laid_out:
            self._begin(tracked=True)
        if self._forecast_ns is not None and frame.time_ns > self._forecast_ns + FRESH_S * 1e9:
            self._show(marks.forecasts([], np.empty((0, 0, 0, 2)), []), frame.time_ns)
            self._forecast_ns = None
        look, in_full = self._focus.see(frame, box=self._box)
        self._drawn.append(Drawn(
            frame, self._steps.of(frame), self._particles(frame, in_full, look), in_full, look, self._metrics.of(frame)
        ))  # fmt: skip
        self._lines.see(frame)
        self._not_forecast = set(compress(frame.names, (has_no_forecast(frame.estimates) | ~in_full).tolist()))
        if self._is_due(self._drawn):
            self._send_batch()
        self.stream.look_after()

    def write_smoothed(self, frame: TrackedFrame) -> None:
        """Show what a smoother says of one instant; frames in order of time, each later than the filter's."""
        self._smoothed.append((frame, self._smoothed_steps.of(frame)))
        if self._is_due(self._smoothed):
            self._send_smoothed()

    def write_forecast(self, forecasts: Forecasts) -> None:
        """Rollouts and their regions, after `write` of the frame of their time.

        Vehicles that coast, whose direction is not yet known, or that are not drawn in full have none.
        """
        shown = [row for row, name in enumerate(forecasts.track_id) if name not in self._not_forecast]
        names, regions = [forecasts.track_id[row] for row in shown], [forecasts.regions[row] for row in shown]
        self._show(marks.forecasts(names, forecasts.coarse_paths()[shown], regions), forecasts.time_ns)
        self._forecast_ns = forecasts.time_ns

    def _particles(self, frame: TrackedFrame, in_full: BoolArray, look: Look | None) -> Particles:
        """So many of each vehicle that is drawn in full; or some of the one in focus."""
        rows, n = in_full, self._n_particles
        if not n:
            rows, n = np.array([look is not None and name == look.track_id for name in frame.names], np.bool_), IN_FOCUS
        of_each = len(frame.particles) // max(len(frame.estimates), 1)
        return frame.particles.thinned(max(of_each // n, 1), rows=None if rows.all() else rows)

    # --- The stream -----------------------------------------------------------------------------------------

    def _show(self, drawn: Iterable[tuple[str, rr.ComponentColumnList]], time_ns: int) -> None:
        for entity, one in drawn:
            self.stream.send_columns(entity, time_column([time_ns]), one)

    def _is_due(self, batch: Sized) -> bool:
        return len(batch) >= BATCH_FRAMES or (self.stream.live and time.monotonic() >= self._sent_s + LIVE_S)

    def _send_batch(self) -> None:
        """Send what is gathered: to a file by a thread of its own, so that the tracker goes on meanwhile."""
        self._background.wait()
        if not self._drawn:
            return
        self._sent_s = time.monotonic()
        styles, lanes = list(self._lines.styles()), list(self._lines.columns())
        depth = 100.0 if self._box is None else float(np.ptp(self._box[:, 1]))
        drawn: Iterator[Columns] = columns(self._drawn, primitives=self._primitives, depth=depth)
        self._drawn = []

        def send() -> None:
            for entity, times, one in chain(drawn, lanes):
                self.stream.send_columns(entity, times, one)
            for entity, style in styles:
                self.stream.log(entity, style)

        if self.stream.live:
            send()
        else:
            self._background.do(send)

    def _send_smoothed(self) -> None:
        self._background.wait()
        smoothed, self._smoothed = self._smoothed, []
        for entity, times, one in smoothed_columns(smoothed) if smoothed else ():
            self.stream.send_columns(entity, times, one)

    def lay_out(self, layout: Layout) -> None:
        """Arrange the viewer's window."""
        self.stream.send_blueprint(layout.blueprint())
        self._laid_out = True

    def _begin(self, *, tracked: bool) -> None:
        box = shapes.extent(np.empty((0, 2))) if self._box is None else self._box
        for path, style in chain(marks.STYLES.items(), curve_names(), polar_styles()):
            self.stream.log(path, style)
        if tracked and self._primitives is not None:
            self.stream.log("/map/roses", marks.ROSES_UNDER_TRAFFIC)
        self.stream.log(BOX_PATH, rr.AnyValues(box=box.ravel()))
        self.lay_out(Layout(box=box, live=self.stream.live, tracked=tracked))


def open_stream(
    application_id: str = "dirprim", *, n_particles: int = 0, focus: str | None = None, **places: Any
) -> RerunSink:
    """A sink whose frames go to `places`: the arguments and errors are those of `Stream` and of `RerunSink`."""
    return RerunSink(Stream(application_id, **places), n_particles=n_particles, focus=focus)


def _steps_of(tracks: Tracks) -> tuple[IntArray, IntArray]:
    """Rows of each vehicle's neighbouring instants, ascending in the time of the later."""
    vehicle = tracks.vehicle
    order = np.lexsort((tracks.time_ns, vehicle))
    same = np.diff(vehicle[order]) == 0
    near = np.diff(tracks.time_ns[order]) <= TRAIL_S * 1e9
    start, end = order[:-1][same & near], order[1:][same & near]
    by_time = np.argsort(tracks.time_ns[end], kind="stable")
    return start[by_time], end[by_time]
