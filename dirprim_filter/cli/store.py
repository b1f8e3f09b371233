"""`dirprim store`: statistics of many logs that add up, from which `dirprim learn` makes maps."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dirprim_filter.cli import losses, store_maps
from dirprim_filter.cli.counts import counted
from dirprim_filter.cli.options import Fields, Scheduler, Topics, time_ns
from dirprim_filter.cli.outputs import checked
from dirprim_filter.cli.reading import TimeSource

if TYPE_CHECKING:
    from dirprim_filter.store.config import StoreConfig
    from dirprim_filter.store.manifest import Entry
    from dirprim_filter.store.store import Store

store = typer.Typer(
    name="store",
    help=(
        "Statistics of many logs that add up: learn from all without reading them again. "
        "Example: dirprim store add fleet recordings/roundabout_learn.mcap"
    ),
    no_args_is_help=True,
)
Folder = Annotated[
    Path, typer.Argument(metavar="STORE", help="The folder of the store, or a URL such as s3://bucket/fleet.")
]
FAILED = 1


def add(
    folder: Folder,
    logs: Annotated[list[str], typer.Argument(metavar="LOG...", help="MCAP logs: files, URLs, or quoted patterns.")],
    topics: Topics = None,
    time_source: Annotated[TimeSource | None, typer.Option(help="Which time of a message to use.")] = None,
    frame: Annotated[
        str | None, typer.Option("--frame", help="Frame of the positions. Default: the root of the log's transforms.")
    ] = None,
    fields: Fields = None,
    origin: Annotated[
        str | None, typer.Option("--origin", help="Latitude,longitude of the origin, for satellite fixes.")
    ] = None,
    labels: Annotated[str | None, typer.Option("--labels", help="Classes to read, such as car|truck.")] = None,
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, help="Processes. Default: one, or of many logs one per core.")
    ] = None,
    scheduler: Scheduler = None,
) -> int:
    """Add logs to a store, which is made if it is not there; logs that it knows are skipped.

    How logs are read is fixed when the store is made. One log that cannot be read does not stop the others.

    Example: dirprim store add fleet recordings/roundabout_learn.mcap
    """
    from dirprim_filter.cli.progress import step_progress
    from dirprim_filter.store.adding import add_logs, failures
    from dirprim_filter.store.log_files import find_logs
    from dirprim_filter.store.workers import workers_for

    given = {
        "topics": topics, "time_source": time_source and time_source.value, "frame": frame, "fields": fields,
        "origin": origin, "labels": labels,
    }  # fmt: skip
    found = find_logs(logs)
    into = _opened_or_made(folder, {name: value for name, value in given.items() if value is not None})
    with step_progress(f"adding to {into.path}", "logs") as progress:
        added = add_logs(into, found, workers=workers_for(len(found), workers, scheduler), progress=progress)
    for line in failures(added):
        typer.echo(f"error: {line}", err=True)
    entries = [receipt.entry for receipt in added.receipts if receipt.entry is not None]
    typer.echo(
        f"{into.path}: added {counted(len(entries), 'log')}, {counted(sum(e.n_rows for e in entries), 'row')}; "
        f"{added.known} known, {len(added.receipts) - len(entries)} failed"
    )
    if len(entries) < len(added.receipts):
        return FAILED
    return losses.INPUT_LOST if any(entry.status == "damaged" for entry in entries) else losses.DONE


def _opened_or_made(folder: Path, given: dict[str, object]) -> Store:
    from dirprim_filter.recording.errors import RecordingError
    from dirprim_filter.store.config import StoreConfig
    from dirprim_filter.store.store import Store

    if not Store.is_at(folder):
        config: StoreConfig = replace(StoreConfig(), **given)  # type: ignore[arg-type]
        _ = config.reading  # that it can be read so is asked before anything is made
        try:
            return Store.create(folder, config)
        except RecordingError:
            if not Store.is_at(folder):  # nor has another process made it by now
                raise
    found = Store.open(folder)
    found.check_config(replace(found.config, **given))  # type: ignore[arg-type]
    return found


def info(
    folder: Folder,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object.")] = False,
) -> None:
    """List the logs of a store, and how they are read and counted.

    Example: dirprim store info fleet
    """
    from dirprim_filter.store.store import Store

    there = Store.open(folder)
    entries, archives = there.entries(), there.archives()
    recordings = {entry.rows: entry for entry in entries}
    sizes = there.recording_sizes()
    size = sum(sizes[rows] for rows in there.rows())
    n_rows = sum(entry.n_rows for entry in recordings.values())
    if as_json:
        about = {
            "config": there.config.to_json(), "frame": there.frame, "recordings": len(recordings), "rows": n_rows,
            "bytes": size, "logs": [asdict(entry) for entry in entries],
            "archives": [asdict(archive) for archive in archives],
        }  # fmt: skip
        typer.echo(json.dumps(about))
        return
    typer.echo(
        f"{there.path}: {counted(len(entries), 'log')} of {counted(len(recordings), 'recording')}, "
        f"{counted(n_rows, 'row')}, {counted(sum(e.n_vehicles for e in recordings.values()), 'vehicle')}, "
        f"{size} bytes ({size / max(n_rows, 1):.1f} a row), frame {there.frame!r}"
    )
    for archive in archives:
        typer.echo(
            f"  {archive.month}: {counted(len(archive.recordings), 'recording')} made one, {archive.share:.3g} of the "
            "vehicles kept"
        )
    for entry in entries:
        typer.echo(_line(entry))


def _line(entry: Entry) -> str:
    seconds = (entry.end_ns - entry.start_ns) * 1e-9
    said = f"  {entry.url}: {counted(entry.n_rows, 'row')}, {counted(entry.n_vehicles, 'vehicle')}, {seconds:.0f} s"
    return said + (", damaged" if entry.status == "damaged" else "")


def forget(
    folder: Folder,
    logs: Annotated[list[str], typer.Argument(metavar="LOG...", help="As `dirprim store info` lists them, or paths.")],
) -> None:
    """Take logs out of a store: maps learned from it afterwards are as if they had never been added.

    Example: dirprim store forget fleet recordings/roundabout_learn.mcap
    """
    from dirprim_filter.store.log_files import url_of
    from dirprim_filter.store.store import Store

    there = Store.open(folder)
    for entry in there.forget(*map(url_of, logs)):
        typer.echo(f"{there.path}: forgot {entry.url}, {counted(entry.n_rows, 'row')}")


def merge(
    folder: Folder,
    others: Annotated[list[Path], typer.Argument(metavar="OTHER...", help="Stores whose recordings to add.")],
) -> None:
    """Add the recordings of other stores; what both hold counts once.

    Example: dirprim store merge fleet other-fleet
    """
    from dirprim_filter.store.store import Store

    sources = [Store.open(path) for path in others]
    into = Store.open(folder) if Store.is_at(folder) else Store.create(folder, sources[0].config)
    for source in sources:
        into.check_config(source.config)
    n = sum(into.merge(source) for source in sources)
    typer.echo(f"{into.path}: {counted(n, 'log')} new, {len(into.entries())} in all")


def compact(
    folder: Folder,
    before: Annotated[
        str | None, typer.Option(help="A time such as 2026-08-01: months that ended by then. Default: the last log's.")
    ] = None,
    vehicles: Annotated[
        int | None, typer.Option(min=1, help="Kept of a month where a vehicle is, on average. Default: 35.")
    ] = None,
) -> None:
    """Make one file of each month that is over, with a share of its vehicles, drawn evenly.

    What a store takes then grows with its roads and months, not with its vehicles. Single logs of these months can be
    taken out no more.

    Example: dirprim store compact fleet --before 2026-08-01
    """
    from dirprim_filter.cli.progress import step_progress
    from dirprim_filter.store.compacting import VEHICLES, compacted
    from dirprim_filter.store.store import Store

    there = Store.open(folder)
    with step_progress(f"compacting {there.path}", "months") as progress:
        made = compacted(there, before_ns=time_ns(before), n_vehicles=vehicles or VEHICLES, progress=progress)
    sizes = there.recording_sizes() if made else {}
    for archive in made:
        size = sizes[archive.name]
        typer.echo(f"{there.path}: {archive.month}, {counted(len(archive.recordings), 'recording')} in {size} bytes")
    if not made:
        typer.echo(f"{there.path}: nothing to make one of, for no other month is over")


for command in (add, store_maps.learn, store_maps.update, info, forget, merge, compact):
    store.command()(checked(command))
