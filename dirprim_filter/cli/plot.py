"""`dirprim plot`: a map, or what holds at one of its places, as a picture."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from dirprim_filter.cli.options import AT, FIGURE, WRITTEN, Force, named_file, say_if_outside


class Picture(StrEnum):
    """What is drawn."""

    MAP = "map"
    PLACE = "place"


class Turn(StrEnum):
    """What a turn signal says."""

    LEFT = "left"
    RIGHT = "right"


def plot(
    map_file: Annotated[Path, typer.Argument(help="A map that `dirprim learn` wrote.", exists=True, dir_okay=False)],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="The picture: .png, .pdf or .svg.", callback=named_file),
        WRITTEN,
        FIGURE,
    ],
    figure: Annotated[
        Picture,
        typer.Option(help="map: petals coloured by mean speed. place: directions and speeds of one place, by mode."),
    ] = Picture.MAP,
    log: Annotated[Path | None, typer.Option("--log", help="Draw the tracks of this log as well.", exists=True)] = None,
    estimates: Annotated[
        Path | None, typer.Option("--estimates", help="Draw the estimates that `dirprim track` wrote.", exists=True)
    ] = None,
    at: Annotated[
        tuple[float, float] | None,
        typer.Option(AT, help="The place, metres east and north. Default: where directions differ most."),
    ] = None,
    cue: Annotated[Turn | None, typer.Option("--cue", help="place: what a turn signal adds there (Eq. 4).")] = None,
    heading_deg: Annotated[
        float | None,
        typer.Option("--heading-deg", help="place: heading of who signals, degrees counter-clockwise from east."),
    ] = None,
    extent: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option("--extent", help="What to show: west south east north, metres. Default: 99 % of the traffic."),
    ] = None,
    width: Annotated[float | None, typer.Option("--width", min=3.0, max=100.0, help="Inches, of the figure.")] = None,
    dpi: Annotated[
        float | None, typer.Option("--dpi", min=10.0, max=2400.0, help="Dots per inch of a bitmap. Default: 200.")
    ] = None,
    force: Force = False,
) -> None:
    """Draw a map, or a place of it, as .png, .pdf or .svg.

    Example: dirprim plot map.mcap -o map.png --log recordings/roundabout_learn.mcap

    Example: dirprim plot map.mcap -o place.pdf --figure place --at 3 -18 --cue right

    Example: dirprim plot map.mcap -o part.png --extent -40 -40 40 40 --width 3.5 --dpi 600
    """
    of_map = {"--estimates": estimates, "--extent": extent, "--width": width}
    of_place = {"--at": at, "--cue": cue, "--heading-deg": heading_deg}
    for name, value in (of_place if figure is Picture.MAP else of_map).items():
        if value is not None:
            raise typer.BadParameter(f"has no meaning for --figure {figure.value}", param_hint=name)

    import numpy as np

    from dirprim_filter.primitives.cues import TURN_LEFT, TURN_RIGHT
    from dirprim_filter.recording import load_map, read_estimates, read_tracks
    from dirprim_filter.viewer.figures import map_figure, place_figure, save_figure

    box = None if extent is None else np.reshape(extent, (2, 2))
    if box is not None and not (np.isfinite(box).all() and (box[0] < box[1]).all()):
        raise typer.BadParameter(f"expected west south east north, metres, got {extent}", param_hint="--extent")
    learned = load_map(map_file)
    if at is not None:
        say_if_outside(learned, at)
    tracks = None if log is None else read_tracks(log)
    if figure is Picture.PLACE:
        signals = {None: None, Turn.LEFT: TURN_LEFT, Turn.RIGHT: TURN_RIGHT}
        heading = None if heading_deg is None else float(np.deg2rad(heading_deg))
        drawn = place_figure(learned, position=at, tracks=tracks, cue=signals[cue], heading=heading)
    else:
        drawn = map_figure(
            learned, tracks=tracks, extent=box, width=width,
            estimates=None if estimates is None else read_estimates(estimates),
        )  # fmt: skip
    save_figure(drawn, output, dpi=dpi, force=force)
    typer.echo(f"{output}")
