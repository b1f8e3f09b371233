"""`dirprim view`: maps, logs, tracks and recordings in the rerun viewer; and how `dirprim track` opens one."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dirprim_filter.cli import exit_codes
from dirprim_filter.cli.options import Connect, Files, Force, MaybeTruth, Save, Spawn
from dirprim_filter.cli.reading import OF_TRUTH, Reading, reads_logs
from dirprim_filter.cli.texts import counted, say

if TYPE_CHECKING:
    from collections.abc import Iterator

    from dirprim_filter.estimates import TrackedFrame
    from dirprim_filter.primitives.primitive_map import PrimitiveMap
    from dirprim_filter.recording.losses import Losses
    from dirprim_filter.recording.playback import Playback
    from dirprim_filter.viewer.sink import RerunSink

MAP, RUN, LOG = "map", "run", "log"
"""What a file is to the viewer."""
OF_ESTIMATES = ("start", "end", "strict")
"""Options of reading that act on estimates."""


@reads_logs()
def view(
    files: Files,
    save: Save = None,
    spawn: Spawn = False,
    connect: Connect = None,
    rate: Annotated[
        float | None, typer.Option(help="Play a log: 2 is twice as fast as recorded, inf does not wait.")
    ] = None,
    truth: MaybeTruth = None,
    focus: Annotated[str | None, typer.Option(help="Id of the vehicle to follow. Default: the least expected.")] = None,
    force: Force = False,
    *,
    reading: Reading,
) -> int:
    """Show maps, logs, tracks and recordings in rerun.

    A map lies under its tracks. Recordings, .rrd, are opened together. Without --save or --connect a viewer
    is started on this machine. With --rate the tracks of one log are played: the estimates that `dirprim track` wrote,
    else the objects. Options of reading are about logs, times about estimates too.

    Example: dirprim view map.mcap tracks.mcap --truth log.mcap
    """
    from dirprim_filter.recording.losses import Losses

    is_elsewhere = save is not None or connect is not None
    recordings = [file for file in files if file.suffix == ".rrd"]
    if recordings:
        from dirprim_filter.viewer.process import spawn_viewer

        if len(recordings) < len(files) or is_elsewhere or any((rate, truth, focus, reading.given)):
            raise ValueError(f"{recordings[0]}: an .rrd opens beside other .rrd files alone, on a screen, as it is")
        spawn_viewer(recordings)
        return exit_codes.DONE
    kinds, losses = _sorted(files), Losses()
    if not kinds[LOG] and (rate is None or "topics" not in reading.given):
        reading.require_acting(*OF_ESTIMATES * bool(kinds[RUN]), *(*OF_TRUTH, "group") * bool(truth))
    if focus is not None and not kinds[RUN] and rate is None:
        raise typer.BadParameter("there are no estimates in these files; leave it out", param_hint="--focus")
    maps, reading = _on_one_plane(kinds, reading)
    playback, frames = (None, iter(())) if rate is None else _played(files, rate, reading)
    shown = truth or (kinds[LOG][0] if kinds[LOG] and playback is None else None)
    with open_viewer(
        " ".join(file.stem for file in files), losses, save=save, spawn=spawn or not is_elsewhere, connect=connect,
        force=force, focus=focus, truth=shown, reading=reading.of_truth(truth, "group") if truth else reading,
        is_asked=truth is not None,
    ) as viewer:  # fmt: skip
        if playback is None:
            losses += _together(maps, kinds, viewer, reading)
        else:
            n_frames = 0
            for frame in frames:
                viewer.write(frame)
                n_frames += 1
            reading.require_frames(n_frames, files[0], playback.losses)
            losses += playback.losses
            say(f"{files[0]}: {counted(n_frames, 'frame')} of {', '.join(sorted(playback.topics))}")
    return exit_code(viewer, exit_codes.of_losses(losses))


def open_viewer(
    place: str, lost: Losses, *, truth: Path | None = None, reading: Reading | None = None, is_asked: bool = True,
    **options: Any,
) -> RerunSink:  # fmt: skip
    """A `RerunSink`, with the true tracks of a log as it is to be read; `lost` gets what of these is.

    What is shown of one `place` shares the layout of a viewer that stays open. A log may have no tracks unless they
    were asked for.
    """
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
        true_tracks = true.tracks
        if reading.group is None:  # as the vehicles of several groups are called
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
    from dirprim_filter.recording.name_patterns import is_table
    from dirprim_filter.recording.scan import scan
    from dirprim_filter.recording.schemas import ESTIMATES_SCHEMA

    kinds: dict[str, list[Path]] = {MAP: [], RUN: [], LOG: []}
    for file in files:
        if is_table(file):
            kinds[LOG].append(file)
            continue
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
    reading.require_acting_on([*files])
    playback = Playback(files[0], reading.options())
    frames = paced(playback, rate)
    return playback, with_progress(frames, what=f"playing {files[0].name}", end_ns=playback.end_ns)


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
    maps: list[PrimitiveMap], kinds: dict[str, list[Path]], viewer: RerunSink, reading: Reading
) -> Losses:  # fmt: skip
    """Maps, logs and at most one run in one view; what of them was lost."""
    from dirprim_filter.detections import Detections
    from dirprim_filter.recording import topic_names
    from dirprim_filter.recording.container.log import Log, Scan
    from dirprim_filter.recording.losses import Losses
    from dirprim_filter.recording.playback import Playback
    from dirprim_filter.recording.reader import has_estimates

    lost, frames = Losses(), list[Detections]()
    for shown_map in maps:
        viewer.log_map(shown_map)
    for path in kinds[LOG]:
        stream = reading.detections(path)
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
                    options = reading.only(*OF_ESTIMATES).options()
                    playback = Playback(run, options, seen=detections, smoothed=topic == topic_names.SMOOTHED)
                    n_frames = 0
                    for frame in playback:
                        show(frame)
                        n_frames += 1
                    reading.require_frames(n_frames, path, playback.losses)
                    lost += playback.losses
    return lost
