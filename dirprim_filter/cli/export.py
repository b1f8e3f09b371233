"""`dirprim export`: estimates as a table for other tools."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dirprim_filter.cli import losses
from dirprim_filter.cli.options import Force, Output
from dirprim_filter.cli.reading import Reading, reads_logs
from dirprim_filter.cli.texts import counted


@reads_logs()
def export(
    estimates: Annotated[Path, typer.Argument(help="A log of `dirprim track`.", exists=True, dir_okay=False)],
    output: Output,
    frames_of: Annotated[
        Path | None,
        typer.Option(help="For .txt: number frames by the instants of this log. Default: by those of the estimates."),
    ] = None,
    smoothed: Annotated[
        bool, typer.Option("--smoothed", help="Export the smoothed estimates of `track --smooth` or `--lag`.")
    ] = False,
    force: Force = False,
    *,
    reading: Reading,
) -> int:
    """Write estimates as .csv, .parquet or MOTChallenge's .txt.

    A .csv has the columns of `dirprim convert`, then the covariance and what else is known. A .txt has frame, id, a box
    of -1, confidence, x, y and 0. The options that choose a part of a log are about --frames-of.

    Example: dirprim export tracks.mcap -o tracks.csv
    """
    import numpy as np

    from dirprim_filter.cli.progress import working
    from dirprim_filter.recording import read_estimates
    from dirprim_filter.recording.tables.estimate_table import check_table_format, write_estimates

    form = check_table_format(output)
    if frames_of is not None and form != ".txt":
        raise typer.BadParameter(f"has no meaning for {form}; it is for .txt", param_hint="--frames-of")
    log = None if frames_of is None else reading.tracks([frames_of])
    with working(f"writing {output.name}"):
        believed = read_estimates(estimates, smoothed=smoothed)
        frames = None if log is None else np.unique(log.tracks.time_ns)
        write_estimates(believed, output, frame_ns=frames, force=force)
    typer.echo(f"{output}: {counted(np.unique(believed.track_id).size, 'track')}, {counted(len(believed), 'row')}")
    return losses.DONE if log is None else losses.exit_code(log.losses)
