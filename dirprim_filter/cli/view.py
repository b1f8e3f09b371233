"""`dirprim view`: maps, logs, tracks and recordings in the rerun viewer; and how `dirprim track` opens one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dirprim_filter.cli import exit_codes
from dirprim_filter.cli.options import Connect, Force, Save, Spawn
from dirprim_filter.cli.reading import Reading, reads_logs
from dirprim_filter.cli.texts import counted, say

if TYPE_CHECKING:
    from collections.abc import Iterator

    from dirprim_filter.estimates import TrackedFrame
    from dirprim_filter.recording.losses import Losses
    from dirprim_filter.recording.playback import Playback
    from dirprim_filter.viewer.sink import RerunSink

MAP, RUN, LOG = "map", "run", "log"
"""What a file is to the viewer."""


@reads_logs()
def view(
    files: Annotated[
        list[Path],
        typer.Argument(help="An .rrd, a map, a log, the tracks of `dirprim track`; or several.", exists=True),
    ],
    save: Save = None,
    spawn: Spawn = False,
    connect: Connect = None,
    rate: Annotated[
        float | None, typer.Option(help="Play a log: 2 is twice as fast as recorded, inf does not wait.")
    ] = None,
    truth: Annotated[
        Path | None, typer.Option("--truth", help="Show the true tracks of this log, and the errors.", exists=True)
    ] = None,
    focus: Annotated[str | None, typer.Option(help="Id of the vehicle to follow. Default: the least expected.")] = None,
    force: Force = False,
    *,
    reading: Reading,
) -> int:
    """Show maps, logs, tracks and recordings in rerun.

    A map lies under its tracks. Recordings, .rrd, are opened together. Without --save or --connect a viewer
    is started on this machine. With --rate the tracks of one log are played: the estimates that `dirprim track` wrote,
    else the objects.

    Example: dirprim view map.mcap tracks.mcap --truth log.mcap
    """
    from dirprim_filter.recording.losses import Losses

    is_elsewhere = save is not None or connect is not None
    recordings = [file for file in files if file.suffix == ".rrd"]
    if recordings:
        from dirprim_filter.viewer.process import spawn_viewer

        if len(recordings) < len(files) or is_elsewhere:
            raise ValueError(f"{recordings[0]}: an .rrd opens beside other .rrd files alone, on a screen")
        spawn_viewer(recordings)
        return exit_codes.DONE
    kinds, losses = _sorted(files), Losses()
    playback, frames = (None, iter(())) if rate is None else _played(files, rate, reading)
    with open_viewer(
        " ".join(file.stem for file in files), losses, save=save, spawn=spawn or not is_elsewhere, connect=connect,
        force=force, focus=focus,
    ) as viewer:  # fmt: skip
        if playback is None:
            losses += _together(kinds, viewer, truth=truth, reading=reading)
        else:
            n_frames = 0
            for frame in frames:
                viewer.write(frame)
                n_frames += 1
            losses += playback.losses
            say(f"{files[0]}: {counted(n_frames, 'frame')} of {', '.join(sorted(playback.topics))}")
    return exit_code(viewer, exit_codes.of_losses(losses))


def open_viewer(
    place: str, lost: Losses, *, truth: Path | None = None, group: int | None = None, plane: Reading | None = None,
    **options: Any,
) -> RerunSink:  # fmt: skip
    """A stream as of `open_stream`, with the true tracks of a log or group; `lost` gets what of these is.

    The tracks are on the plane that `plane` reads logs onto.

    What is shown of one `place` shares the layout of a viewer that stays open.
    """
    from dirprim_filter.recording.reader import read_track_logs
    from dirprim_filter.track_ids import qualified_names
    from dirprim_filter.viewer.sink import open_stream

    of_plane = (plane or Reading()).only("origin").options()
    true = None if truth is None else read_track_logs(truth, of_plane, group=group)
    viewer = open_stream(f"dirprim {place}", **options)
    if true is not None:
        lost += true.losses
        true_tracks = true.tracks
        if group is None:  # as the vehicles of several groups are called
            true_tracks = replace(true_tracks, track_id=qualified_names(true_tracks.track_id, true_tracks.group))
        viewer.log_truth(true_tracks)
    return viewer


def exit_code(viewer: RerunSink | None, otherwise: int) -> int:
    """1 where a viewer or its file was left, of which the log has said why; once it is closed."""
    return exit_codes.FAILED if viewer is not None and viewer.stream.failures else otherwise


def _sorted(files: Sequence[Path]) -> dict[str, list[Path]]:
    """Files by what they are.

    Raises:
        ValueError: more than one run.
    """
    from dirprim_filter.recording.map_file import MAP as MAP_SCHEMA
    from dirprim_filter.recording.scan import scan
    from dirprim_filter.recording.schemas import ESTIMATES_SCHEMA

    kinds: dict[str, list[Path]] = {MAP: [], RUN: [], LOG: []}
    for file in files:
        with scan(file) as log:
            schemas = {channel.schema.name for channel in log.channels()}
        kinds[RUN if ESTIMATES_SCHEMA in schemas else MAP if MAP_SCHEMA.name in schemas else LOG].append(file)
    if len(runs := kinds[RUN]) > 1:
        shown = ", ".join(map(str, runs))
        raise ValueError(f"view: expected at most one run, got {shown}; `track --save` makes an .rrd of each instead")
    return kinds


def _played(files: Sequence[Path], rate: float, reading: Reading) -> tuple[Playback, Iterator[TrackedFrame]]:
    """One log, and its frames, each when its time has come."""
    from dirprim_filter.cli.progress import with_progress
    from dirprim_filter.recording.playback import Playback, paced

    if len(files) > 1:
        raise typer.BadParameter(f"expected one log to play, got {len(files)} files", param_hint="--rate")
    playback = Playback(files[0], reading.options())
    frames = paced(playback, rate)
    return playback, with_progress(frames, what=f"playing {files[0].name}", end_ns=playback.end_ns)


def _together(kinds: dict[str, list[Path]], viewer: RerunSink, *, truth: Path | None, reading: Reading) -> Losses:
    """Maps, logs and at most one run in one view; what of them was lost."""
    from dirprim_filter.detections import Detections
    from dirprim_filter.recording import load_map, topic_names
    from dirprim_filter.recording.container.log import Log, Scan
    from dirprim_filter.recording.losses import Losses
    from dirprim_filter.recording.playback import Playback
    from dirprim_filter.recording.reader import has_estimates, origin_of_estimates, read_track_logs, stream_detections

    lost, frames = Losses(), list[Detections]()
    for path in kinds[MAP]:
        shown_map = load_map(path)
        reading = reading.on_plane_of(path, shown_map.origin)
        viewer.log_map(shown_map)
    for path in kinds[RUN]:
        reading = reading.on_plane_of(path, origin_of_estimates(path))
    options = reading.only("origin", "group").options()
    for path in [truth] if truth else kinds[LOG][:1]:
        true = read_track_logs(path, options)
        viewer.log_truth(true.tracks)
        lost += true.losses
    for path in kinds[LOG]:
        stream = stream_detections(path, options)
        frames += stream
        lost += stream.losses
    detections = Detections.concatenate(frames)
    if not kinds[RUN]:
        viewer.log_detections(detections)
    for path in kinds[RUN]:
        with Log(path) as run:
            viewer.log_run({key: value for _, entries in Scan(run).metadata for key, value in entries.items()})
            shows = {topic_names.ESTIMATES: viewer.write, topic_names.SMOOTHED: viewer.write_smoothed}
            for topic, show in shows.items():
                if has_estimates(run, topic):
                    playback = Playback(run, seen=detections, smoothed=topic == topic_names.SMOOTHED)
                    for frame in playback:
                        show(frame)
                    lost += playback.losses
    return lost
