"""`dirprim view`: maps, logs, tracks and recordings in the rerun viewer."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from dirprim_filter.cli import losses
from dirprim_filter.cli.options import WRITTEN, Connect, Force, Save, Serve, Spawn
from dirprim_filter.cli.reading import Reading, reads_logs
from dirprim_filter.cli.texts import counted, say

if TYPE_CHECKING:
    from collections.abc import Iterable

    from dirprim_filter.estimates import TrackedFrame
    from dirprim_filter.recording.playback import Playback
    from dirprim_filter.viewer.sink import RerunSink


class _Given(NamedTuple):
    """Files by what they are to the viewer."""

    maps: list[Path]
    logs: list[Path]
    runs: list[Path]


@reads_logs()
def view(
    files: Annotated[
        list[Path],
        typer.Argument(help="An .rrd, a map, a log, the tracks of `dirprim track`; or several.", exists=True),
    ],
    save: Save = None,
    spawn: Spawn = False,
    connect: Connect = None,
    serve: Serve = False,
    bind: Annotated[
        str, typer.Option("--bind", help="With --serve: the address; 0.0.0.0: reachable from other machines.")
    ] = "127.0.0.1",
    rate: Annotated[
        float | None, typer.Option(help="Play a log: 2 is twice as fast as recorded, inf does not wait.")
    ] = None,
    truth: Annotated[
        Path | None, typer.Option("--truth", help="Show the true tracks of this log, and the errors.", exists=True)
    ] = None,
    focus: Annotated[str | None, typer.Option(help="Id of the vehicle to follow. Default: the least expected.")] = None,
    layout: Annotated[
        Path | None, typer.Option("--layout", help="Write a layout for Foxglove of a map, .json."), WRITTEN
    ] = None,
    force: Force = False,
    *,
    reading: Reading,
) -> int:
    """Show maps, logs, tracks and recordings in rerun.

    A map lies under its tracks. Recordings, .rrd, are opened together. Without --save, --connect, --serve or --layout
    a viewer is started on this machine. With --rate the tracks of one log are played: the estimates that
    `dirprim track` wrote, else the objects.

    Example: dirprim view map.mcap tracks.mcap --truth log.mcap
    """
    from dirprim_filter.cli.watching import exit_code, keep_serving, open_viewer

    is_shown = save is not None or connect is not None or serve
    is_started = spawn or not (is_shown or layout is not None)
    recordings = [file for file in files if file.suffix == ".rrd"]
    if recordings:
        if len(recordings) < len(files) or save is not None or connect is not None or layout is not None:
            raise ValueError(f"{recordings[0]}: an .rrd opens beside other .rrd files alone, on a screen or by --serve")
        _show(recordings, bind if serve else None)
        return losses.DONE
    given = _sorted(files)
    if layout is not None:
        _write_layout(given, layout, force=force)
    if not (is_shown or is_started):
        return losses.DONE
    playback, frames = (None, ()) if rate is None else _played(files, rate, reading)
    with open_viewer(
        " ".join(file.stem for file in files), save=save, spawn=is_started, connect=connect,
        serve=bind if serve else None, force=force, focus=focus,
    ) as viewer:  # fmt: skip
        if playback is not None:
            _play(files[0], playback, frames, viewer)
        else:
            _together(given, viewer, truth=truth, group=reading.group)
        keep_serving(viewer)
    return exit_code(viewer, losses.DONE if playback is None else losses.exit_code(playback.losses))


def _show(recordings: Sequence[Path], address: str | None) -> None:
    """In a viewer of their own, or for browsers until Ctrl-C."""
    from dirprim_filter.viewer.process import WebServer, spawn_viewer

    if address is None:
        spawn_viewer(recordings)
        return
    with WebServer(address, recordings) as server:
        typer.echo(f"serving at {server.page_url}", err=True)
        server.wait()


def _sorted(files: Sequence[Path]) -> _Given:
    """What each file is.

    Raises:
        ValueError: more than one run.
    """
    from dirprim_filter.recording.map_file import MAP
    from dirprim_filter.recording.scan import scan
    from dirprim_filter.recording.schemas import ESTIMATES_SCHEMA

    given = _Given([], [], [])
    for file in files:
        with scan(file) as log:
            schemas = {channel.schema.name for channel in log.channels()}
        is_run = ESTIMATES_SCHEMA in schemas
        (given.runs if is_run else given.maps if MAP.name in schemas else given.logs).append(file)
    if len(given.runs) > 1:
        shown = ", ".join(map(str, given.runs))
        raise ValueError(f"view: expected at most one run, got {shown}; `track --save` makes an .rrd of each instead")
    return given


def _write_layout(given: _Given, layout: Path, *, force: bool) -> None:
    from dirprim_filter.recording import load_map
    from dirprim_filter.recording.foxglove.layout import write_layout

    if len(given.maps) != 1:
        raise typer.BadParameter(f"expected one map among the files, got {len(given.maps)}", param_hint="--layout")
    write_layout(load_map(given.maps[0]), layout, force=force)
    typer.echo(f"{layout}: import it by Layouts, Import from file")


def _played(files: Sequence[Path], rate: float, reading: Reading) -> tuple[Playback, Iterable[TrackedFrame]]:
    """One log, and its frames, each when its time has come."""
    from dirprim_filter.recording.playback import Playback, paced

    if len(files) > 1:
        raise typer.BadParameter(f"expected one log to play, got {len(files)} files", param_hint="--rate")
    playback = Playback(files[0], reading.options())
    return playback, paced(playback, rate)


def _play(log: Path, playback: Playback, frames: Iterable[TrackedFrame], viewer: RerunSink) -> None:
    from dirprim_filter.cli.progress import with_progress

    n_frames = 0
    for frame in with_progress(frames, what=f"playing {log.name}", end_ns=playback.end_ns):
        viewer.write(frame)
        n_frames += 1
    say(f"{log}: {counted(n_frames, 'frame')} of {', '.join(sorted(playback.topics))}")


def _together(given: _Given, viewer: RerunSink, *, truth: Path | None, group: int | None) -> None:
    """Maps, logs and at most one run in one view."""
    from dirprim_filter.detections import Detections
    from dirprim_filter.recording import load_map, read_tracks, topic_names
    from dirprim_filter.recording.container.log import Log, Scan
    from dirprim_filter.recording.playback import Playback
    from dirprim_filter.recording.reader import stream_detections

    for path in given.maps:
        viewer.log_map(load_map(path))
    for path in [truth] if truth else given.logs[:1]:
        viewer.log_truth(read_tracks(path, group=group))
    detections = Detections.concatenate(
        [frame for path in given.logs for frame in stream_detections(path, group=group)]
    )
    if not given.runs:
        viewer.log_detections(detections)
        return
    with Log(given.runs[0]) as run:
        said = {key: value for _, entries in Scan(run).metadata for key, value in entries.items()}
        is_smoothed = any(channel.topic == topic_names.SMOOTHED for channel in run.channels())
        for frame in Playback(run, seen=detections):
            viewer.write(frame)
        if is_smoothed:
            for frame in Playback(run, seen=detections, smoothed=True):
                viewer.write_smoothed(frame)
    viewer.log_run(said, {})
