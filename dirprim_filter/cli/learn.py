"""`dirprim learn`: a map of directional primitives from logs."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from dirprim_filter.cli import losses
from dirprim_filter.cli.counts import counted
from dirprim_filter.cli.options import Cells, Force, Logs, Output, Seed, SensorFile, Tessellation
from dirprim_filter.cli.reading import Reading, reads_logs


class Modes(StrEnum):
    """How modes are counted and fitted."""

    BIC = "bic"
    DBSCAN = "dbscan"


class Shape(StrEnum):
    """How a primitive varies inside its cell."""

    CURVED = "curved"
    FLAT = "flat"


@reads_logs
def learn(
    logs: Logs,
    output: Output,
    tessellation: Tessellation = Cells.JOINT,
    cell_size: Annotated[float | None, typer.Option(help="Metres. Default: chosen on held-out vehicles.")] = None,
    cells: Annotated[int | None, typer.Option(help="Approximate number of cells, instead of their size.")] = None,
    modes: Annotated[Modes, typer.Option(help="bic, or the paper's dbscan.")] = Modes.BIC,
    primitive: Annotated[Shape, typer.Option(help="How a primitive varies inside its cell.")] = Shape.CURVED,
    sensor: SensorFile = None,
    seed: Seed = 0,
    reading: Reading = Reading(),
    force: Force = False,
) -> int:
    """Learn from logs how vehicles move at each place.

    Example: dirprim learn recordings/roundabout_learn.mcap -o map.mcap
    """
    import numpy as np

    from dirprim_filter.cli.progress import learning_progress
    from dirprim_filter.cli.provenance import provenance
    from dirprim_filter.config import LearningConfig
    from dirprim_filter.primitives import learn_primitives
    from dirprim_filter.recording import save_map
    from dirprim_filter.recording.errors import OutputExistsError
    from dirprim_filter.recording.sensor_file import load_sensor
    from dirprim_filter.sensor import without_bias

    if output.exists() and not force:  # before the work, not after it
        raise OutputExistsError(output)
    sensing = None if sensor is None else load_sensor(sensor)
    log = reading.tracks(logs)
    tracks = log.tracks if sensing is None else without_bias(log.tracks, sensing)
    config = LearningConfig()
    with learning_progress() as bars:
        learned = learn_primitives(
            tracks, tessellation=tessellation.value, cell_size=cell_size, n_cells=cells, modes=modes.value,
            primitive=primitive.value, config=config, progress=bars.progress, stage=bars.stage,
            rng=np.random.default_rng(seed),
        )  # fmt: skip
    said = provenance(
        "learn", inputs=logs, config=config, tessellation=tessellation.value, cell_size=cell_size, n_cells=cells,
        modes=modes.value, primitive=primitive.value, seed=seed, sensor=None if sensing is None else repr(sensing),
        **reading.said(),
    )  # fmt: skip
    save_map(learned, output, metadata=said, force=force)
    n_modes = float((learned.direction.weight[:-1, : -learned.n_place_free_modes] > 0).sum(axis=1).mean())
    typer.echo(
        f"{output}: {counted(learned.tessellation.n_cells, 'cell')} of "
        f"{float(learned.tessellation.area.mean()) ** 0.5:.3g} m, {n_modes:.1f} modes each, "
        f"from {counted(log.tracks.n_tracks, 'track')}, {counted(len(log.tracks), 'row')}"
    )
    return losses.exit_code([damage for _, damage in log.damage], log.dropped.lost)
