"""`dirprim export`: estimates as a table for other tools."""

from __future__ import annotations

from typing import Annotated

import typer

from dirprim_filter.cli import exit_codes
from dirprim_filter.cli.options import EstimatesFile, Force, Table
from dirprim_filter.cli.texts import counted


def export(
    estimates: EstimatesFile,
    output: Table,
    smoothed: Annotated[
        bool, typer.Option("--smoothed", help="Export the smoothed estimates of `track --smooth` or `--lag`.")
    ] = False,
    assigned: Annotated[
        bool, typer.Option("--assigned", help="Export which track each detection was assigned to, a row for each.")
    ] = False,
    force: Force = False,
) -> int:
    """Write estimates, or which detections they follow, as a table.

    The columns are those of `dirprim convert`, then what else is known. With --assigned `track_id` is the detection's
    own, as its log has it, and `assigned` the track, empty for none.

    Example: dirprim export tracks.mcap -o tracks.csv
    """
    import numpy as np

    from dirprim_filter.cli.progress import working
    from dirprim_filter.estimates import Assignments, Estimates
    from dirprim_filter.recording.estimate_tables import write_estimates
    from dirprim_filter.recording.losses import Losses
    from dirprim_filter.recording.reader import read_assigned, read_estimates

    if assigned and smoothed:
        raise typer.BadParameter("detections are assigned by the filter, and not smoothed", param_hint="--assigned")
    rows: Estimates | Assignments
    lost = Losses()
    with working(f"writing {output.name}"):
        if assigned:
            seen = read_assigned(estimates, losses=lost)
            rows, names = seen, seen.assigned[seen.assigned != ""]
        else:
            rows = read_estimates(estimates, smoothed=smoothed, losses=lost)
            names = rows.track_id
        write_estimates(rows, output, force=force)
    typer.echo(f"{output}: {counted(np.unique(names).size, 'track')}, {counted(len(rows), 'row')}")
    return exit_codes.of_losses(lost)
