"""`dirprim plot`: a map, or what holds at one of its places, as a picture."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dirprim_filter.cli.options import Force, Output, Seed
from dirprim_filter.cli.place import EITHER_WAY, OPTION, tell_if_outside

if TYPE_CHECKING:
    from collections.abc import Mapping

    from dirprim_filter.arrays import FloatArray
    from dirprim_filter.primitives import PrimitiveMap
    from dirprim_filter.tracks import Tracks
    from dirprim_filter.viewer.figures import Figure


class Picture(StrEnum):
    """What is drawn."""

    MAP = "map"
    ROSES = "roses"
    CELLS = "cells"
    TRANSITIONS = "transitions"
    DIRECTION = "direction"
    SPEED = "speed"
    REJECTION = "rejection"
    PRODUCT = "product"


class Turn(StrEnum):
    """What a turn signal says."""

    LEFT = "left"
    RIGHT = "right"


TAKES = {
    Picture.MAP: {"--log", "--estimates", "--extent", "--width"},
    Picture.ROSES: {"--log", "--extent", "--width"},
    Picture.CELLS: {"--log", "--extent", "--width"},
    Picture.TRANSITIONS: {"--log", "--extent", "--width"},
    Picture.DIRECTION: {"--log", "--at"},
    Picture.SPEED: {"--log", "--at"},
    Picture.REJECTION: {"--at", "--cue", "--heading-deg"},
    Picture.PRODUCT: {"--at", "--cue", "--heading-deg"},
}
"""The options of each picture."""


def plot(
    map_file: Annotated[Path, typer.Argument(help="A map that `dirprim learn` wrote.", exists=True, dir_okay=False)],
    output: Output,
    figure: Annotated[
        Picture,
        typer.Option(
            help=(
                "map: cells, and petals coloured by mean speed. roses: rose diagrams, from blue to red by probability. "
                "cells: the cells over the rows of --log, coloured by direction. transitions: arrows from cell to "
                "cell, as wide as the share of vehicles that leave that way. direction, speed: densities at one place, "
                "by mode. rejection, product: a turn signal times the prior at one place (Eq. 4)."
            )
        ),
    ] = Picture.MAP,
    log: Annotated[Path | None, typer.Option("--log", help="Draw the tracks of this log as well.", exists=True)] = None,
    estimates: Annotated[
        Path | None,
        typer.Option("--estimates", help="map: draw the estimates that `dirprim track` wrote.", exists=True),
    ] = None,
    at: Annotated[
        tuple[float, float] | None,
        typer.Option(OPTION, help=f"The place, {EITHER_WAY}. Default: where directions differ most."),
    ] = None,
    cue: Annotated[Turn | None, typer.Option("--cue", help="The turn signal. Default: right.")] = None,
    heading_deg: Annotated[
        float | None,
        typer.Option(
            "--heading-deg",
            help="Heading of the vehicle that signals, degrees counter-clockwise from east. Default: one from which "
            "vehicles both go on and turn.",
        ),
    ] = None,
    extent: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option("--extent", help="Part of the map to show: west south east north, metres. Default: all."),
    ] = None,
    width: Annotated[
        float | None,
        typer.Option(
            "--width", min=3.0, max=100.0, help="Width of the figure, inches; its height follows from the map."
        ),
    ] = None,
    dpi: Annotated[
        float | None, typer.Option("--dpi", min=10.0, max=2400.0, help="Dots per inch of a bitmap. Default: 200.")
    ] = None,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Draw a map, or the primitive at one place, for a paper or a talk: .png, .pdf or .svg.

    Example: dirprim plot map.mcap -o map.png --log recordings/roundabout_learn.mcap

    Example: dirprim plot map.mcap -o place.pdf --figure direction --at 3 -18

    Example: dirprim plot map.mcap -o part.png --extent -40 -40 40 40 --width 3.5 --dpi 600
    """
    options = {
        "--log": log, "--estimates": estimates, "--at": at, "--cue": cue, "--heading-deg": heading_deg,
        "--extent": extent, "--width": width,
    }  # fmt: skip
    _check(figure, {name for name, value in options.items() if value is not None})
    view: dict[str, Any] = {"extent": None if extent is None else _corners(extent), "width": width}

    from dirprim_filter.recording import load_map, read_estimates, read_tracks
    from dirprim_filter.viewer.figures import check_figure_path, map_figure, save_figure

    check_figure_path(output, force=force)  # before the work, not after it
    learned = load_map(map_file)
    if at is not None:
        tell_if_outside(learned, at)
    tracks = None if log is None else read_tracks(log)
    if figure is Picture.MAP:
        tracked = None if estimates is None else read_estimates(estimates)
        drawn = map_figure(learned, tracks=tracks, estimates=tracked, **view)
    elif figure in (Picture.REJECTION, Picture.PRODUCT):
        drawn = _of_signal(figure, learned, at, cue or Turn.RIGHT, heading_deg, seed)
    else:
        drawn = _of_map(figure, learned, tracks, at, view)
    save_figure(drawn, output, dpi=dpi, force=force)
    typer.echo(f"{output}")


def _check(figure: Picture, given: set[str]) -> None:
    """Every option given is used.

    Raises:
        typer.BadParameter: an option does not apply to the picture, or one that it needs is missing.
    """
    for name in sorted(given - TAKES[figure]):
        useful = ", ".join(picture.value for picture, taken in TAKES.items() if name in taken)
        raise typer.BadParameter(f"has no meaning for --figure {figure.value}; it is for {useful}", param_hint=name)
    if figure is Picture.CELLS and "--log" not in given:
        raise typer.BadParameter(
            "expected with --figure cells: the log whose rows lie under the cells", param_hint="--log"
        )


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


def _of_map(
    figure: Picture,
    learned: PrimitiveMap,
    tracks: Tracks | None,
    at: tuple[float, float] | None,
    view: Mapping[str, Any],
) -> Figure:
    from dirprim_filter.viewer.figures import (
        cell_figure,
        direction_figure,
        rose_figure,
        speed_figure,
        transition_figure,
    )

    if figure is Picture.CELLS and tracks is not None:
        return cell_figure(learned.tessellation, tracks, **view)
    if figure is Picture.ROSES:
        return rose_figure(learned, tracks=tracks, **view)
    if figure is Picture.TRANSITIONS:
        return transition_figure(learned, tracks=tracks, **view)
    draw = direction_figure if figure is Picture.DIRECTION else speed_figure
    return draw(learned, position=at, tracks=tracks)


def _of_signal(
    figure: Picture,
    learned: PrimitiveMap,
    at: tuple[float, float] | None,
    cue: Turn,
    heading_deg: float | None,
    seed: int,
) -> Figure:
    import numpy as np

    from dirprim_filter.primitives.cues import TURN_LEFT, TURN_RIGHT
    from dirprim_filter.viewer.figures import product_figure, rejection_figure

    draw = rejection_figure if figure is Picture.REJECTION else product_figure
    return draw(
        learned,
        cue=TURN_LEFT if cue is Turn.LEFT else TURN_RIGHT,
        position=at,
        heading=None if heading_deg is None else float(np.deg2rad(heading_deg)),
        rng=np.random.default_rng(seed),
    )
