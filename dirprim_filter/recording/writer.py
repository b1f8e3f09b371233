"""Logs of observations and estimates: MCAP that Foxglove draws and that reads back exactly."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from foxglove.messages import SceneUpdate

from dirprim_filter.arrays import FloatArray, require
from dirprim_filter.detections import Detections
from dirprim_filter.drawing.vehicles import has_no_forecast
from dirprim_filter.estimates import Particles, TrackedFrame
from dirprim_filter.forecasting import Forecasts
from dirprim_filter.origin import drawable
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording import topic_names
from dirprim_filter.recording.foxglove import globe
from dirprim_filter.recording.foxglove.elements import origin_of, scene_transform, view_of
from dirprim_filter.recording.foxglove.scenes import (
    SMOOTHED_COLOR,
    EstimatesScene,
    detection_cloud,
    forecast_scene,
    particle_cloud,
)
from dirprim_filter.recording.log_writer import LogWriter, schema_of
from dirprim_filter.recording.map_file import write_map
from dirprim_filter.recording.ros_estimates import RosEstimates
from dirprim_filter.recording.schemas.dirprim import encode_assignments, encode_estimates, encode_observations
from dirprim_filter.recording.topic_names import RosMessages
from dirprim_filter.track_ids import as_texts, rows_of_each
from dirprim_filter.tracks import Tracks

MAX_CHUNK_NS = 1_000_000_000
"""A chunk of estimates and the instant after it span at most this much log time: what a killed tracker loses."""


def write_tracks(
    tracks: Tracks, path: str | Path, *, detections: Detections | Mapping[str, Detections] | None = None,
    labels: Mapping[int | str, str] | None = None, metadata: Mapping[str, str] | None = None, force: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> None:  # fmt: skip
    """Write observed motion as an MCAP log, a message for each instant; what interrupts it leaves no file.

    `/objects` holds `dirprim.Observations`, which read back equal to `tracks`. Without tracks there is no such topic.

    Args:
        tracks: what to write.
        path: the MCAP file.
        detections: what a sensor reported, for `/detections`; or, by name, what several did, for `/detections/NAME`.
        labels: what each vehicle is, such as "car", by its id; of the others it is unknown.
        metadata: goes into the `dirprim` metadata record: configuration, seed, where the data came from.
        force: overwrite an existing file.
        progress: called with how many of how many instants are written.

    Raises:
        OutputExistsError: the file exists, and `force` is not set.
        OSError: the file cannot be written.
        ValueError: a time is negative, which MCAP cannot hold.
        TypeError: no tracks.
    """
    require("tracks", tracks, Tracks)
    by_sensor = {"": detections} if isinstance(detections, Detections) else detections or {}
    sources: dict[str, Tracks | Detections] = {topic_names.OBJECTS: tracks} if len(tracks) or not by_sensor else {}
    sources |= {f"{topic_names.DETECTIONS}/{name}".rstrip("/"): seen for name, seen in by_sensor.items()}
    instants = [(topic, rows) for topic, source in sources.items() for rows in rows_of_each(source.time_ns)]
    instants.sort(key=lambda instant: int(sources[instant[0]].time_ns[instant[1][0]]))
    with LogWriter(path, metadata=metadata or {}, force=force) as log:
        for done, (topic, rows) in enumerate(instants, 1):
            time_ns = int(sources[topic].time_ns[rows[0]])
            log.write(topic, encode_observations(sources[topic], rows, time_ns, labels=labels), time_ns)
            if progress is not None:
                progress(done, len(instants))


class EstimateWriter:
    """An `EstimateSink` that writes what a tracker believes as an MCAP log; a context manager.

    `/dirprim/tracks` holds `dirprim.TrackEstimates`, a message for each frame, and `/dirprim/smoothed` those that a
    smoother gives later; `/dirprim/tracks/measured` and `/coasting` those of each state, to be plotted;
    `/dirprim/assigned` holds `dirprim.Assignments`, a message for each frame of the filter;
    `/dirprim/tracks/scene`, `/dirprim/smoothed/scene`, `/dirprim/particles`, `/dirprim/detections`,
    `/dirprim/map/scene` and `/dirprim/forecast` are for the eye; where the plane has an origin, so are
    `/dirprim/origin` and the topics that end in `geojson`, on a map of the Earth.

    Messages are encoded, compressed and written in order by a thread of its own, while the tracker goes on: what fails
    there is raised by the next call, or when the log is closed. Ctrl-C closes the log so that it reads; another
    exception leaves it under its temporary name.

    Args:
        path: the MCAP file.
        metadata: goes into the `dirprim` metadata record: configuration, seed, the inputs' checksums.
        particle_stride: every how many-th particle is written; None: none, and there is no such topic.
        also_as: beside the rest write estimates as ROS 2 messages, "vision_msgs" or "autoware", on topics that end so.
        force: overwrite an existing file.

    Raises:
        OutputExistsError: the file exists, and `force` is not set.
        ValueError: the stride is not positive.
    """

    def __init__(
        self, path: str | Path, *, metadata: Mapping[str, str], particle_stride: int | None = None,
        also_as: RosMessages | None = None, force: bool = False,
    ) -> None:  # fmt: skip
        if particle_stride is not None and particle_stride < 1:
            raise ValueError(f"particle_stride: expected at least 1, got {particle_stride}")
        self._log = LogWriter(
            path, metadata=metadata, max_chunk_ns=MAX_CHUNK_NS, force=force,
            keep_when_interrupted=True,
        )  # fmt: skip
        self._particle_stride, self._also_as = particle_stride, also_as
        self._ros = None if also_as is None else RosEstimates(also_as)
        self._scene, self._smoothed_scene = EstimatesScene(), EstimatesScene(SMOOTHED_COLOR)
        self._map: PrimitiveMap | None = None
        self._origin: FloatArray | None = None
        self._not_forecast: frozenset[str] = frozenset()
        self._thread = ThreadPoolExecutor(1, "dirprim-log")
        self._underway: Future[None] | None = None

    def __enter__(self) -> Self:
        self._log.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            with self._thread:
                self._wait()
        except BaseException as failure:
            self._log.__exit__(type(failure), failure, failure.__traceback__)
            raise
        self._log.__exit__(kind, error, trace)

    def write(self, frame: TrackedFrame) -> None:
        """Append the estimates of one instant.

        Raises:
            ValueError: an estimate is of another time than the frame, or the time is negative.
            OSError: an earlier frame could not be written.
        """
        particles = None if self._particle_stride is None else frame.particles.thinned(self._particle_stride)
        self._later(lambda: self._append(frame, particles))

    def write_smoothed(self, frame: TrackedFrame) -> None:
        """Append what a smoother says of one instant: frames in order of time, each later than the filter's.

        Raises:
            ValueError: as `write`.
            OSError: as `write`.
        """
        self._later(lambda: self._append_estimates(topic_names.SMOOTHED, self._smoothed_scene, frame))

    def write_map_scene(self, primitive_map: PrimitiveMap | None) -> None:
        """Write the map, if there is one, and draw it: at the next message's time, as a map has none of its own.

        So `load_map` reads from the log of a run what it was tracked with.
        """
        self._wait()
        self._map = primitive_map

    def write_forecast(self, forecasts: Forecasts) -> None:
        """Draw rollouts, and the regions that hold them.

        Raises:
            ValueError: a negative time.
            OSError: an earlier frame could not be written.
        """
        self._later(lambda: self._append_forecast(forecasts))

    def _later(self, work: Callable[[], None]) -> None:
        """Begin a piece of work, once the one before it is done; what failed of that is raised, once."""
        self._wait()
        self._underway = self._thread.submit(work)

    def _wait(self) -> None:
        underway, self._underway = self._underway, None
        if underway is not None:
            underway.result()

    def _append(self, frame: TrackedFrame, particles: Particles | None) -> None:
        estimates, detections, time_ns = frame.estimates, frame.detections, frame.time_ns
        origin = self._begin(np.concatenate([estimates.position, detections.position]), time_ns)
        self._append_estimates(topic_names.ESTIMATES, self._scene, frame)
        for topic, is_coasting in ((topic_names.MEASURED, False), (topic_names.COASTING, True)):
            of_state = estimates[estimates.is_coasting == is_coasting]
            self._log.write(topic, encode_estimates(of_state, time_ns), time_ns)
        if drawable(estimates.origin) is not None:
            self._log.write(topic_names.ESTIMATES_GLOBE, globe.estimates_on_globe(estimates), time_ns)
        if particles is not None:
            self._log.write(topic_names.PARTICLES, particle_cloud(particles, time_ns, origin), time_ns)
        self._log.write(topic_names.ASSIGNED, encode_assignments(frame.assignments, time_ns), time_ns)
        self._log.write(topic_names.REPORTS, detection_cloud(detections.position, time_ns, origin), time_ns)
        self._not_forecast = frozenset(as_texts(estimates.track_id)[has_no_forecast(estimates)].tolist())

    def _append_estimates(self, topic: str, scene: EstimatesScene, frame: TrackedFrame) -> None:
        estimates, time_ns = frame.estimates, frame.time_ns
        origin = self._begin(estimates.position, time_ns)
        self._log.write(topic, encode_estimates(estimates, time_ns), time_ns)
        drawn = scene.update(estimates, frame.detections, time_ns, origin)
        self._log.write_encoded(f"{topic}/scene", schema_of(SceneUpdate), drawn, time_ns)
        if self._ros is not None:
            data = self._ros.encode(estimates, scene.sizes, time_ns)
            self._log.write_encoded(f"{topic}/{self._also_as}", self._ros.schema, data, time_ns)

    def _append_forecast(self, forecasts: Forecasts) -> None:
        origin = self._begin(forecasts.start, forecasts.time_ns)
        drawn = forecast_scene(forecasts, origin, hidden=self._not_forecast)
        self._log.write(topic_names.FORECAST, drawn, forecasts.time_ns)

    def _begin(self, position: FloatArray, time_ns: int) -> FloatArray:
        """Write what comes first; -> the origin of the scene's frame: of the map's view, else among these positions."""
        if self._origin is None:
            self._origin = origin_of(position if self._map is None else view_of(self._map))
            self._log.write(topic_names.TRANSFORM, scene_transform(time_ns, self._origin), time_ns)
        if self._map is not None:
            write_map(self._log, self._map, time_ns, self._origin)
            if (on_globe := drawable(self._map.origin)) is not None:
                self._log.write(topic_names.LOCATION, globe.location(on_globe, time_ns, self._origin), time_ns)
                self._log.write(topic_names.MAP_GLOBE, globe.map_on_globe(self._map, on_globe), time_ns)
            self._map = None
        return self._origin
