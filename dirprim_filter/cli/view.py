"""`dirprim view`: maps, logs, tracks and recordings in the rerun viewer."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

import dirprim_filter as dp
from dirprim_filter.cli import exit_codes
from dirprim_filter.cli.options import WRITTEN, Connect, Files, Force, MaybeTruth, Save, Spawn
from dirprim_filter.cli.reading import OF_TRUTH, Reading


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
    is_elsewhere = save is not None or connect is not None or screenshot is not None
    recordings = [file for file in files if file.suffix == ".rrd"]
    if at and screenshot is None:
        raise typer.BadParameter("it is of --screenshot; leave it out", param_hint="--at")
    if recordings:
        if len(recordings) < len(files) or any((save, connect, truth, reading.given)):
            raise ValueError(f"{recordings[0]}: an .rrd opens beside other .rrd files alone, on a screen, as it is")
        _show(recordings, at, screenshot, force=force)
        return exit_codes.DONE

    from dirprim_filter.cli import screen
    from dirprim_filter.recording.losses import Losses
    from dirprim_filter.recording.reader import origin_of_estimates

    maps, runs, logs = screen.by_kind(files)
    if not logs:
        reading.require_acting(*screen.OF_ESTIMATES * bool(runs), *(*OF_TRUTH, "group") * bool(truth))
    if len(runs) > 1 and (save or screenshot):
        shown = ", ".join(map(str, runs))
        raise ValueError(f"view: expected at most one run in a file, got {shown}; without --save they open together")
    learned, losses = [dp.load_map(path) for path in maps], Losses()
    for path, of in zip(maps, learned, strict=True):
        reading = reading.on_plane_of(path, of.origin)
    for path in runs:
        reading = reading.on_plane_of(path, origin_of_estimates(path))
    with TemporaryDirectory() as work:
        saved, address = save or (Path(work) / "shown.rrd" if screenshot else None), connect
        for run in runs or [files[0]]:
            with screen.open_viewer(
                " ".join(file.stem for file in files), losses, maps=learned, title=run.stem, save=saved,
                spawn=(spawn or not is_elsewhere) and address is connect, connect=address, force=force,
                truth=truth or next(iter(logs), None), is_asked=truth is not None,
                reading=reading.of_truth(truth, "group") if truth else reading,
            ) as viewer:  # fmt: skip
                losses += screen.show_together(viewer, logs, run if runs else None, reading)
            address = viewer.stream.address
        if screenshot is not None and saved is not None:
            _show([saved], at, screenshot, force=force)
    return exit_codes.of_losses(losses, failures=viewer.stream.failures)


def _show(recordings: Sequence[Path], at_s: float, picture: Path | None, *, force: bool) -> None:
    """Recordings on a screen, or the window with the last of them as a picture."""
    from dirprim_filter.partial_file import PartialFile
    from dirprim_filter.viewer import process

    if picture is None:
        process.spawn_viewer(recordings)
        return
    with PartialFile(picture, force=force) as file:
        file.write(process.screenshot(recordings[-1], at_s))
    typer.echo(f"{picture}")
