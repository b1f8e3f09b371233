"""`dirprim store learn` and `store update`: maps from a store of many logs, and maps brought up to date with theirs."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

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


class Slots(StrEnum):
    """What weights and speeds turn with."""

    HOUR = "hour"
    WEEK = "week"


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
        int | None, typer.Option(min=1, help="Leave out what fewer vehicles did. Default: 5.")
    ] = None,
    half_life: Annotated[
        float | None, typer.Option(help="In which half of all places change, such as 30d.", parser=seconds)
    ] = None,
    now: Annotated[
        str | None, typer.Option(help="With --half-life: from when age is counted. Default: the last log's end.")
    ] = None,
    by: Annotated[Slots | None, typer.Option(help="Weights and mean speeds by the hour of the day or week.")] = None,
    zone: Annotated[
        str | None, typer.Option(help="With --by: whose clocks count, such as Europe/Berlin. Default: UTC.")
    ] = None,
    workers: StoreWorkers = None,
    scheduler: Scheduler = None,
    seed: Seed = 0,
    force: Force = False,
) -> int:
    """Learn from a store how vehicles move.

    Example: dirprim store learn fleet -o map.mcap --half-life 30d
    """
    from dirprim_filter.recording.errors import OutputExistsError

    if output.exists() and not force:  # before the work, not after it
        raise OutputExistsError(output)
    source = StoreSource(
        folder, min_vehicles=min_vehicles, half_life_s=half_life, now=now, by=None if by is None else by.value,
        zone=zone, workers=workers, scheduler=scheduler,
    )  # fmt: skip
    return write_map(
        source, output, seed=seed, force=force, tessellation=tessellation.value, cell_size=cell_size, n_cells=cells,
        modes=modes.value, primitive=primitive.value,
    )  # fmt: skip


class StoreSource:
    """A store to learn from; what of its logs was lost has been said when they were added."""

    def __init__(
        self, folder: Path, *, min_vehicles: int | None = None, half_life_s: float | None = None,
        now: str | None = None, by: Literal["hour", "week"] | None = None, zone: str | None = None,
        workers: int | None = None, scheduler: str | None = None,
    ) -> None:  # fmt: skip
        from dirprim_filter.store.fading import LATEST, Fading
        from dirprim_filter.store.learning import MIN_VEHICLES
        from dirprim_filter.store.store import Store
        from dirprim_filter.store.workers import workers_for

        if now is not None and half_life_s is None:
            raise ValueError("--now: expected --half-life with it")
        if zone is not None and by is None:
            raise ValueError("--zone: expected --by with it")
        store = Store.open(folder)
        entries = store.entries()
        if not entries:
            raise ValueError(f"{store.path}: expected logs to learn from, the store is empty; see `dirprim store add`")
        now_ns = time_ns(now)
        self._store = store
        self.exit_code, self.files = losses.DONE, tuple[Path, ...]()
        self._by: Literal["hour", "week"] | None = by
        self._zone = "UTC" if zone is None else zone
        self._workers = workers_for(0, workers, scheduler)
        self._least = MIN_VEHICLES if min_vehicles is None else min_vehicles
        self._fading = None
        if half_life_s is not None:
            self._fading = Fading(half_life_s=half_life_s, now_ns=LATEST if now_ns is None else now_ns)
        self.said: dict[str, Any] = {
            "sha256 store": store.digest, "min_vehicles": self._least, "half_life_s": half_life_s, "now": now,
        }  # fmt: skip
        if by is not None:
            self.said |= {"by": self._by, "zone": self._zone}
        n_rows = sum({entry.rows: entry.n_rows for entry in entries}.values())
        self.counts = f"{counted(len(entries), 'log')}, {counted(n_rows, 'row')}"

    def learn(self, bars: LearningProgress, **options: Any) -> PrimitiveMap:
        """The map."""
        from dirprim_filter.store.updating import learn_from_store

        return learn_from_store(
            self._store,
            min_vehicles=self._least,
            fading=self._fading,
            by=self._by,
            zone=self._zone,
            workers=self._workers,
            progress=bars.progress,
            stage=bars.stage,
            fitted=bars.tiles,
            **options,
        )


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
    """Fit a map anew where its store changed.

    Only cells are fitted where logs were added or forgotten, and they stay where they are. A map of which nothing
    changed stays as it is, to the byte.

    Example: dirprim store update map.mcap fleet
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
