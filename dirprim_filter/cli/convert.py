"""`dirprim convert`: tables of other formats to an MCAP log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dirprim_filter.cli import exit_codes
from dirprim_filter.cli.options import Force, Output
from dirprim_filter.cli.texts import counted, say
from dirprim_filter.recording.name_patterns import TableFormat, form_of


def convert(
    source: Annotated[Path, typer.Argument(help="The table.", exists=True, dir_okay=False)],
    output: Output,
    form: Annotated[
        TableFormat | None, typer.Option("--format", help="Default: as the name of the table ends.")
    ] = None,
    metres_per_pixel: Annotated[float | None, typer.Option(help="sdd: scale of the video.")] = None,
    frames_per_second: Annotated[
        float | None, typer.Option(help="sdd, trajnet: rate of the frames. Default: 30 of sdd.")
    ] = None,
    columns: Annotated[
        str | None,
        typer.Option(
            help="csv, parquet, feather: what the table calls columns, as in x_m=Easting,group=site+day; heading= "
            "leaves the column heading out."
        ),
    ] = None,
    origin: Annotated[
        str | None, typer.Option(help="Latitude,longitude of the plane, for satellite positions. Default: the first.")
    ] = None,
    force: Force = False,
) -> int:
    """Write a table of tracks or detections as an MCAP log.

    csv, parquet and feather have columns by name: time_s, track_id, x_m, y_m, and others (docs/guides/table.md). Rows
    without track_id are detections. Tables need no converting: all commands take them as they are, where need be with
    --set format=... (docs/formats.md).

    Example: dirprim convert tracks.csv -o tracks.mcap

    Example: dirprim convert survey.csv.gz -o tracks.mcap --columns x_m=Easting,y_m=Northing,track_id=Id
    """
    from dirprim_filter.cli.progress import step_progress, working
    from dirprim_filter.cli.results import provenance
    from dirprim_filter.origin import Origin
    from dirprim_filter.recording import write_tracks
    from dirprim_filter.recording.errors import RecordingError
    from dirprim_filter.recording.tables import read_as

    if columns == "":
        raise typer.BadParameter("expected NAME=COLUMN, got nothing", param_hint="--columns")
    scales = {"metres_per_pixel": metres_per_pixel, "frames_per_second": frames_per_second}
    stated = [f"{name}={value}" for name, value in scales.items() if value is not None]
    how = ",".join([form or form_of(source), *stated, *filter(None, [columns])])
    with working(f"reading {source.name}"):
        table = read_as(source, how, None if origin is None else Origin.parse(origin))
    if table.too_early:
        raise table.too_early
    if not (len(table.tracks) or table.detections):
        raise RecordingError(f"{source}: expected rows that are good, got none; left out: {table.losses}")
    table.log(source)
    said = provenance(
        "convert", inputs=[source], format=form, metres_per_pixel=metres_per_pixel,
        frames_per_second=frames_per_second, columns=columns, origin=origin,
    )  # fmt: skip
    with step_progress(f"writing {output.name}", "instants") as progress:
        write_tracks(table.tracks, output, detections=table.detections, labels=table.labels, metadata=said,
                     force=force, progress=progress)  # fmt: skip
    if table.tracks.n_tracks or not table.detections:
        say(f"{output}: {counted(table.tracks.n_tracks, 'track')}, {counted(len(table.tracks), 'row')}")
    for sensor, seen in table.detections.items():
        say(f"{output}: {counted(len(seen), 'detection')}{' of ' * bool(sensor)}{sensor}")
    return exit_codes.of_losses(table.losses)
