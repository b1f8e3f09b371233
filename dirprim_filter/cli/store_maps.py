"""`dirprim store learn` and `store update`: maps from a store of many logs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from dirprim_filter.cli import exit_codes, options
from dirprim_filter.cli.texts import counted, say
from dirprim_filter.partial_file import PartialFile

UTC = "UTC"


def learn(
    folder: options.StoreFolder,
    output: options.Output,
    tessellation: options.Tessellation = "joint",
    cell_size: options.CellSize = None,
    cells: options.CellCount = None,
    modes: options.HowModes = "bic",
    primitive: options.HowShaped = "curved",
    min_vehicles: Annotated[int, typer.Option(min=1, help="Leave out where fewer vehicles passed the same way.")] = 1,
    half_life: Annotated[
        float | None, typer.Option(help="After which a vehicle counts half, such as 30d.", parser=options.seconds)
    ] = None,
    now: Annotated[
        str | None, typer.Option(help="With --half-life: from when age is counted. Default: the last log's end.")
    ] = None,
    hours: Annotated[
        str | None, typer.Option(help="Learn only from vehicles of these hours of the day, such as 7-10 or 22-5.")
    ] = None,
    zone: Annotated[str, typer.Option(help="With --hours: whose clocks count, such as Europe/Berlin.")] = UTC,
    workers: options.StoreWorkers = None,
    scheduler: options.Scheduler = None,
    seed: options.Seed = 0,
    force: options.Force = False,
) -> int:
    """Learn from a store how vehicles move.

    What of its logs was lost was said when they were added; what the store has lost since is said.

    Example: dirprim store learn fleet -o map.mcap --half-life 30d
    """
    for is_alone, option, needed in (
        (now is not None and half_life is None, "--now", "--half-life"),
        (zone != UTC and hours is None, "--zone", "--hours"),
    ):
        if is_alone:
            raise ValueError(f"{option}: expected {needed} with it")
    import numpy as np

    from dirprim_filter.cli.progress import learning_progress
    from dirprim_filter.cli.results import save_learned
    from dirprim_filter.config import LearningConfig
    from dirprim_filter.store.learning import learn_from_store
    from dirprim_filter.store.sampling import Hours
    from dirprim_filter.store.store import Store
    from dirprim_filter.store.workers import Workers

    PartialFile(output, force=force)  # of `update` it is not the user's to name, and not checked yet
    how: dict[str, Any] = {
        "tessellation": tessellation, "cell_size": cell_size, "n_cells": cells, "modes": modes, "primitive": primitive,
    }  # fmt: skip
    with learning_progress() as bars:
        found = learn_from_store(
            Store.open(folder), workers=Workers.of(0, workers, scheduler), done=bars.tiles, progress=bars.progress,
            stage=bars.stage, seed=int(np.random.default_rng(seed).integers(2**63)), config=LearningConfig(),
            min_vehicles=min_vehicles, half_life_s=half_life, now_ns=options.time_ns(now, "--now"),
            hours=None if hours is None else Hours.parse(hours, zone), **how,
        )  # fmt: skip
    say(*(f"error: {line}" for line in found.damaged), err=True)
    said = {
        "seed": seed, **how, "min_vehicles": min_vehicles, "half_life_s": half_life, "now": now, "hours": hours,
        "zone": None if hours is None else zone, "sha256 store": found.digest,
    }  # fmt: skip
    counts = (
        f"{counted(found.n_logs, 'log')}, {counted(found.n_rows, 'row')}; {found.n_fitted} of "
        f"{counted(found.n_blocks, 'block')} learned anew"
    )
    save_learned(found.primitive_map, output, said=said, counts=counts, force=force)
    return exit_codes.INPUT_LOST if found.damaged else exit_codes.DONE


def update(
    map_file: options.MapFile,
    folder: options.StoreFolder,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="The file to write. Default: in the place of the map."),
        options.WRITTEN,
    ] = None,
    workers: options.StoreWorkers = None,
    scheduler: options.Scheduler = None,
    force: options.Force = False,
) -> int:
    """Learn a map anew as it was learned.

    Only blocks whose logs changed are learned. A map of which nothing changed stays the same to the byte.

    Example: dirprim store update map.mcap fleet
    """
    from dirprim_filter.cli.results import metadata_of

    said = metadata_of(map_file)
    if "sha256 store" not in said:
        raise ValueError(f"{map_file}: expected a map of a store; learn it with `dirprim learn STORE`")

    def stated(kind: Callable[[str], Any], name: str) -> Any:
        return kind(said[name]) if name in said else None

    return learn(
        folder, output or map_file, stated(str, "tessellation"), stated(float, "cell_size"), stated(int, "n_cells"),
        stated(str, "modes"), stated(str, "primitive"), stated(int, "min_vehicles"), stated(float, "half_life_s"),
        now=stated(str, "now"), hours=stated(str, "hours"), zone=said.get("zone", UTC), workers=workers,
        scheduler=scheduler, seed=int(said["seed"]), force=force or output is None,
    )  # fmt: skip
