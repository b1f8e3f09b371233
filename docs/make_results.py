"""Runs the tables of `results.md` and writes the page: `python docs/make_results.py [TABLE...]`.

Left out, every table is run; TABLE/RUN is one run of it, `--page` runs nothing, `--list` tells what there is and how
long it takes. What a run reached stands in `results/TABLE.json` with its command, commit, date and versions; the text
around the tables in `results/page.md`. A run whose data are absent is skipped; one that fails, or takes longer than its
table allows, keeps its former figures. Where the code that a run is about has changed since, the page says so.
"""

from __future__ import annotations

import argparse
import json
import platform
import re
import resource
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from result_tables import LOGS, TABLES, Column, Run, Table

DOCS = Path(__file__).parent
ROOT = DOCS.parent
PAGE, STORE, TEXT = DOCS / "results.md", DOCS / "results", DOCS / "results" / "page.md"
DATA = ROOT.parent / "shared" / "data"
PACKAGES = ("dirprim-filter", "numpy", "scipy", "numba")
LIST = re.compile(r"\[(?:[^\[\]{}]|\[[^\[\]]*\])*\]")
"""With lists in it: a line of the stored figures."""
PLACE = re.compile(r"^\{\{(\w+)\}\}$", flags=re.MULTILINE)
Record = dict[str, Any]
"""What a run reached, as it is stored."""


# Runs ----------------------------------------------------------------------------------------------------------------


def command_of(table: Table, run: Run) -> str:
    """The command as the page shows it."""
    return table.command.format(logs=" ".join(run.logs), options=run.options)


def logs_of(command: str) -> list[str]:
    """The logs that a command reads, and those that these are made of, in the order in which they are made."""
    named = [name for name in LOGS if name in command.split()]
    return list(dict.fromkeys(name for log in named for name in (*logs_of(LOGS[log].command), log)))


def absent(command: str, data: Path) -> list[str]:
    """Files of the data that a command needs and that are not there."""
    sources = [LOGS[name].source for name in logs_of(command)]
    return [source for source in sources if source and not (data / source).exists()]


def call(command: str, folder: Path, *, minutes: float) -> str:
    """What a command of ours prints, run in a folder.

    Raises:
        RuntimeError: it failed, or took too long.
    """
    program, *arguments = shlex.split(command)
    ours = ["-m", "dirprim_filter.cli"] if program == "dirprim" else []
    if program == "python":
        arguments[0] = str(ROOT / arguments[0])
    try:
        done = subprocess.run(  # noqa: S603  commands of this repository
            [sys.executable, *ours, *arguments], cwd=folder, capture_output=True, text=True, check=False,
            timeout=60 * minutes,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"stopped after {minutes:g} minutes: {command}") from None
    if done.returncode not in {0, 3}:  # 3: done, with rows that could not be read
        said = done.stderr.strip().splitlines()[-1:] or ["nothing said"]
        raise RuntimeError(f"ended with {done.returncode}, {said[0]}: {command}")
    return done.stdout


def measure(table: Table, run: Run, folder: Path, data: Path, *, minutes: float) -> Record:
    """Make the logs, run the command, keep its figures; each command may take so long."""
    command = command_of(table, run)
    for name in logs_of(command):
        if not (folder / name).exists():
            call(LOGS[name].command.format(data=data.resolve(), log=name), folder, minutes=minutes)
    commit, code = commit_at_hand(), code_of(table)  # as the run begins
    began, used = time.perf_counter(), processor_seconds()
    output = call(command, folder, minutes=minutes)
    entries = (run.entries or table.entries)(output)
    return {
        "command": command,
        "commit": commit,
        "date": datetime.now(UTC).date().isoformat(),
        "seconds": round(time.perf_counter() - began),
        "processor_seconds": round(processor_seconds() - used),
        "versions": {"python": platform.python_version()} | {name: version(name) for name in PACKAGES},
        "code": code,
        "changed": "",
        "figures": {
            name: [rounded(column.read(entry)) for column in table.columns] for name, entry in entries.items()
        },
    }  # fmt: skip


def processor_seconds() -> float:
    """Of the commands so far: what they take on a machine that does nothing else, but for what runs side by side."""
    taken = resource.getrusage(resource.RUSAGE_CHILDREN)
    return taken.ru_utime + taken.ru_stime


def rounded(figure: Any) -> Any:
    """To six digits: what is stored is to be read."""
    if isinstance(figure, list):
        return [rounded(number) for number in figure]
    return figure if figure is None else float(f"{figure:.6g}")


# The code that figures are about -------------------------------------------------------------------------------------


def git(*arguments: str) -> str:
    """What git says of this repository."""
    return subprocess.run(  # noqa: S603
        ["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True  # noqa: S607
    ).stdout.strip()  # fmt: skip


def commit_at_hand() -> str:
    """Its short name; marked as not clean if anything but results that were stored meanwhile differs from it."""
    others = git("status", "--porcelain", "--untracked-files=no", "--", ".", ":!docs/results", ":!docs/results.md")
    return git("rev-parse", "--short", "HEAD") + ("-dirty" if others else "")


def code_of(table: Table) -> dict[str, str]:
    """What git calls the contents of each file and folder of the table's code: it outlives a rebase.

    Nothing where the code is not committed: then it is no one's.
    """
    if git("status", "--porcelain", "--untracked-files=no", "--", *table.code):
        return {}
    return {path: git("rev-parse", "--short", f"HEAD:{path}") for path in table.code}


def changed(table: Table, record: Record) -> str:
    """The last commit that touched the code, if the code is not that of the record; else nothing."""
    return (
        ""
        if record["code"] and code_of(table) == record["code"]
        else git("log", "-1", "--format=%h of %cs", "--", *table.code)
    )


# What is stored ------------------------------------------------------------------------------------------------------


def stored(name: str) -> dict[str, Record]:
    """The records of a table's runs, by their names."""
    path = STORE / f"{name}.json"
    return dict(json.loads(path.read_text())) if path.exists() else {}


def store(name: str, records: dict[str, Record]) -> None:
    """Write them, in the order of the runs."""
    ordered = {run.name: records[run.name] for run in TABLES[name].runs if run.name in records}
    if ordered:
        text = LIST.sub(lambda found: json.dumps(json.loads(found[0])), json.dumps(ordered, indent=1))
        (STORE / f"{name}.json").write_text(text + "\n")


# The page ------------------------------------------------------------------------------------------------------------


def page() -> str:
    """The page: the text, and each table in its place."""
    return PLACE.sub(lambda found: "\n".join(_logs() if found[1] == "logs" else _shown(found[1])), TEXT.read_text())


def _logs() -> Iterator[str]:
    yield from ("| log | what it is | made by |", "|---|---|---|")
    for name, log in LOGS.items():
        if log.about:
            made = log.command.format(data="DATA", log=name)
            yield f"| `{name}` | {log.about} | `{made}` |"


def _shown(name: str) -> Iterator[str]:
    table, records = TABLES[name], stored(name)
    if not records:
        yield "Not yet measured."
        return
    heads = ("", table.of, *(column.head for column in table.columns))
    yield f"| {' | '.join(heads)} |"
    yield "|" + "---|" * len(heads)
    for run, record in records.items():
        rows = [
            _cells(table.columns, figures, list(record["figures"].values())) for figures in record["figures"].values()
        ]
        for i, (row, cells) in enumerate(zip(record["figures"], rows, strict=True)):
            yield f"| {run if i == 0 else ''} | {row} | {' | '.join(cells)} |"
    yield ""
    yield from _provenance(records)


def _cells(columns: tuple[Column, ...], figures: list[Any], beside: list[list[Any]]) -> Iterator[str]:
    """A row's figures, the best of each column, or of the row, in bold."""
    for i, column in enumerate(columns):
        rivals = figures if column.best == "row" else [row[i] for row in beside]
        known = [first for first in map(_first, rivals) if first is not None]
        own = _first(figures[i])
        text = "" if own is None else f"{own:,.{column.digits}f}"
        if own is not None and column.best and len(known) > 1:
            best = min(known) if column.best == "low" else max(known)
            text = f"**{text}**" if own == best else text
        if isinstance(figures[i], list) and len(figures[i]) > 1 and own is not None:
            text += column.beside.format(f"{figures[i][1]:,.{column.digits}f}")
        yield text


def _first(figure: Any) -> float | None:
    return figure[0] if isinstance(figure, list) else figure


def _provenance(records: dict[str, Record]) -> Iterator[str]:
    """Each command, when and on which commit it ran, how long it took, and whether its code has changed since."""
    for run, record in records.items():
        since = f"; **older than its code**, which {record['changed']} changed" if record["changed"] else ""
        taken = f", {record['seconds']:,} s" if record["seconds"] else ""  # unknown of figures from before this script
        taken += f" ({record['processor_seconds']:,} s of the processor)" if record.get("processor_seconds") else ""
        yield f"- {run}: `{record['command']}`, {record['date']}, commit {record['commit']}{taken}{since}"


# The command line ----------------------------------------------------------------------------------------------------


def chosen(asked: list[str]) -> Iterator[tuple[str, Run]]:
    """Tables and their runs, by `TABLE` or `TABLE/RUN`; of nothing asked, all.

    Raises:
        SystemExit: there is no such table or run.
    """
    for one in asked or TABLES:
        name, _, run = one.partition("/")
        runs = [each for each in TABLES[name].runs if run in {"", each.name}] if name in TABLES else []
        if not runs:
            raise SystemExit(f"{one}: expected one of {', '.join(TABLES)}, or TABLE/RUN")
        yield from ((name, each) for each in runs)


def run_tables(asked: list[str], data: Path, *, patience: float = 1.0) -> bool:
    """Run what is asked for, and store it; whether all of it went well."""
    well = True
    with tempfile.TemporaryDirectory(prefix="dirprim-results-") as folder:
        for name, run in chosen(asked):
            missing = absent(command_of(TABLES[name], run), data)
            if missing:
                say(f"{name}/{run.name}: skipped, no {data / missing[0]}")
                continue
            try:
                minutes = patience * TABLES[name].minutes
                record = measure(TABLES[name], run, Path(folder), data, minutes=minutes)
            except (RuntimeError, ValueError, KeyError) as error:
                say(f"{name}/{run.name}: {error}; its former figures stay")
                well = False
                continue
            store(name, stored(name) | {run.name: record})
            say(f"{name}/{run.name}: {record['seconds']} s")
    return well


def say(line: str) -> None:
    """To whoever waits."""
    sys.stderr.write(line + "\n")


def main() -> int:
    """Run, mark what is older than its code, write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tables", nargs="*", metavar="TABLE")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the data; default: %(default)s")
    parser.add_argument("--patience", type=float, default=1.0, help="times what a run may take; for a busy machine")
    parser.add_argument("--page", action="store_true", help="only write the page")
    parser.add_argument("--list", action="store_true", help="only tell the tables, and how long each may take")
    given = parser.parse_args()
    if given.list:
        for name, table in TABLES.items():
            taken = sum(record.get("processor_seconds", 0) for record in stored(name).values())
            say(f"{name}: took {taken / 60:.0f} min of the processor, may take {table.minutes * len(table.runs):g} min")
            say("".join(f"    {name}/{run.name}\n" for run in table.runs).rstrip())
        return 0
    well = given.page or run_tables(given.tables, given.data, patience=given.patience)
    for name, table in TABLES.items():
        records = {run: record | {"changed": changed(table, record)} for run, record in stored(name).items()}
        store(name, records)
        for run, record in records.items():
            if record["changed"]:
                say(f"{name}/{run}: older than its code, which {record['changed']} changed")
    PAGE.write_text(page())
    return 0 if well else 1


if __name__ == "__main__":
    sys.exit(main())
