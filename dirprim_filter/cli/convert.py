"""`dirprim convert`: tables of other formats to an MCAP log."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dirprim_filter.cli import losses
from dirprim_filter.cli.counts import counted
from dirprim_filter.cli.options import Force, Output

if TYPE_CHECKING:
    from dirprim_filter.recording.tables import Table


class Format(StrEnum):
    """What the source is."""

    CSV = "csv"
    SDD = "sdd"
    SUMO_FCD = "sumo-fcd"
    JSON = "json"


def convert(
    source: Annotated[Path, typer.Argument(help="The table.", exists=True, dir_okay=False)],
    output: Output,
    form: Annotated[Format, typer.Option("--format", help="Format of the table.")] = Format.CSV,
    metres_per_pixel: Annotated[float | None, typer.Option(help="sdd: scale of the video.")] = None,
    frames_per_second: Annotated[float, typer.Option(help="sdd: rate of the video.")] = 30.0,
    columns: Annotated[
        str | None, typer.Option(help="csv: names of the columns in the table, as x_m=Easting,y_m=Northing,...")
    ] = None,
    fields: Annotated[
        str | None,
        typer.Option(help="json: where a frame tells of its objects, as time_s=.t,id=.objects[].id,x=.objects[].x,..."),
    ] = None,
    origin: Annotated[
        str | None, typer.Option(help="json: latitude,longitude of the plane; left out, the first place.")
    ] = None,
    force: Force = False,
) -> int:
    """Write a table of tracks, or of detections, as an MCAP log.

    csv has columns by name: time_s, track_id, x_m, y_m; optional heading_rad (of the body),
    course_rad (over ground), speed_mps, group, length_m, width_m, height_m, and label (or category, or class).
    Between cells are commas, semicolons or tabs; a .csv.gz is read as well.

    json is an array of frames, or has a frame in each line. --fields names the paths of time_s (or time, nanoseconds),
    id, x and y (or latitude and longitude), and what else there is of speed, heading, label, length, width, ...

    Example: dirprim convert tracks.csv -o tracks.mcap

    Example: dirprim convert survey.csv.gz -o tracks.mcap --columns x_m=Easting,y_m=Northing,track_id=Id
    """
    from dirprim_filter.cli.progress import step_progress, working
    from dirprim_filter.cli.provenance import provenance
    from dirprim_filter.recording import write_tracks

    with working(f"reading {source.name}"):
        table = _read(source, form, metres_per_pixel, frames_per_second, columns, fields, origin)
    said = provenance(
        "convert", inputs=[source], format=form.value, metres_per_pixel=metres_per_pixel, columns=columns,
        fields=fields, origin=origin,
    )  # fmt: skip
    with step_progress(f"writing {output.name}", "instants") as progress:
        write_tracks(table.tracks, output, labels=table.labels, metadata=said, force=force, progress=progress)
    if table.unused:
        typer.echo(f"{source}: columns not used: {', '.join(table.unused)}; --columns NAME=COLUMN uses one", err=True)
    for note, count in table.notes.items():
        typer.echo(f"{source}: {counted(count, 'row')}: {note}", err=True)
    tracks, rows = counted(table.tracks.n_tracks, "track"), counted(len(table.tracks), "row")
    typer.echo(f"{output}: {tracks}, {rows}")
    return losses.tell_dropped(source, table)


def _read(
    source: Path, form: Format, metres_per_pixel: float | None, frames_per_second: float, columns: str | None,
    fields: str | None, origin: str | None,
) -> Table:  # fmt: skip
    from dirprim_filter.recording.schemas.field_mapping import FieldMapping
    from dirprim_filter.recording.tables import read_csv, read_json, read_sdd, read_sumo_fcd
    from dirprim_filter.recording.tables.csv_table import parse_columns
    from dirprim_filter.recording.transforms.geodesy import Origin

    for option, value in (("--fields", fields), ("--origin", origin)):
        if value and form is not Format.JSON:
            raise typer.BadParameter(f"has no meaning for --format {form.value}; it is for json", param_hint=option)
    if form is Format.CSV:
        return read_csv(source, columns=parse_columns(columns) if columns else None)
    if columns:
        raise typer.BadParameter(f"has no meaning for --format {form.value}; it is for csv", param_hint="--columns")
    if form is Format.JSON:
        if fields is None:
            raise ValueError(f"{source}: expected --fields, which tell where its frames hold objects")
        return read_json(source, FieldMapping.parse(fields), origin=Origin.parse(origin) if origin else None)
    if form is Format.SUMO_FCD:
        return read_sumo_fcd(source)
    if metres_per_pixel is None:
        raise ValueError(f"{source}: SDD annotations are in pixels; give the video's scale as --metres-per-pixel")
    return read_sdd(source, metres_per_pixel=metres_per_pixel, frames_per_second=frames_per_second)
