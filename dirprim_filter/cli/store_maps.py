"""`dirprim store learn` and `store update`: maps from a store of many logs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dirprim_filter.cli import losses
from dirprim_filter.cli.counts import counted
from dirprim_filter.cli.learn import CellCount, CellSize, HowModes, HowShaped, Modes, Shape, write_map
from dirprim_filter.cli.options import (
    WRITTEN,
    Cells,
    Force,
    Output,
    Scheduler,
    Seed,
    StoreWorkers,
    Tessellation,
    named_file,
    seconds,
    time_ns,
)

if TYPE_CHECKING:
    from dirprim_filter.cli.progress import LearningProgress
    from dirprim_filter.primitives import PrimitiveMap

Folder = Annotated[Path, typer.Argument(metavar="STORE", help="The folder of a store, or its URL.")]


def learn(
    folder: Folder,
    output: Output,
    tessellation: Tessellation = Cells.JOINT,
    cell_size: CellSize = None,
    cells: CellCount = None,
    modes: HowModes = Modes.BIC,
    primitive: HowShaped = Shape.CURVED,
    min_vehicles: Annotated[
        int | None, typer.Option(min=1, help="Leave out where fewer vehicles passed the same way. Default: 1.")
    ] = None,
    half_life: Annotated[
        float | None, typer.Option(help="After which a vehicle counts half, such as 30d.", parser=seconds)
    ] = None,
    now: Annotated[
        str | None, typer.Option(help="With --half-life: from when age is counted. Default: the last log's end.")
    ] = None,
    hours: Annotated[
        str | None, typer.Option(help="From vehicles that come in these hours of the day alone, such as 7-10 or 22-5.")
    ] = None,
    zone: Annotated[str, typer.Option(help="With --hours: whose clocks count, such as Europe/Berlin.")] = "UTC",
    workers: StoreWorkers = None,
    scheduler: Scheduler = None,
    seed: Seed = 0,
    force: Force = False,
) -> int:
    """Learn from a store how vehicles move.

    Example: dirprim store learn fleet -o map.mcap --half-life 30d
    """
    source = StoreSource(
        folder, min_vehicles=min_vehicles, half_life_s=half_life, now=now, hours=hours, zone=zone, workers=workers,
        scheduler=scheduler,
    )  # fmt: skip
    return write_map(
        source, output, seed=seed, force=force, tessellation=tessellation.value, cell_size=cell_size, n_cells=cells,
        modes=modes.value, primitive=primitive.value,
    )  # fmt: skip


class StoreSource:
    """A store to learn from; what of its logs was lost has been said when they were added."""

    def __init__(
        self, folder: Path, *, min_vehicles: int | None = None, half_life_s: float | None = None,
        now: str | None = None, hours: str | None = None, zone: str = "UTC", workers: int | None = None,
        scheduler: str | None = None,
    ) -> None:  # fmt: skip
        from dirprim_filter.store.sampling import Hours
        from dirprim_filter.store.store import Store
        from dirprim_filter.store.workers import Workers

        if now is not None and half_life_s is None:
            raise ValueError("--now: expected --half-life with it")
        self._store, self._workers = Store.open(folder), Workers.of(0, workers, scheduler)
        self._how: dict[str, Any] = {
            "min_vehicles": min_vehicles or 1, "half_life_s": half_life_s, "now_ns": time_ns(now),
            "hours": None if hours is None else Hours.parse(hours, zone),
        }  # fmt: skip
        self.files = tuple[Path, ...]()
        self.exit_code, self.counts = losses.DONE, ""
        self.said: dict[str, Any] = {
            "min_vehicles": min_vehicles or 1, "half_life_s": half_life_s, "now": now, "hours": hours,
            "zone": None if hours is None else zone,
        }  # fmt: skip

    def learn(self, bars: LearningProgress, **options: Any) -> PrimitiveMap:
        """The map; what is damaged in the store is left out, and reported."""
        from dirprim_filter.store.learning import learn_from_store

        seed = int(options.pop("rng").integers(2**63))
        learned = learn_from_store(
            self._store, workers=self._workers, done=bars.tiles, seed=seed, progress=bars.progress, stage=bars.stage,
            **self._how, **options,
        )  # fmt: skip
        for line in learned.damaged:
            typer.echo(f"error: {line}", err=True)
        self.exit_code = losses.INPUT_LOST if learned.damaged else losses.DONE
        self.said["sha256 store"] = learned.digest
        self.counts = (
            f"{counted(learned.n_logs, 'log')}, {counted(learned.n_rows, 'row')}; {learned.n_fitted} of "
            f"{counted(learned.n_blocks, 'block')} learned anew"
        )
        return learned.primitive_map


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
) -> int:
    """Learn a map anew as it was learned.

    Only where logs were added or forgotten is there work to do. A map of which nothing changed stays as it is, to the
    byte.

    Example: dirprim store update map.mcap fleet
    """
    from dirprim_filter.recording.container.log import scan
    from dirprim_filter.recording.log_writer import METADATA_NAME

    with scan(map_file) as messages:
        said = next((record for name, record in messages.metadata if name == METADATA_NAME), {})
    if "sha256 store" not in said:
        raise ValueError(f"{map_file}: expected a map of a store; learn it with `dirprim learn STORE`")
    kinds = {"tessellation": str, "cell_size": float, "n_cells": int, "modes": str, "primitive": str}
    options = {name: kind(said[name]) if name in said else None for name, kind in kinds.items()}
    source = StoreSource(
        store_folder, min_vehicles=int(said["min_vehicles"]), now=said.get("now"), hours=said.get("hours"),
        half_life_s=float(said["half_life_s"]) if "half_life_s" in said else None, workers=workers,
        scheduler=scheduler, zone=said.get("zone", "UTC"),
    )  # fmt: skip
    return write_map(source, output or map_file, seed=int(said["seed"]), force=force or output is None, **options)
