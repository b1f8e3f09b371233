"""`dirprim plot`: a map as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import dirprim_filter as dp
from dirprim_filter.cli import exit_codes
from dirprim_filter.cli.options import FILE, Force, MapFile, Picture, existing_log
from dirprim_filter.cli.reading import Reading


def plot(
    map_file: MapFile,
    output: Picture,
    log: Annotated[Path | None, typer.Option(help="Draw the tracks of this log as well.", parser=existing_log)] = None,
    estimates: Annotated[
        Path | None, typer.Option(help="Draw the estimates that `dirprim track` wrote.", **FILE)
    ] = None,
    extent: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(help="What to show: west south east north, metres. Default: 99 % of the traffic."),
    ] = None,
    force: Force = False,
    *,
    reading: Reading,
) -> int:
    """Draw a map: petals coloured by mean speed.

    Options of reading choose a part of the log.

    Example: dirprim plot map.mcap -o map.png --log recordings/roundabout_learn.mcap

    Example: dirprim plot map.mcap -o part.png --extent -40 -40 40 40
    """
    import numpy as np

    from dirprim_filter.recording.losses import Losses
    from dirprim_filter.recording.reader import origin_of_estimates
    from dirprim_filter.recording.transforms.geodesy import FARTHEST_M
    from dirprim_filter.viewer.figures import map_figure, save_figure

    box = None if extent is None else np.reshape(extent, (2, 2))
    if box is not None:
        short, long = np.sort(box[1] - box[0])
        if not (1.0 <= short <= long <= 100.0 * short and np.abs(box).max() <= FARTHEST_M):
            expected = "west south east north, metres, sides of 1 m or more and alike"
            raise typer.BadParameter(f"expected {expected}, got {extent}", param_hint="--extent")
    if log is None:
        reading.require_acting()
    learned, lost = dp.load_map(map_file), Losses()
    plane = reading.on_plane_of(map_file, learned.origin)
    read = None if log is None else plane.tracks([log])
    if estimates is not None:
        plane.on_plane_of(estimates, origin_of_estimates(estimates))
    tracked = None if estimates is None else dp.read_estimates(estimates, losses=lost)
    drawn = map_figure(learned, tracks=read.tracks if read else None, estimates=tracked, extent=box)
    save_figure(drawn, output, force=force)
    typer.echo(f"{output}")
    return exit_codes.of_losses(lost, *(read.losses for read in [read] if read))
