"""`dirprim convert`: tables of other formats to an MCAP log."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dirprim_filter.cli import losses
from dirprim_filter.cli.options import Force, Output

if TYPE_CHECKING:
    from dirprim_filter.recording.tables import Table


class Format(StrEnum):
    """What the source is."""

    CSV = "csv"
    SDD = "sdd"
    SUMO_FCD = "sumo-fcd"


def convert(
    source: Annotated[Path, typer.Argument(help="The table.", exists=True, dir_okay=False)],
    output: Output,
    form: Annotated[Format, typer.Option("--format", help="What the source is.")] = Format.CSV,
    metres_per_pixel: Annotated[float | None, typer.Option(help="sdd: scale of the video.")] = None,
    frames_per_second: Annotated[float, typer.Option(help="sdd: rate of the video.")] = 30.0,
    force: Force = False,
) -> int:
    """Write a table of tracks as an MCAP log.

    csv has columns by name: time_s, track_id, x_m, y_m; optional heading_rad (of the body),
    course_rad (over ground), speed_mps, group, length_m, width_m, height_m.

    Example: dirprim convert tracks.csv -o tracks.mcap
    """
    from dirprim_filter.cli.progress import step_progress, working
    from dirprim_filter.cli.provenance import provenance
    from dirprim_filter.recording import write_tracks

    with working(f"reading {source.name}"):
        table = _read(source, form, metres_per_pixel, frames_per_second)
    said = provenance("convert", inputs=[source], format=form.value, metres_per_pixel=metres_per_pixel)
    with step_progress(f"writing {output.name}", "instants") as told:
        write_tracks(table.tracks, output, metadata=said, force=force, progress=told)
    for note, count in table.notes.items():
        typer.echo(f"{source}: {count} rows: {note}", err=True)
    typer.echo(f"{output}: {table.tracks.n_tracks} tracks, {len(table.tracks)} rows")
    return losses.tell_dropped(source, table.dropped)


def _read(source: Path, form: Format, metres_per_pixel: float | None, frames_per_second: float) -> Table:
    from dirprim_filter.recording.tables import read_csv, read_sdd, read_sumo_fcd

    if form is Format.CSV:
        return read_csv(source)
    if form is Format.SUMO_FCD:
        return read_sumo_fcd(source)
    if metres_per_pixel is None:
        raise ValueError(f"{source}: SDD annotations are in pixels; give the video's scale as --metres-per-pixel")
    return read_sdd(source, metres_per_pixel=metres_per_pixel, frames_per_second=frames_per_second)
