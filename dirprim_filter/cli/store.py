"""`dirprim store`: the rows of many logs, and the maps that are learned from them."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from dirprim_filter.cli import exit_codes, options
from dirprim_filter.cli.commands import register
from dirprim_filter.cli.options import Scheduler, StoreFolder, StoreWorkers, month
from dirprim_filter.cli.reading import Reading
from dirprim_filter.cli.texts import counted, say
from dirprim_filter.partial_file import PartialFile

UTC = "UTC"

store = typer.Typer(
    name="store",
    help=(
        "The rows of many logs, to learn from all of them. "
        "Example: dirprim store add fleet recordings/roundabout_learn.mcap"
    ),
    no_args_is_help=True,
)


def add(
    folder: StoreFolder,
    logs: Annotated[list[str], typer.Argument(metavar="LOG...", help="MCAP logs: files, URLs, or quoted patterns.")],
    workers: StoreWorkers = None,
    scheduler: Scheduler = None,
    *,
    reading: Reading,
) -> int:
    """Add logs to a store, which is made if need be.

    Logs that it knows are skipped.

    How logs are read is fixed when the store is made. One log that cannot be read does not stop the others.

    Example: dirprim store add fleet recordings/roundabout_learn.mcap
    """
    from dirprim_filter.cli.progress import step_progress
    from dirprim_filter.store.adding import add_logs
    from dirprim_filter.store.config import StoreConfig
    from dirprim_filter.store.folder import shown
    from dirprim_filter.store.logs import find_logs
    from dirprim_filter.store.store import Store
    from dirprim_filter.store.workers import Workers

    reading.require_acting(*StoreConfig.__dataclass_fields__)
    found = find_logs(logs)
    config = Store.open(folder).config if Store.is_at(folder) else StoreConfig()
    config = replace(config, **reading.given)
    with step_progress(f"adding to {shown(folder)}", "logs") as progress:
        workers_ = Workers.of(len(found), workers, scheduler)
        added = add_logs(folder, found, config=config, workers=workers_, progress=progress)
    say(*(f"error: {line}" for line in added.failures), err=True)
    done = [receipt for receipt in added.receipts if not receipt.error]
    origin = f"; origin {added.store.origin}" if added.store and added.store.origin else ""
    say(
        f"{shown(folder)}: added {counted(len(done), 'log')}, {counted(sum(r.n_rows for r in done), 'row')}; "
        f"{added.known} known, {len(added.receipts) - len(done)} failed{origin}"
    )
    if len(done) < len(added.receipts):
        return exit_codes.FAILED
    return exit_codes.INPUT_LOST if any(receipt.is_damaged for receipt in done) else exit_codes.DONE


def info(
    folder: StoreFolder,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object.")] = False,
) -> int:
    """List the logs of a store, and how they are read.

    Example: dirprim store info fleet
    """
    from dirprim_filter.store.store import Store

    there = Store.open(folder)
    contents = there.contents()
    entries, recordings = list(contents.entries.values()), contents.recordings()
    size, n_rows = sum(e.size for e in entries), sum(e.n_rows for e in recordings)
    say(*(f"error: {line}" for line in contents.damaged), err=True)
    if as_json:
        logs = [
            {
                "log": e.log, "recording": e.recording, "rows": e.n_rows, "vehicles": e.n_vehicles, "bytes": e.size,
                "start_ns": e.start_ms * 1_000_000, "end_ns": e.end_ms * 1_000_000, "status": e.status,
                "blocks": sorted({str(file.block) for file in e.files}),
            }
            for e in entries
        ]  # fmt: skip
        typer.echo(json.dumps({
            "config": asdict(there.config), "frame": there.frame, "recordings": len(recordings), "rows": n_rows,
            "bytes": size, "logs": logs, "damage": contents.damaged,
        }))  # fmt: skip
    else:
        say(
            f"{there}: {counted(len(entries), 'log')} of {counted(len(recordings), 'recording')}, "
            f"{counted(n_rows, 'row')}, {counted(sum(e.n_vehicles for e in recordings), 'vehicle')}, "
            f"{size} bytes ({size / max(n_rows, 1):.1f} a row), frame {there.frame!r}",
            *(
                f"  {e.log}: {counted(e.n_rows, 'row')}, {counted(e.n_vehicles, 'vehicle')}, "
                f"{(e.end_ms - e.start_ms) * 1e-3:.0f} s{', damaged' * (e.status == 'damaged')}"
                for e in entries
            ),
        )
    return exit_codes.INPUT_LOST if contents.damaged else exit_codes.DONE


def forget(
    folder: StoreFolder,
    logs: Annotated[list[str], typer.Argument(metavar="LOG...", help="As `dirprim store info` lists them, or paths.")],
) -> None:
    """Take logs out of a store, as if they never were in it.

    Example: dirprim store forget fleet recordings/roundabout_learn.mcap
    """
    from dirprim_filter.store.forgetting import forget
    from dirprim_filter.store.logs import name_of
    from dirprim_filter.store.store import Store

    there = Store.open(folder)
    for entry in forget(there, [name_of(log) for log in logs]):
        say(f"{there}: forgot {entry.log}, {counted(entry.n_rows, 'row')}")


def merge(
    folder: StoreFolder,
    others: Annotated[list[Path], typer.Argument(metavar="OTHER...", help="Stores whose logs to add.")],
) -> None:
    """Add the logs of other stores; what several hold counts once.

    Example: dirprim store merge fleet other-fleet
    """
    from dirprim_filter.store.forgetting import merge
    from dirprim_filter.store.store import Store

    sources = [Store.open(path) for path in others]
    into = Store.open(folder) if Store.is_at(folder) else Store.create(folder, sources[0].config, sources[0].frame)
    n = sum(merge(into, source) for source in sources)
    say(f"{into}: {counted(n, 'log')} new, {len(into.contents().entries)} in all")


def keep(
    folder: StoreFolder,
    vehicles: Annotated[int | None, typer.Option(min=1, help="Of a turn in a month. Default: 100.")] = None,
    of_month: Annotated[
        str | None, typer.Option(help="Such as 2026-08. Default: all but that of the last log.", parser=month)
    ] = None,
) -> None:
    """Keep fewer vehicles of months that are over.

    At most --vehicles of each turn are kept, and weigh as much as all of them. The others are deleted. Turns with fewer
    vehicles are kept whole.

    Example: dirprim store keep fleet --vehicles 100 --of-month 2026-08
    """
    from dirprim_filter.cli.progress import step_progress
    from dirprim_filter.store.keeping import VEHICLES, keep
    from dirprim_filter.store.store import Store

    there = Store.open(folder)
    with step_progress(f"thinning {there}", "logs") as progress:
        months = keep(there, n_vehicles=vehicles or VEHICLES, month=of_month, progress=progress)
    for done in months:
        say(f"{there}: {done.month}, {done.n_after} of {counted(done.n_before, 'vehicle')} kept")
    if not months:
        say(f"{there}: nothing to thin, for it has no such month; the last is left as it is")


def learn(
    folder: StoreFolder,
    output: options.Output,
    tessellation: options.Tessellation = "joint",
    cell_size: options.CellSize = None,
    n_cells: options.CellCount = None,
    modes: options.HowModes = "bic",
    primitive: options.HowShaped = "curved",
    min_vehicles: Annotated[int, typer.Option(min=1, help="Leave out where fewer vehicles passed the same way.")] = 1,
    half_life_s: Annotated[
        float | None,
        typer.Option("--half-life", help="After which a vehicle counts half, such as 30d.", parser=options.seconds),
    ] = None,
    now: Annotated[
        str | None, typer.Option(help="With --half-life: from when age is counted. Default: the last log's end.")
    ] = None,
    hours: Annotated[
        str | None, typer.Option(help="Learn only from vehicles of these hours of the day, such as 7-10 or 22-5.")
    ] = None,
    zone: Annotated[str, typer.Option(help="With --hours: whose clocks count, such as Europe/Berlin.")] = UTC,
    workers: StoreWorkers = None,
    scheduler: Scheduler = None,
    seed: options.Seed = 0,
    force: options.Force = False,
) -> int:
    """Learn from a store how vehicles move.

    What of its logs was lost was said when they were added; what the store has lost since is said.

    Example: dirprim store learn fleet -o map.mcap --half-life 30d
    """
    if now is not None and half_life_s is None:
        raise ValueError("--now: expected --half-life with it")
    if zone != UTC and hours is None:
        raise ValueError("--zone: expected --hours with it")
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
        "tessellation": tessellation, "cell_size": cell_size, "n_cells": n_cells, "modes": modes,
        "primitive": primitive,
    }  # fmt: skip
    with learning_progress() as bars:
        found = learn_from_store(
            Store.open(folder), workers=Workers.of(0, workers, scheduler), done=bars.tiles, progress=bars.progress,
            stage=bars.stage, seed=int(np.random.default_rng(seed).integers(2**63)), config=LearningConfig(),
            min_vehicles=min_vehicles, half_life_s=half_life_s, now_ns=options.time_ns(now, "--now"),
            hours=None if hours is None else Hours.parse(hours, zone), **how,
        )  # fmt: skip
    say(*(f"error: {line}" for line in found.damaged), err=True)
    said = {
        "seed": seed, **how, "min_vehicles": min_vehicles, "half_life_s": half_life_s, "now": now, "hours": hours,
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
    folder: StoreFolder,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="The file to write. Default: in the place of the map."),
        options.WRITTEN,
    ] = None,
    workers: StoreWorkers = None,
    scheduler: Scheduler = None,
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
    numbers = {"cell_size": float, "n_cells": int, "min_vehicles": int, "half_life_s": float, "seed": int}
    names = (*numbers, "tessellation", "modes", "primitive", "now", "hours", "zone")
    how: dict[str, Any] = {name: numbers.get(name, str)(said[name]) for name in names if name in said}
    how |= {"workers": workers, "scheduler": scheduler}
    return learn(folder, output or map_file, **how, force=force or output is None)


for command in (add, learn, update, info, forget, merge, keep):
    register(store, command)
