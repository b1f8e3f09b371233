"""`dirprim view`: maps, logs, tracks and recordings in the rerun viewer; and how `dirprim track` opens one."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dirprim_filter.cli import exit_codes
from dirprim_filter.cli.options import WRITTEN, Connect, Files, Force, MaybeTruth, Save, Spawn
from dirprim_filter.cli.reading import OF_TRUTH, Reading

if TYPE_CHECKING:
    from dirprim_filter.primitives.primitive_map import PrimitiveMap
    from dirprim_filter.recording.losses import Losses
    from dirprim_filter.viewer.sink import RerunSink

MAP, RUN, LOG = "map", "run", "log"
"""What a file is to the viewer."""
OF_ESTIMATES = ("start", "end", "strict")
"""Options of reading that act on estimates."""


def view(
    files: Files,
    save: Save = None,
    spawn: Spawn = False,
    connect: Connect = None,
    truth: MaybeTruth = None,
    screenshot: Annotated[
        Path | None, typer.Option(help="Draw the window, without a screen."), WRITTEN, (".png",)
    ] = None,
    at: Annotated[float, typer.Option(help="Of --screenshot: seconds after the first frame.")] = 0.0,
    force: Force = False,
    *,
    reading: Reading,
) -> int:
    """Show maps, logs, tracks and recordings in rerun.

    A map lies under its tracks, which know the one they were tracked with. Several tracks, or recordings (.rrd), are
    opened together, to compare them: the viewer keeps the time. With --truth there are errors of each vehicle, and
    exchanges of ids. Without --save, --connect or --screenshot a viewer is started on this machine. Options of reading
    are about logs, times about estimates too.

    Example: dirprim view map.mcap tracks.mcap --truth log.mcap
    """
    from dirprim_filter.recording.losses import Losses

    is_elsewhere = save is not None or connect is not None or screenshot is not None
    recordings = [file for file in files if file.suffix == ".rrd"]
    if at and screenshot is None:
        raise typer.BadParameter("it is of --screenshot; leave it out", param_hint="--at")
    if recordings:
        if len(recordings) < len(files) or any((save, connect, truth, reading.given)):
            raise ValueError(f"{recordings[0]}: an .rrd opens beside other .rrd files alone, on a screen, as it is")
        if screenshot is None:
            from dirprim_filter.viewer.process import spawn_viewer

            spawn_viewer(recordings)
        else:
            _draw(recordings[-1], at, screenshot, force=force)
        return exit_codes.DONE
    kinds, losses = _sorted(files), Losses()
    if not kinds[LOG]:
        reading.require_acting(*OF_ESTIMATES * bool(kinds[RUN]), *(*OF_TRUTH, "group") * bool(truth))
    if len(kinds[RUN]) > 1 and (save or screenshot):
        shown = ", ".join(map(str, kinds[RUN]))
        raise ValueError(f"view: expected at most one run in a file, got {shown}; without --save they open together")
    maps, reading = _on_one_plane(kinds, reading)
    with TemporaryDirectory() as work:
        saved, address = save or (Path(work) / "shown.rrd" if screenshot else None), connect
        for run in kinds[RUN] or [files[0]]:
            with open_viewer(
                " ".join(file.stem for file in files), losses, title=run.stem, save=saved,
                spawn=(spawn or not is_elsewhere) and address is connect, connect=address, force=force,
                truth=truth or next(iter(kinds[LOG]), None),
                reading=reading.of_truth(truth, "group") if truth else reading, is_asked=truth is not None,
            ) as viewer:  # fmt: skip
                losses += _together(maps, kinds[LOG], run if kinds[RUN] else None, viewer, reading)
            address = viewer.stream.address
        if screenshot is not None and saved is not None:
            _draw(saved, at, screenshot, force=force)
    return exit_code(viewer, exit_codes.of_losses(losses))


def _draw(recording: Path, at_s: float, picture: Path, *, force: bool) -> None:
    """The window with a recording."""
    from dirprim_filter.partial_file import PartialFile
    from dirprim_filter.viewer.process import screenshot

    with PartialFile(picture, force=force) as file:
        file.write(screenshot(recording, at_s))
    typer.echo(f"{picture}")


def open_viewer(
    place: str, lost: Losses, *, truth: Path | None = None, reading: Reading | None = None, is_asked: bool = True,
    **options: Any,
) -> RerunSink:  # fmt: skip
    """A `RerunSink`, with the true tracks of a log as it is to be read; `lost` gets what of these is.

    What is shown of one `place` shares the layout of a viewer that stays open. A log may have no tracks unless they
    were asked for.
    """
    from dirprim_filter.drawing.vehicles import drawn_sizes
    from dirprim_filter.recording.plausibility import DetectionsAloneError
    from dirprim_filter.track_ids import qualified_names
    from dirprim_filter.viewer.sink import RerunSink

    reading = reading or Reading()
    true = None
    with suppress(*[] if is_asked else [DetectionsAloneError]):
        true = None if truth is None else reading.tracks([truth])
    viewer = RerunSink(f"dirprim {place}", **options)
    if true is not None:
        lost += true.losses
        true_tracks = drawn_sizes(true.tracks, true.labels)
        if reading.group is None:  # as the vehicles of several groups are called
            true_tracks = replace(true_tracks, track_id=qualified_names(true_tracks.track_id, true_tracks.group))
        viewer.log_truth(true_tracks)
    return viewer


def exit_code(viewer: RerunSink | None, otherwise: int) -> int:
    """1 where a viewer or its file was left, of which the log has said why; once it is closed."""
    return exit_codes.FAILED if viewer is not None and viewer.stream.failures else otherwise


def _sorted(files: Sequence[Path]) -> dict[str, list[Path]]:
    """Files by what they are; without a map of its own, runs have the one that the first was tracked with."""
    from dirprim_filter.recording.map_file import MAP as MAP_SCHEMA
    from dirprim_filter.recording.name_patterns import is_table
    from dirprim_filter.recording.scan import scan
    from dirprim_filter.recording.schemas import ESTIMATES_SCHEMA

    kinds: dict[str, list[Path]] = {MAP: [], RUN: [], LOG: []}
    with_map = []
    for file in files:
        if is_table(file):
            kinds[LOG].append(file)
            continue
        with scan(file) as log:
            schemas = {channel.schema.name for channel in log.channels()}
        is_run, is_map = ESTIMATES_SCHEMA in schemas, MAP_SCHEMA in schemas
        kinds[RUN if is_run else MAP if is_map else LOG].append(file)
        with_map += [file] * (is_run and is_map)
    kinds[MAP] = kinds[MAP] or with_map[:1]
    return kinds


def _on_one_plane(kinds: dict[str, list[Path]], reading: Reading) -> tuple[list[PrimitiveMap], Reading]:
    """The maps, and the reading of logs on the plane of these and of the run."""
    from dirprim_filter.recording import load_map
    from dirprim_filter.recording.reader import origin_of_estimates

    maps = [load_map(path) for path in kinds[MAP]]
    for path, learned in zip(kinds[MAP], maps, strict=True):
        reading = reading.on_plane_of(path, learned.origin)
    for path in kinds[RUN]:
        reading = reading.on_plane_of(path, origin_of_estimates(path))
    return maps, reading


def _together(
    maps: list[PrimitiveMap], logs: list[Path], path: Path | None, viewer: RerunSink, reading: Reading
) -> Losses:  # fmt: skip
    """Maps, logs and at most one run in one view; what of them was lost."""
    from dirprim_filter.recording import topic_names
    from dirprim_filter.recording.container.log import Log, Scan
    from dirprim_filter.recording.losses import Losses
    from dirprim_filter.recording.playback import Playback
    from dirprim_filter.recording.reader import has_estimates

    lost = Losses()
    for shown_map in maps:
        viewer.log_map(shown_map)
    for log in logs:
        lost += _detections(log, viewer, reading)
    if path is None:
        return lost
    with Log(path) as run:
        viewer.log_run({key: value for _, entries in Scan(run).metadata for key, value in entries.items()})
        shows = {topic_names.ESTIMATES: viewer.write, topic_names.SMOOTHED: viewer.write_smoothed}
        for topic, show in shows.items():
            if has_estimates(run, topic):
                options = reading.only(*OF_ESTIMATES).options()
                playback = Playback(run, options, smoothed=topic == topic_names.SMOOTHED)
                n_frames = 0
                for frame in playback:
                    show(frame)
                    if topic == topic_names.ESTIMATES and (forecast := playback.forecast(frame)) is not None:
                        viewer.write_forecast(forecast)
                    n_frames += 1
                reading.require_frames(n_frames, path, playback.losses)
                lost += playback.losses
    return lost


def _detections(log: Path, viewer: RerunSink, reading: Reading) -> Losses:
    """Show what each sensor of a log reported; what of it was lost."""
    from dirprim_filter.detections import Detections

    stream = reading.detections(log)
    if len(stream.topics) < 2:
        viewer.log_detections(Detections.concatenate(stream))
        return stream.losses
    for topic in sorted(stream.topics):
        one = replace(reading, given=reading.given | {"topics": topic}).detections(log)
        viewer.log_detections(Detections.concatenate(one), topic.removeprefix("/detections"))
    return one.losses
