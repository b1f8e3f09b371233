"""What `dirprim view` and `dirprim track` show: maps, logs and runs in a viewer, with the true tracks beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from dirprim_filter.cli.reading import Reading
from dirprim_filter.detections import Detections
from dirprim_filter.drawing.vehicles import drawn_sizes
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording import topic_names
from dirprim_filter.recording.container.log import Log, Scan
from dirprim_filter.recording.losses import Losses
from dirprim_filter.recording.map_file import MAP
from dirprim_filter.recording.name_patterns import is_table
from dirprim_filter.recording.plausibility import DetectionsAloneError
from dirprim_filter.recording.playback import Playback
from dirprim_filter.recording.reader import has_estimates
from dirprim_filter.recording.scan import scan
from dirprim_filter.recording.schemas import ESTIMATES_SCHEMA
from dirprim_filter.track_ids import qualified_names
from dirprim_filter.viewer import sink

OF_ESTIMATES = ("start", "end", "strict")
"""Options of reading that act on estimates."""


def open_viewer(
    place: str, lost: Losses, *, maps: Sequence[PrimitiveMap] = (), run: Mapping[str, str] | None = None,
    truth: Path | None, reading: Reading, is_asked: bool = True, **options: Any,
) -> sink.RerunSink:  # fmt: skip
    """A `RerunSink`, with maps, what made the `run`, and the true tracks of a log; `lost` gets what of these is.

    What is shown of one `place` shares the layout of a viewer that stays open. A log may have no tracks unless they
    were asked for.
    """
    true = None
    with suppress(*[] if is_asked else [DetectionsAloneError]):
        true = None if truth is None else reading.tracks([truth])
    viewer = sink.RerunSink(f"dirprim {place}", **options)
    if true is not None:
        lost += true.losses
        true_tracks = drawn_sizes(true.tracks, true.labels)
        if reading.group is None:  # as the vehicles of several groups are called
            true_tracks = replace(true_tracks, track_id=qualified_names(true_tracks.track_id, true_tracks.group))
        viewer.log_truth(true_tracks)
    for shown in maps:
        viewer.log_map(shown)
    viewer.log_run(run or {})
    return viewer


def by_kind(files: Sequence[Path]) -> tuple[list[Path], list[Path], list[Path]]:
    """Maps, runs and logs; without a map of its own, runs have the one that the first was tracked with."""
    maps, runs, logs, with_map = (list[Path]() for _ in range(4))
    for file in files:
        schemas = set[str]()
        if not is_table(file):
            with scan(file) as log:
                schemas = {channel.schema.name for channel in log.channels()}
        is_run, is_map = ESTIMATES_SCHEMA in schemas, MAP in schemas
        (runs if is_run else maps if is_map else logs).append(file)
        with_map += [file] * (is_run and is_map)
    return maps or with_map[:1], runs, logs


def show_together(viewer: sink.RerunSink, logs: Sequence[Path], path: Path | None, reading: Reading) -> Losses:
    """Logs and at most one run in one view; what of them was lost."""
    lost = Losses()
    for log in logs:
        lost += _detections(log, viewer, reading)
    if path is None:
        return lost
    with Log(path) as run:
        viewer.log_run({key: value for _, entries in Scan(run).metadata for key, value in entries.items()})
        options = reading.only(*OF_ESTIMATES).options()
        for topic, show in ((topic_names.ESTIMATES, viewer.write), (topic_names.SMOOTHED, viewer.write_smoothed)):
            if not has_estimates(run, topic):
                continue
            playback, n_frames = Playback(run, options, smoothed=topic == topic_names.SMOOTHED), 0
            for n_frames, frame in enumerate(playback, start=1):  # noqa: B007
                show(frame)
                if topic == topic_names.ESTIMATES and (forecast := playback.forecast(frame)) is not None:
                    viewer.write_forecast(forecast)
            reading.require_frames(n_frames, path, playback.losses)
            lost += playback.losses
    return lost


def _detections(log: Path, viewer: sink.RerunSink, reading: Reading) -> Losses:
    """Show what each sensor of a log reported; what of it was lost."""
    stream = reading.detections(log)
    if len(stream.topics) < 2:
        viewer.log_detections(Detections.concatenate(stream))
        return stream.losses
    for topic in sorted(stream.topics):
        one = replace(reading, given=reading.given | {"topics": topic}).detections(log)
        viewer.log_detections(Detections.concatenate(one), topic.removeprefix("/detections"))
    return one.losses
