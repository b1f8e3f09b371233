"""`dirprim plot`: a map, or what holds at one of its places, as a picture."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dirprim_filter.cli.options import AT, FIGURE, WRITTEN, Force, named_file, say_if_outside

if TYPE_CHECKING:
    from dirprim_filter.arrays import FloatArray


class Picture(StrEnum):
    """What is drawn."""

    MAP = "map"
    PLACE = "place"


class Turn(StrEnum):
    """What a turn signal says."""

    LEFT = "left"
    RIGHT = "right"


TAKES = {
    Picture.MAP: {"--log", "--estimates", "--extent", "--width"},
    Picture.PLACE: {"--log", "--at", "--cue", "--heading-deg"},
}
"""The options of each picture."""


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
        typer.Option(help=("map: petals coloured by mean speed. place: directions and speeds of one place, by mode.")),
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
    options = {
        "--log": log, "--estimates": estimates, "--at": at, "--cue": cue, "--heading-deg": heading_deg,
        "--extent": extent, "--width": width,
    }  # fmt: skip
    for name, value in options.items():
        if value is not None and name not in TAKES[figure]:
            useful = ", ".join(picture.value for picture, taken in TAKES.items() if name in taken)
            raise typer.BadParameter(f"has no meaning for --figure {figure.value}; it is for {useful}", param_hint=name)
    box = None if extent is None else _corners(extent)

    import numpy as np

    from dirprim_filter.primitives.cues import TURN_LEFT, TURN_RIGHT
    from dirprim_filter.recording import load_map, read_estimates, read_tracks
    from dirprim_filter.viewer.figures import map_figure, place_figure, save_figure

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


def _corners(extent: tuple[float, float, float, float]) -> FloatArray:
    """(2, 2) metres, south-west and north-east.

    Raises:
        typer.BadParameter: the extent is empty or not finite.
    """
    import numpy as np

    west, south, east, north = extent
    if not (np.isfinite(extent).all() and west < east and south < north):
        raise typer.BadParameter(
            f"expected west south east north, metres, west < east and south < north, got {extent}",
            param_hint="--extent",
        )
    return np.array([[west, south], [east, north]])
