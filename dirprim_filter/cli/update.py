"""`dirprim update`: a map brought up to date with its store."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dirprim_filter.cli.counts import counted
from dirprim_filter.cli.options import WRITTEN, Force, Scheduler, StoreWorkers, named_file

MUCH = 0.01
"""Of what vehicles did where no cell is, that is worth a line."""


def update(
    map_file: Annotated[
        Path,
        typer.Argument(metavar="MAP", help="A map that `dirprim learn STORE` wrote.", exists=True, dir_okay=False),
    ],
    store_folder: Annotated[Path, typer.Argument(metavar="STORE", help="The folder of its store, or its URL.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="The file to write. Default: in the place of MAP.", callback=named_file),
        WRITTEN,
    ] = None,
    workers: StoreWorkers = None,
    scheduler: Scheduler = None,
    force: Force = False,
) -> None:
    """Fit a map's cells anew where logs were added to its store, or forgotten.

    Cells stay where they are. A map of which nothing changed stays as it is, to the byte.

    Example: dirprim update map.mcap fleet
    """
    from dirprim_filter.cli.progress import step_progress
    from dirprim_filter.recording import load_map, save_map
    from dirprim_filter.recording.container.log import scan
    from dirprim_filter.recording.errors import OutputExistsError
    from dirprim_filter.recording.log_writer import METADATA_NAME
    from dirprim_filter.store.store import Store
    from dirprim_filter.store.updating import update_map
    from dirprim_filter.store.workers import workers_for

    if output is not None and output.exists() and not force:  # before the work, not after it
        raise OutputExistsError(output)
    store = Store.open(store_folder)
    with step_progress(f"updating {map_file}", "tiles") as progress:
        by = workers_for(0, workers, scheduler)
        done = update_map(load_map(map_file), store, workers=by, progress=progress)
    if done.n_tiles or output is not None:
        with scan(map_file) as messages:
            said = next((record for name, record in messages.metadata if name == METADATA_NAME), {})
        # Nothing of when and from which map: updates in any order give the same bytes.
        save_map(done.primitive_map, output or map_file, metadata=said | {"sha256 store": store.digest}, force=True)
    typer.echo(
        f"{output or map_file}: {done.n_cells} of {counted(done.primitive_map.tessellation.n_cells, 'cell')} fitted "
        f"anew, where {counted(done.n_tiles, 'tile')} of {store.path} changed"
    )
    if done.uncovered > MUCH:
        typer.echo(
            f"warning: {done.uncovered:.0%} of what vehicles did there is where the map has no cell; to cover it, "
            f"learn it again with `dirprim learn {store.path}`",
            err=True,
        )
