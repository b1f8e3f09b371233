"""`dirprim view`: maps, logs, tracks and recordings in the rerun viewer, alone, together, or two runs side by side."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum, auto
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from dirprim_filter.cli import losses
from dirprim_filter.cli.options import WRITTEN, Connect, Force, Save, Serve, Spawn
from dirprim_filter.cli.reading import Reading, reads_logs

if TYPE_CHECKING:
    from dirprim_filter.recording.losses import Losses
    from dirprim_filter.viewer.sink import RerunSink

N_RUNS = 2


class Kind(Enum):
    """What a file is to the viewer."""

    RECORDING = auto()
    MAP = auto()
    TRACKS = auto()
    LOG = auto()


class _Given(NamedTuple):
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

    A map lies under its tracks, and two runs stand side by side on one time line. Without --save, --connect, --serve
    or --layout a viewer is started on this machine. With --rate the tracks of one log are played: the estimates that
    `dirprim track` wrote, else the objects.

    Example: dirprim view map.mcap prior.mcap no_prior.mcap
    """
    from dirprim_filter.cli.watching import exit_code, keep_serving, open_viewer

    elsewhere = save is not None or connect is not None or serve or layout is not None
    given = _sorted(files, elsewhere=elsewhere)
    if layout is not None:
        from dirprim_filter.recording import load_map
        from dirprim_filter.recording.foxglove.layout import write_layout

        if len(given.maps) != 1:
            raise typer.BadParameter(f"expected one map among the files, got {len(given.maps)}", param_hint="--layout")
        write_layout(load_map(given.maps[0]), layout, force=force)
        typer.echo(f"{layout}: import it by Layouts, Import from file")
        if save is None and connect is None and not (serve or spawn):
            return losses.DONE
    if _all_recordings(files) and not elsewhere and len(files) != N_RUNS:
        from dirprim_filter.viewer.process import show_files

        show_files(files)
        return losses.DONE
    played = None if rate is None else _Played(files, rate, reading)
    with open_viewer(
        " ".join(file.stem for file in files), save=save, spawn=spawn or not elsewhere, connect=connect,
        serve=bind if serve else None, force=force, focus=focus,
    ) as viewer:  # fmt: skip
        if played is not None:
            played.show(viewer)
        elif len(given.runs) == N_RUNS:
            _beside(given, viewer, truth=truth, focus=focus, group=reading.group)
        elif _all_recordings(files):
            from dirprim_filter.viewer.side_by_side import show_again

            show_again(files[0], viewer)
        else:
            _together(given, viewer, truth=truth, group=reading.group)
        keep_serving(viewer)
    return exit_code(viewer, losses.DONE if played is None else losses.exit_code(played.losses))


class _Played:
    """The frames of one log, each when its time has come; `losses`: of what is played so far."""

    def __init__(self, files: Sequence[Path], rate: float, reading: Reading) -> None:
        from dirprim_filter.recording.playback import paced

        if len(files) > 1:
            raise typer.BadParameter(f"expected one log to play, got {len(files)} files", param_hint="--rate")
        self._log = files[0]
        self._playback = reading.playback(self._log)
        self._frames = paced(self._playback, rate)

    @property
    def losses(self) -> Losses:
        return self._playback.losses

    def show(self, viewer: RerunSink) -> None:
        """Play it, and say so."""
        from dirprim_filter.cli.counts import counted
        from dirprim_filter.cli.progress import with_progress
        from dirprim_filter.recording.container.errors import one_line

        n_frames, end_ns = 0, self._playback.end_ns
        for frame in with_progress(self._frames, what=f"playing {self._log.name}", end_ns=end_ns):
            viewer.write(frame)
            n_frames += 1
        typer.echo(one_line(f"{self._log}: {counted(n_frames, 'frame')} of {', '.join(sorted(self._playback.topics))}"))


def _all_recordings(files: Sequence[Path]) -> bool:
    return all(file.suffix == ".rrd" for file in files)


def _sorted(files: Sequence[Path], *, elsewhere: bool) -> _Given:
    """What each file is; `elsewhere`: a viewer that is started for them would open any number of recordings.

    Raises:
        ValueError: more than two runs, or an .rrd together with what is not a run.
    """
    kinds = {file: _kind(file) for file in files}
    runs = [file for file, kind in kinds.items() if kind in (Kind.RECORDING, Kind.TRACKS)]
    if len(runs) > N_RUNS and not (_all_recordings(files) and not elsewhere):
        raise ValueError(f"view: expected at most {N_RUNS} runs, got {len(runs)}: {', '.join(map(str, runs))}")
    recordings = [file for file, kind in kinds.items() if kind is Kind.RECORDING]
    if len(runs) < N_RUNS and recordings and len(files) > 1:
        raise ValueError(f"{recordings[0]}: an .rrd holds its own map and log; open it alone, or beside another run")
    return _Given(
        [file for file, kind in kinds.items() if kind is Kind.MAP],
        [file for file, kind in kinds.items() if kind is Kind.LOG],
        runs,
    )


def _kind(file: Path) -> Kind:
    if file.suffix == ".rrd":
        return Kind.RECORDING
    from dirprim_filter.recording.map_file import MAP
    from dirprim_filter.recording.scan import scan
    from dirprim_filter.recording.schemas import ESTIMATES_SCHEMA

    with scan(file) as log:
        schemas = {channel.schema.name for channel in log.channels()}
    return Kind.TRACKS if ESTIMATES_SCHEMA in schemas else Kind.MAP if MAP.name in schemas else Kind.LOG


def _beside(given: _Given, viewer: RerunSink, *, truth: Path | None, focus: str | None, group: int | None) -> None:
    """Both runs as recordings, each with the maps and logs, then the two into one."""
    import tempfile

    from dirprim_filter.viewer.side_by_side import show_side_by_side
    from dirprim_filter.viewer.sink import open_stream

    with tempfile.TemporaryDirectory() as folder:
        recordings = []
        for i, run in enumerate(given.runs):
            if run.suffix == ".rrd":
                recordings.append(run)
                continue
            recordings.append(Path(folder) / f"{i}.rrd")
            with open_stream(save=recordings[-1], focus=focus) as shown:
                _together(given._replace(runs=[run]), shown, truth=truth, group=group)
        show_side_by_side(recordings, _titles(given.runs), viewer)


def _titles(runs: Sequence[Path]) -> list[str]:
    """The files' names, with enough of their paths to be distinct."""
    a, b = (run.resolve().with_suffix("").parts for run in runs)
    if a == b:
        return [runs[0].name, runs[1].name]
    n = next(n for n in range(1, max(len(a), len(b)) + 1) if a[-n:] != b[-n:])
    return ["/".join(a[-n:]), "/".join(b[-n:])]


def _together(given: _Given, viewer: RerunSink, *, truth: Path | None, group: int | None) -> None:
    """Maps, logs and at most one run in one view."""
    from dirprim_filter.detections import Detections
    from dirprim_filter.recording import load_map, read_tracks, topic_names
    from dirprim_filter.recording.playback import Playback
    from dirprim_filter.recording.reader import stream_detections
    from dirprim_filter.recording.scan import scan

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
    with scan(given.runs[0]) as log:
        said = {key: value for _, entries in log.metadata for key, value in entries.items()}
        is_smoothed = any(channel.topic == topic_names.SMOOTHED for channel in log.channels())
    for frame in Playback(given.runs[0], seen=detections):
        viewer.write(frame)
    if is_smoothed:
        for frame in Playback(given.runs[0], seen=detections, smoothed=True):
            viewer.write_smoothed(frame)
    viewer.log_run(said, {})
