"""Maps, beliefs and forecasts as they come, to the rerun viewer and into .rrd files.

One entity for each kind of thing, its instances batched: the viewer slows down with hundreds of entities.
What is true for the whole log is static; all else stands on the log's own time line, exact to the nanosecond.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sized
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
from dirprim_filter.estimates import COASTING_FROM_S, Particles, TrackedFrame
from dirprim_filter.forecasting import Forecasts
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer import marks
from dirprim_filter.viewer.batch import FrameBatch, SmoothedBatch, Steps
from dirprim_filter.viewer.blueprint import TRAIL_S, Layout
from dirprim_filter.viewer.curves import Tally, Truth, metrics
from dirprim_filter.viewer.focus import Focus, Look
from dirprim_filter.viewer.legend import Legend
from dirprim_filter.viewer.lifetimes import Lifetimes, lane_columns, lane_styles
from dirprim_filter.viewer.report import run_report
from dirprim_filter.viewer.static_scene import static_scene
from dirprim_filter.viewer.stream import Stream, time_column

BATCH_FRAMES = 64
"""Frames that a file gets at a time;"""
LIVE_S = 0.1
"""a viewer gets them so often: one by one, a fast run would wait for its viewer."""
IN_FOCUS = 100
"""Particles of the vehicle in focus, where none were asked for."""
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
        self._truth: Truth | None = None
        self._batch = self._new_batch()
        self._focus, self._lines, self._tally = Focus(focus), Lifetimes(), Tally()
        self._smoothed = SmoothedBatch()
        self._steps = Steps()
        self._not_forecast: set[str] = set()
        self._forecasts: dict[str, marks.Forecast] = {}
        self._forecast_ns = 0
        self._forecasts_pending = False
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
        self._show_pending_forecasts()
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
        self._primitives = primitives
        petals = shapes.rose_petals(primitives)
        fastest = shapes.fastest_speed(petals)
        box = shapes.busy_box(primitives, share=BUSY_SHARE)
        legend = Legend.of(primitives, extent=box, fastest=fastest)
        self._static("/map/cells", marks.cells(primitives.tessellation))
        self._static("/map/roses", marks.roses(petals, fastest=fastest))
        self._static("/map/flow", marks.flow(shapes.Flow.of(primitives)))
        self._static("/map/legend", legend.bar(), legend.ticks())
        self._static("/legend", legend.text())
        self._box = box

    def log_truth(self, tracks: Tracks) -> None:
        """Outlines and trails of the vehicles from the truth, to which the estimates are compared."""
        if len(tracks) == 0:
            return
        self._truth = Truth(tracks)
        if self._box is None:
            self._box = shapes.extent(tracks.position)
        times, counts = np.unique(tracks.time_ns, return_counts=True)
        self._static("/truth", marks.truth_style(int(counts.max())))
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
        n_each = [len(frame) for frame in frames]
        places = np.concatenate([frame.position for frame in frames])
        times = time_column([int(frame.time_ns[0]) for frame in frames])
        drawn = marks.detections(places, n_each)
        self.stream.send_columns("/detections", times, drawn)

    def log_report(self, markdown: str) -> None:
        """A text about the run: configuration, results."""
        self._static("/report", rr.TextDocument(markdown, media_type="text/markdown"))

    def log_run(self, made_with: Mapping[str, str], results: Mapping[str, str]) -> None:
        """What the run was made with and what came of it, in figures of its own and in those given; may come again."""
        self.log_report(run_report(made_with, self._tally.results() | dict(results)))

    # --- What changes with time -----------------------------------------------------------------------------

    def write(self, frame: TrackedFrame) -> None:
        """Show one frame; vehicles that it does not name vanish."""
        believed = frame.estimates
        if self._box is None:
            self._box = shapes.extent(np.concatenate([believed.position, frame.detections.position]))
        if not self._laid_out:
            self._begin(tracked=True)
            self._batch = self._new_batch()
        self._forget_forecasts(frame.time_ns)
        values = metrics(frame, float("nan") if self._truth is None else self._truth.nees(frame))
        self._tally.add(values)
        look = self._focus.see(frame)
        in_full = self._focus.in_full(frame, box=self._box)
        self._batch.add(
            frame, particles=self._particles(frame, in_full, look), in_full=in_full, steps=self._steps.of(frame),
            look=look, metrics=values,
        )  # fmt: skip
        self._lines.see(frame)
        self._not_forecast = set(compress(frame.names, (has_no_forecast(believed) | ~in_full).tolist()))
        if self._is_due(self._batch):
            self._send_batch()
        self.stream.look_after()

    def write_smoothed(self, frame: TrackedFrame) -> None:
        """Show what a smoother says of one instant; frames in order of time, each later than the filter's."""
        self._smoothed.add(frame)
        if self._is_due(self._smoothed):
            self._send_smoothed()

    def write_forecast(self, forecasts: Forecasts) -> None:
        """Rollouts and their regions; shown until the vehicle ends or forecasts of another time come.

        Vehicles that coast, whose direction is not yet known, or that are not drawn in full have none.

        Args:
            forecasts: of one shape for one time; after `write` of the frame of that time.
        """
        if forecasts.time_ns != self._forecast_ns:
            self._show_pending_forecasts()
            self._forecasts = {}
        drawn = zip(forecasts.track_id, forecasts.coarse_paths(), forecasts.regions, strict=True)
        for name, paths, regions in drawn:
            if name not in self._not_forecast:
                self._forecasts[name] = marks.Forecast.of(paths, regions)
        self._forecast_ns = forecasts.time_ns
        self._forecasts_pending = True

    def _particles(self, frame: TrackedFrame, in_full: BoolArray, look: Look | None) -> Particles:
        """So many of each vehicle that is drawn in full; or some of the one in focus."""
        rows, n = in_full, self._n_particles
        if not n:
            rows, n = np.array([look is not None and name == look.track_id for name in frame.names], np.bool_), IN_FOCUS
        of_each = len(frame.particles) // max(len(frame.estimates), 1)
        return frame.particles.thinned(max(of_each // n, 1), rows=None if rows.all() else rows)

    def _forget_forecasts(self, time_ns: int) -> None:
        """Drop the forecasts of vehicles that have gone."""
        self._show_pending_forecasts()
        if not self._forecasts:
            return
        since_ns = time_ns - int(COASTING_FROM_S * 1e9)
        here = {name for name, (seen_ns, *_) in self._steps.last.items() if seen_ns >= since_ns} - self._not_forecast
        kept = {name: paths for name, paths in self._forecasts.items() if name in here}
        if len(kept) < len(self._forecasts):
            self._forecasts = kept
            self._show_forecasts(time_ns)

    def _show_pending_forecasts(self) -> None:
        if self._forecasts_pending:
            self._show_forecasts(self._forecast_ns)
        self._forecasts_pending = False

    def _show_forecasts(self, time_ns: int) -> None:
        for entity, columns in marks.forecasts(self._forecasts):
            self.stream.send_columns(entity, time_column([time_ns]), columns)

    # --- The stream -----------------------------------------------------------------------------------------

    def _new_batch(self) -> FrameBatch:
        depth = 100.0 if self._box is None else float(np.ptp(self._box[:, 1]))
        return FrameBatch(primitives=self._primitives, depth=depth)

    def _is_due(self, batch: Sized) -> bool:
        return len(batch) >= BATCH_FRAMES or (self.stream.live and time.monotonic() >= self._sent_s + LIVE_S)

    def _send_batch(self) -> None:
        """Send what is gathered: to a file by a thread of its own, so that the tracker goes on meanwhile."""
        self._background.wait()
        self._sent_s = time.monotonic()
        batch, lanes, styles = self._batch, list(lane_columns(self._lines)), list(lane_styles(self._lines))
        self._lines.changes, self._lines.entries = {}, []
        self._batch = self._new_batch()

        def send() -> None:
            for entity, times, columns in chain(batch.columns(), lanes):
                self.stream.send_columns(entity, times, columns)
            for entity, style in styles:
                self._static(entity, style)

        if self.stream.live:
            send()
        else:
            self._background.do(send)

    def _send_smoothed(self) -> None:
        self._background.wait()
        for entity, times, columns in self._smoothed.columns():
            self.stream.send_columns(entity, times, columns)

    def _static(self, path: str, *what: rr.AsComponents) -> None:
        self.stream.log(path, *what)

    def lay_out(self, layout: Layout) -> None:
        """Arrange the viewer's window."""
        self.stream.send_blueprint(layout.blueprint())
        self._laid_out = True

    def _begin(self, *, tracked: bool) -> None:
        box = shapes.extent(np.empty((0, 2))) if self._box is None else self._box
        for path, style in static_scene():
            self._static(path, style)
        if tracked and self._primitives is not None:
            self._static("/map/roses", marks.ROSES_UNDER_TRAFFIC)
        self._static(BOX_PATH, rr.AnyValues(box=box.ravel()))
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
