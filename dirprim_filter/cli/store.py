"""`dirprim store`: the rows of many logs, from which maps are learned."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import typer

from dirprim_filter.cli import exit_codes, store_maps
from dirprim_filter.cli.commands import register
from dirprim_filter.cli.options import Scheduler, StoreFolder, StoreWorkers, month
from dirprim_filter.cli.reading import Reading
from dirprim_filter.cli.texts import counted, say

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
    first = sources[0]
    into = Store.open(folder) if Store.is_at(folder) else Store.create(folder, first.config, first.frame)
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


for command in (add, store_maps.learn, store_maps.update, info, forget, merge, keep):
    register(store, command)
