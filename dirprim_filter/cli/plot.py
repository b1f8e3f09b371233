"""`dirprim plot`: a map as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dirprim_filter.cli.options import Force, Output


def plot(
    map_file: Annotated[Path, typer.Argument(help="A map that `dirprim learn` wrote.", exists=True, dir_okay=False)],
    output: Output,
    log: Annotated[Path | None, typer.Option(help="Draw this log's tracks underneath.", exists=True)] = None,
    estimates: Annotated[Path | None, typer.Option(help="Draw what `dirprim track` wrote.", exists=True)] = None,
    force: Force = False,
) -> None:
    """Draw a map: its cells, and roses of direction coloured by speed; .png, .pdf or .svg.

    Example: dirprim plot map.mcap -o map.png --log recordings/roundabout_learn.mcap
    """
    from dirprim_filter.recording import load_map, read_estimates, read_tracks
    from dirprim_filter.viewer.figures import map_figure, save_figure

    figure = map_figure(
        load_map(map_file),
        tracks=None if log is None else read_tracks(log),
        estimates=None if estimates is None else read_estimates(estimates),
    )
    save_figure(figure, output, force=force)
    typer.echo(f"{output}")
