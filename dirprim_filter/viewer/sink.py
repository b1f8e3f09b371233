"""Maps, beliefs and forecasts as they come, to the rerun viewer and into .rrd files.

One entity for each kind of thing, its instances batched: the viewer slows down with hundreds of entities.
What is true for the whole log is static; all else stands on the log's own time line, exact to the nanosecond.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable, Mapping, Sized
from dataclasses import replace
from itertools import chain, compress
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np
import rerun as rr

from dirprim_filter.arrays import FloatArray
from dirprim_filter.detections import Detections
from dirprim_filter.drawing import shapes
from dirprim_filter.drawing.vehicles import has_no_forecast
from dirprim_filter.estimates import Particles, TrackedFrame
from dirprim_filter.forecasting import Forecasts
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer import marks
from dirprim_filter.viewer.blueprint import blueprint
from dirprim_filter.viewer.curves import curve_styles, frame_metrics
from dirprim_filter.viewer.focus import Focus, Look, polar_columns, polar_styles
from dirprim_filter.viewer.stream import Stream, time_column
from dirprim_filter.viewer.texts import Events, legend

logger = logging.getLogger(__name__)

BATCH_FRAMES = 64
"""Frames that a file gets at a time;"""
LIVE_S = 0.1
"""a viewer gets them so often: one by one, a fast run would wait for its viewer."""
IN_FOCUS = 100
"""Particles of the vehicle in focus, where none were asked for."""
FRESH_S = 1.2
"""A forecast is shown until the next, and for so long at most."""


class _Shown(NamedTuple):
    """A frame with the particles that are drawn, a look at one of its vehicles, and the values of its curves."""

    frame: TrackedFrame
    look: Look | None
    metrics: Mapping[str, tuple[float, ...]]


class RerunSink:
    """An `EstimateSink` that shows frames in rerun; use it in a `with` block, frames in order of time.

    Args:
        application_id: as for `Stream`.
        n_particles: of each vehicle, drawn in every frame; 0: only some of the vehicle in focus.
        focus: id of the vehicle to follow; None: the one that is least expected.
        places: where they go, as for `Stream`.

    Attributes:
        stream: on which they go there.
    """

    def __init__(
        self, application_id: str = "dirprim", *, n_particles: int = 0, focus: str | None = None, **places: Any
    ) -> None:  # fmt: skip
        self.stream = Stream(application_id, **places)
        self._n_particles = n_particles
        self._box: FloatArray | None = None
        self._laid_out = False
        self._primitives: PrimitiveMap | None = None
        self._truth: Tracks | None = None
        self._focus, self._events = Focus(focus), Events()
        self._shown: list[_Shown] = []
        self._smoothed: list[TrackedFrame] = []
        self._not_forecast: set[str] = set()
        self._forecast_ns: int | None = None
        self._sent_s = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close(whole=kind is None or issubclass(kind, KeyboardInterrupt))

    def flush(self) -> None:
        """Send what is left."""
        self._send_shown()
        self._send_smoothed()
        if not self._laid_out:
            self._lay_out(tracked=False)
        elif missing := self._focus.missing:
            logger.warning("focus: no vehicle is called %s", missing)
        self.stream.flush()

    def close(self, *, whole: bool = True) -> None:
        """Send what is left and close; a file gets its name if it is whole, else keeps its temporary one."""
        try:
            self.flush()
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
        self._primitives, self._box = primitives, shapes.map_extent(primitives, share=shapes.BUSY_SHARE)
        self.stream.log("/map/cells", marks.cells(primitives.tessellation))
        self.stream.log("/map/roses", marks.roses(petals, fastest=fastest))
        self.stream.log("/legend", rr.TextDocument(legend(fastest), media_type="text/markdown"))

    def log_truth(self, tracks: Tracks) -> None:
        """Outlines and trails of the vehicles from the truth, to which the estimates are compared."""
        if len(tracks) == 0:
            return
        self._truth = tracks = tracks[np.argsort(tracks.time_ns, kind="stable")]
        if self._box is None:
            self._box = shapes.extent(tracks.position)
        times, counts = np.unique(tracks.time_ns, return_counts=True)
        # One empty instant after the last: otherwise the last vehicles would stand there for ever.
        after = times[-1] + (int(np.median(np.diff(times))) if len(times) > 1 else 1)
        self._send(marks.truth(tracks, [*counts.tolist(), 0]), [*times.tolist(), int(after)])

    def log_detections(self, detections: Detections) -> None:
        """Detections of a log without estimates."""
        frames = list(detections.frames())
        if not frames:
            return
        if self._box is None:
            self._box = shapes.extent(detections.position)
        place = np.concatenate([frame.position for frame in frames])
        drawn = marks.detections(place, [len(frame) for frame in frames])
        self._send([drawn], [int(frame.time_ns[0]) for frame in frames])

    def log_run(self, made_with: Mapping[str, str]) -> None:
        """What the run was made with, as properties of the recording."""
        if named := {name: [text] for name, text in made_with.items() if name}:
            self.stream.send_properties("run", rr.DynamicArchetype("run", components=named))

    # --- What changes with time -----------------------------------------------------------------------------

    def write(self, frame: TrackedFrame) -> None:
        """Show one frame; vehicles that it does not name vanish."""
        if self._box is None:
            self._box = shapes.extent(np.concatenate([frame.estimates.position, frame.detections.position]))
        if not self._laid_out:
            self._lay_out(tracked=True)
        if self._forecast_ns is not None and frame.time_ns > self._forecast_ns + FRESH_S * 1e9:
            self._send(marks.forecasts([], np.empty((0, 0, 0, 2)), []), [frame.time_ns])
            self._forecast_ns = None
        look = self._focus.see(frame, box=self._box)
        drawn = replace(frame, particles=self._particles(frame, look))
        self._shown.append(_Shown(drawn, look, frame_metrics(frame, self._truth)))
        self._not_forecast = set(compress(frame.names, has_no_forecast(frame.estimates).tolist()))
        if self._is_due(self._shown):
            self._send_shown()
        self.stream.look_after()

    def write_smoothed(self, frame: TrackedFrame) -> None:
        """Show what a smoother says of one instant; frames in order of time, each later than the filter's."""
        self._smoothed.append(frame)
        if self._is_due(self._smoothed):
            self._send_smoothed()

    def write_forecast(self, forecasts: Forecasts) -> None:
        """Rollouts and their regions, after `write` of the frame of their time.

        Vehicles that coast, or whose direction is not yet known, have none.
        """
        shown = [row for row, name in enumerate(forecasts.track_id) if name not in self._not_forecast]
        names, regions = [forecasts.track_id[row] for row in shown], [forecasts.regions[row] for row in shown]
        self._send(marks.forecasts(names, forecasts.coarse_paths()[shown], regions), [forecasts.time_ns])
        self._forecast_ns = forecasts.time_ns

    def _particles(self, frame: TrackedFrame, look: Look | None) -> Particles:
        """A copy of so many of each vehicle, or of some of the one in focus."""
        rows, n = None, self._n_particles
        if not n:
            rows, n = np.array([look is not None and name == look.track_id for name in frame.names], np.bool_), IN_FOCUS
        of_each = len(frame.particles) // max(len(frame.estimates), 1)
        return frame.particles.thinned(max(of_each // n, 1), rows=rows)

    # --- The stream -----------------------------------------------------------------------------------------

    def _send(self, drawn: Iterable[marks.Columns], times_ns: list[int]) -> None:
        times = time_column(times_ns)
        for entity, columns in drawn:
            self.stream.send_columns(entity, times, columns)

    def _is_due(self, batch: Sized) -> bool:
        return len(batch) >= BATCH_FRAMES or (self.stream.live and time.monotonic() >= self._sent_s + LIVE_S)

    def _send_shown(self) -> None:
        shown, self._shown = self._shown, []
        if not shown:
            return
        self._sent_s = time.monotonic()
        times, depth = [one.frame.time_ns for one in shown], self._depth()
        self._send(marks.frames([one.frame for one in shown], depth=depth), times)
        curves = {path: np.array([one.metrics[path] for one in shown]) for path in shown[0].metrics}
        for path, rows in curves.items():
            columns = rr.Scalars.columns(scalars=rows.ravel()).partition([rows.shape[1]] * len(rows))
            self._send([(path, columns)], times)
        looks = [one.look for one in shown if one.look is not None]
        n_shown = [int(one.look is not None) for one in shown]
        places = np.array([look.position for look in looks]).reshape(-1, 2)
        polar = polar_columns(looks, self._primitives) if looks else ()
        focus = chain([("/focus/ring", marks.ring(places, depth=depth))], polar)
        self._send(((entity, columns.partition(n_shown)) for entity, columns in focus), times)
        entries = [(one.frame.time_ns, *entry) for one in shown for entry in self._events.of(one.frame)]
        if entries:
            when, levels, texts = zip(*entries, strict=True)
            self._send([("/events", rr.TextLog.columns(text=texts, level=levels))], list(when))

    def _send_smoothed(self) -> None:
        shown, self._smoothed = self._smoothed, []
        if shown:
            self._send(marks.smoothed(shown), [frame.time_ns for frame in shown])

    def _depth(self) -> float:
        """Metres of ground in view, from south to north."""
        return 100.0 if self._box is None else float(np.ptp(self._box[:, 1]))

    def _lay_out(self, *, tracked: bool) -> None:
        box = shapes.extent(np.empty((0, 2))) if self._box is None else self._box
        for path, style in chain(marks.STYLES.items(), curve_styles(), polar_styles()):
            self.stream.log(path, style)
        if tracked and self._primitives is not None:
            self.stream.log("/map/roses", marks.ROSES_UNDER_TRAFFIC)
        self.stream.send_blueprint(blueprint(box, live=self.stream.live, tracked=tracked))
        self._laid_out = True
