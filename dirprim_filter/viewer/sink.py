"""Maps, beliefs and forecasts as they come, to the rerun viewer and into .rrd files.

What is true for the whole log is static; all else stands on time lines of elapsed seconds, frames, and the log's own
time, exact to the nanosecond. Truth and detections of a log that lie between two frames come with the later one.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence, Sized
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, compress
from typing import Any, Self

import numpy as np
import rerun as rr

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.drawing import shapes
from dirprim_filter.drawing.vehicles import Trails, has_no_forecast
from dirprim_filter.estimates import Estimates, Particles, TrackedFrame
from dirprim_filter.forecasting import Forecasts
from dirprim_filter.origin import Origin, drawable
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer import curves, marks
from dirprim_filter.viewer.blueprint import blueprint, legend
from dirprim_filter.viewer.lanes import MOST_OWN, OTHER_PATH, Lanes
from dirprim_filter.viewer.matching import Event, Events, Matched, Matcher
from dirprim_filter.viewer.stream import Stream


@dataclass(slots=True)
class _Waiting:
    """Rows of a log, ascending in time, those from `first` on not yet sent; `draw` sends some of some instants."""

    rows: Tracks | Detections
    draw: Callable[[Any, IntArray, list[int]], None]
    first: int = 0


class RerunSink:
    """An `EstimateSink` that shows frames in rerun; use it in a `with` block, frames in order of time.

    Args:
        application_id: as for `Stream`.
        n_particles: of each vehicle, drawn in every frame.
        places: where they go, as for `Stream`.

    Attributes:
        stream: on which they go there.
    """

    def __init__(self, application_id: str = "dirprim", *, n_particles: int = 0, **places: Any) -> None:
        self.stream = Stream(application_id, **places)
        self._n_particles = n_particles
        self._box: FloatArray | None = None
        self._origin: Origin | None = None
        self._laid_out = False
        self._fastest: float | None = None
        self._matcher: Matcher | None = None
        self._events = Events()
        self._happened: list[tuple[int, Event]] = []
        self._lanes = {root: Lanes(root) for root in (*marks.OF_VEHICLES, *curves.PLOTS)}
        self._trails = {root: Trails() for root in marks.OF_VEHICLES}
        self._waiting: list[_Waiting] = []
        self._sensors: list[str] = []
        self._shown, self._smoothed = list[TrackedFrame](), list[TrackedFrame]()
        self._not_forecast: set[str] = set()
        self._forecast_ns: int | None = None
        self._sent_s = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Send what is left and close; a file gets its name if it is whole, else keeps its temporary one."""
        is_whole = False
        try:
            self.flush()
            is_whole = kind is None or issubclass(kind, KeyboardInterrupt)
        finally:
            self.stream.close(whole=is_whole)

    def flush(self) -> None:
        """Send what is left."""
        self._send_shown()
        self._send_smoothed()
        if not self._laid_out:
            times = [waiting.rows.time_ns for waiting in self._waiting]
            self.stream.frames_ns += np.unique(np.concatenate([np.empty(0, np.int64), *times])).tolist()
            self._lay_out(tracked=False)
        if self.stream.frames_ns:
            self._send_waiting(self.stream.frames_ns[-1], is_last=True)
        self.stream.flush()

    def log_map(self, primitives: PrimitiveMap) -> None:
        """The cells, their roses coloured by mean speed, and the legend; the view is fitted to them."""
        petals = shapes.rose_petals(primitives)
        fastest = shapes.fastest_speed(petals)
        self._box = shapes.map_extent(primitives, share=shapes.BUSY_SHARE)
        self.stream.log("/map/cells", marks.cells(primitives.tessellation))
        self.stream.log("/map/roses", marks.roses(petals, fastest=fastest))
        self._fastest = fastest
        if (origin := drawable(primitives.origin)) is not None:
            self._origin = origin
            self.stream.log("/map/earth", marks.petals_on_earth(petals, origin, fastest=fastest))

    def log_truth(self, tracks: Tracks) -> None:
        """Outlines and trails of the vehicles from the truth, to which the estimates are compared, one by one."""
        if len(tracks):
            self._matcher = Matcher(tracks)
            self._wait(tracks, self._send_truth)

    def log_detections(self, detections: Detections, sensor: str = "") -> None:
        """Detections of a log, of one of its topics; those of frames are then not drawn again."""
        path = rr.new_entity_path(["detections", *filter(None, sensor.split("/"))])
        self.stream.log(path, marks.detection_style(len(self._sensors)))
        self._sensors.append(path)

        def draw(rows: Detections, instant: IntArray, times_ns: list[int]) -> None:
            dots = marks.detections(rows.position, np.bincount(instant, minlength=len(times_ns)))
            self.stream.send_columns(path, times_ns, dots)

        self._wait(detections, draw)

    def _wait(self, rows: Tracks | Detections, draw: Callable[[Any, IntArray, list[int]], None]) -> None:
        rows = rows[np.argsort(rows.time_ns, kind="stable")]
        self._waiting.append(_Waiting(rows, draw))
        self._origin = self._origin or rows.origin
        if self._box is None and len(rows):
            self._box = shapes.extent(rows.position)

    def log_run(self, made_with: Mapping[str, str]) -> None:
        """What the run was made with, as properties of the recording."""
        if named := {name: [text] for name, text in made_with.items() if name}:
            properties = rr.DynamicArchetype("run", components=named)
            self.stream.to_each(lambda place: place.send_property("run", properties))

    def write(self, frame: TrackedFrame) -> None:
        """Show one frame; vehicles that it does not name vanish."""
        if self._box is None:
            self._box = shapes.extent(np.concatenate([frame.estimates.position, frame.detections.position]))
        if not self._laid_out:
            self._origin = self._origin or frame.estimates.origin or frame.detections.origin
            self._lay_out(tracked=True)
            for waiting in self._waiting:
                waiting.first = int(np.searchsorted(waiting.rows.time_ns, frame.time_ns))
        self.stream.frames_ns.append(frame.time_ns)
        if self._forecast_ns is not None and frame.time_ns > self._forecast_ns + 1_200_000_000:  # no other came since
            self._send(marks.forecasts([], np.empty((0, 0, 0, 2)), []), [frame.time_ns])
            self._forecast_ns = None
        stride = max(len(frame.particles) // max(len(frame.estimates), 1) // max(self._n_particles, 1), 1)
        some = frame.particles.thinned(stride) if self._n_particles else Particles.none()  # a copy
        self._shown.append(replace(frame, particles=some))
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

    def _send(self, drawn: Iterable[marks.Columns], times_ns: list[int]) -> None:
        for entity, columns in drawn:
            self.stream.send_columns(entity, times_ns, columns)

    def _send_each(
        self, root: str, names: Sequence[str], instant: IntArray, times_ns: list[int], parts: Iterable[marks.Part]
    ) -> None:  # fmt: skip
        """Rows of vehicles, each to its own entity; styles come before the first."""
        whole, times = [*parts], np.array(times_ns, np.int64)
        for lane in self._lanes[root].divided(names, instant, len(times_ns)):
            if root in curves.PLOTS and lane.path.endswith(OTHER_PATH):
                continue
            if lane.is_new:
                for style in marks.OF_VEHICLES.get(root) or [curves.style(names[lane.rows[0]])]:
                    self.stream.log(lane.path, style)
            columns = chain(*(part.columns(lane.rows, lane.counts) for part in whole))
            self.stream.send_columns(lane.path, times[lane.instants].tolist(), rr.ComponentColumnList(columns))

    def _is_due(self, batch: Sized) -> bool:
        """A file gets 64 frames at a time, a viewer those of 0.1 s: one by one, a run would wait for its viewer."""
        return len(batch) >= 64 or (self.stream.live and time.monotonic() >= self._sent_s + 0.1)

    def _send_shown(self) -> None:
        frames, self._shown = self._shown, []
        if not frames:
            return
        self._sent_s = time.monotonic()
        times = [frame.time_ns for frame in frames]
        self._send_waiting(times[-1])
        depth = 100.0 if self._box is None else float(np.ptp(self._box[:, 1]))
        self._send_estimates("/tracks", frames, partial(marks.vehicles, depth=depth))
        clouds = [frame.particles.thinned(1) for frame in frames]
        self._send([marks.assigned(frames), marks.particles(clouds)], times)
        if not self._sensors:
            seen = [frame.detections.position for frame in frames]
            self._send([("/detections", marks.detections(np.concatenate(seen), [*map(len, seen)]))], times)
        self._send_plots(frames, self._matcher.match(frames) if self._matcher else None, times)

    def _send_plots(self, frames: list[TrackedFrame], matched: list[Matched] | None, times: list[int]) -> None:
        """The curves, and what has happened, which the map shows for three seconds."""
        pairs = [(frame, matched[i] if matched else None) for i, frame in enumerate(frames)]
        rows = [curves.of_all(*pair) for pair in pairs]
        for path in rows[0]:
            values = np.array([row[path] for row in rows])
            columns = rr.Scalars.columns(scalars=values.ravel()).partition([values.shape[1]] * len(rows))
            self._send([(f"{path}/{curves.ALL}", columns)], times)
        of_each: dict[str, list[tuple[Sequence[str], FloatArray]]] = {
            "/innovation": [(frame.names, curves.innovations(frame)) for frame in frames],
            "/existence": [(frame.names, frame.estimates.existence) for frame in frames],
            "/error": [(of.names, of.error) for of in matched or []],
            "/nees": [(of.names, of.nees) for of in matched or []],
        }
        for root, of_frames in of_each.items():
            names = [name for of_frame, _ in of_frames for name in of_frame]
            instant = np.repeat(np.arange(len(of_frames)), [len(of_frame) for of_frame, _ in of_frames])
            values = np.concatenate([np.empty(0), *(value for _, value in of_frames)])
            self._send_each(root, names, instant, times, [marks.Part(rr.Scalars, {"scalars": values})])
        drawn = []
        for frame, true in pairs:
            found = self._events.of(frame, true)
            lately = [(at_ns, event) for at_ns, event in self._happened if frame.time_ns - at_ns < 3_000_000_000]
            self._happened = lately + [(frame.time_ns, event) for event in found]
            drawn.append([(event.word, event.place) for _, event in self._happened if event.place is not None])
            if found:
                lines = rr.TextLog.columns(text=[of.text for of in found], level=[of.level for of in found])
                self._send([("/events", lines)], [frame.time_ns] * len(found))
        self._send([marks.event_marks(drawn)], times)

    def _send_estimates(
        self, root: str, frames: list[TrackedFrame], draw: Callable[[Estimates, AnyArray], Iterable[marks.Part]]
    ) -> None:
        """Those of frames, with the trails to them."""
        estimates = Estimates.concatenate([frame.estimates for frame in frames])
        trails = [
            trail
            for frame in frames
            for trail in self._trails[root].lead_on(frame.names, frame.estimates.position, frame.time_ns)
        ]
        instant = np.repeat(np.arange(len(frames)), [len(frame.estimates) for frame in frames])
        names, times = [name for frame in frames for name in frame.names], [frame.time_ns for frame in frames]
        self._send_each(root, names, instant, times, draw(estimates, marks.strips_of(trails)))

    def _send_smoothed(self) -> None:
        if self._smoothed:
            self._send_estimates("/smoothed", self._smoothed, marks.smoothed)
        self._smoothed = []

    def _send_waiting(self, until_ns: int, *, is_last: bool = False) -> None:
        """Truth and detections up to a time; at the last one more instant without any: else they would stay."""
        for waiting in self._waiting:
            end = int(np.searchsorted(waiting.rows.time_ns, until_ns, side="right"))
            rows, waiting.first = waiting.rows[slice(waiting.first, end)], max(end, waiting.first)
            times, instant = np.unique(rows.time_ns, return_inverse=True)
            last = [until_ns + 1] * is_last
            if times.size or last:
                waiting.draw(rows, instant, [*times.tolist(), *last])

    def _send_truth(self, rows: Tracks, instant: IntArray, times_ns: list[int]) -> None:
        names, trails = rows.track_id.astype(np.str_).tolist(), list[Any]()
        ends = np.searchsorted(instant, np.arange(len(times_ns) + 1)).tolist()
        for time_ns, first, end in zip(times_ns, ends, ends[1:], strict=False):
            trails += self._trails["/truth"].lead_on(names[first:end], rows.position[first:end], time_ns)
        self._send_each("/truth", names, instant, times_ns, marks.truth(rows, marks.strips_of(trails)))

    def _lay_out(self, *, tracked: bool) -> None:
        box = shapes.extent(np.empty((0, 2))) if self._box is None else self._box
        for path, style in chain(marks.STYLES.items(), curves.styles()):
            self.stream.log(path, style)
        if not self._sensors:
            self.stream.log("/detections", marks.detection_style(0))
        text = legend(self._fastest, most=MOST_OWN)
        self.stream.log("/legend", rr.TextDocument(text, media_type="text/markdown"))
        if tracked and self._fastest is not None:
            self.stream.log("/map/roses", marks.FAINT_ROSES)
        window = blueprint(
            box, live=self.stream.live, tracked=tracked, with_truth=self._matcher is not None,
            on_earth=drawable(self._origin) is not None,
        )  # fmt: skip
        self.stream.to_each(lambda place: place.send_blueprint(window))
        self._laid_out = True
