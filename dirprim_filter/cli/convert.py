"""`dirprim convert`: tables of other formats to an MCAP log."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from dirprim_filter.cli import exit_codes
from dirprim_filter.cli.options import Force, Output
from dirprim_filter.cli.texts import counted, say

if TYPE_CHECKING:
    from dirprim_filter.recording.tables import Table


def convert(
    source: Annotated[Path, typer.Argument(help="The table.", exists=True, dir_okay=False)],
    output: Output,
    form: Annotated[
        Literal["csv", "parquet", "feather", "sumo-fcd", "sdd", "trajnet"],
        typer.Option("--format", help="csv, parquet and feather are recognised."),
    ] = "csv",
    metres_per_pixel: Annotated[float | None, typer.Option(help="sdd: scale of the video.")] = None,
    frames_per_second: Annotated[
        float | None, typer.Option(help="sdd, trajnet: rate of the frames. Default: 30 of sdd.")
    ] = None,
    columns: Annotated[
        str | None,
        typer.Option(help="csv, parquet, feather: what the table calls columns, as in x_m=Easting,group=site+day"),
    ] = None,
    origin: Annotated[
        str | None, typer.Option(help="Latitude,longitude of the plane, for satellite positions. Default: the first.")
    ] = None,
    force: Force = False,
) -> int:
    """Write a table of tracks or detections as an MCAP log.

    csv, parquet and feather have columns by name: time_s, track_id, x_m, y_m, and others (docs/guides/table.md); they
    need no converting: learn, track, evaluate and score take them as they are. Rows without track_id are detections.

    Example: dirprim convert tracks.csv -o tracks.mcap

    Example: dirprim convert survey.csv.gz -o tracks.mcap --columns x_m=Easting,y_m=Northing,track_id=Id
    """
    from dirprim_filter.cli.progress import step_progress, working
    from dirprim_filter.cli.results import provenance
    from dirprim_filter.origin import Origin
    from dirprim_filter.recording import write_tracks
    from dirprim_filter.recording.name_patterns import named_values
    from dirprim_filter.recording.tables.named_columns import COLUMNS

    options = {
        "metres_per_pixel": metres_per_pixel, "frames_per_second": frames_per_second,
        "columns": named_values(columns, COLUMNS, of="columns") if columns else None,
        "origin": Origin.parse(origin) if origin else None,
    }  # fmt: skip
    with working(f"reading {source.name}"):
        table = _read(source, form, {name: value for name, value in options.items() if value is not None})
    if table.too_early:
        raise table.too_early
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


def _read(source: Path, form: str, given: dict[str, Any]) -> Table:
    """The table, by the reader of its format; options that it has not are refused, as are those that it needs."""
    from dirprim_filter.recording.tables import FORMATS, options_of

    takes = options_of(form)
    for name in given.keys() - takes.keys():
        others = ", ".join(other for other in FORMATS if name in options_of(other))
        raise typer.BadParameter(f"has no meaning for --format {form}; it is for {others}", param_hint=_option(name))
    for name, is_needed in takes.items():
        if is_needed and name not in given:
            raise ValueError(f"{source}: expected {_option(name)}, which a table of {form} does not contain")
    return FORMATS[form](source, **given)


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"
