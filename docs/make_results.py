"""Runs the tables of `results.md` and writes the page: `python docs/make_results.py [TABLE...] [--all]`.

TABLE/RUN is one run of a table, `--all` is every run that has no figures of this very commit yet, so that it may be
resumed; without either only the page is written, and README's two tables. What a run reached stands in
`results/TABLE.json` with its command, commit, date and versions; the text around the tables in `results/page.md`. A run
whose data are absent is skipped; one that fails, or takes longer than its table allows, keeps its former figures.
"""

from __future__ import annotations

import argparse
import json
import math
import platform
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from result_figures import shown
from result_tables import GROUNDS, LOGS, OURS, PACKAGES_BESIDE, PLACES, SUMMARY, TABLES, Run, Table

DOCS = Path(__file__).parent
ROOT = DOCS.parent
PAGE, STORE, TEXT = DOCS / "results.md", DOCS / "results", DOCS / "results" / "page.md"
README = ROOT / "README.md"
DATA = ROOT.parent / "shared" / "data"
PACKAGES = ("dirprim-filter", "numpy", "scipy", "numba")
LIST = re.compile(r"\[(?:[^\[\]{}]|\[[^\[\]]*\])*\]|\{[^\[\]{}]*\}")
"""With lists in it, or an object of numbers: a line of the stored figures."""
MADE = re.compile(r"(<!-- made: (\w+) -->\n).*?(<!-- end -->)", flags=re.DOTALL)
"""A table of README, which is written between two comments."""
PLACE = re.compile(r"^\{\{(\w+)\}\}$", flags=re.MULTILINE)
Record = dict[str, Any]
"""What a run reached, as it is stored."""


def command_of(table: Table, run: Run) -> str:
    """The command as the page shows it."""
    return table.command.format(logs=" ".join(run.logs), options=run.options).strip()


def logs_of(command: str) -> list[str]:
    """The logs that a command reads, and those that these are made of, in the order in which they are made."""
    named = [name for name in LOGS if name in command.split()]
    return list(dict.fromkeys(name for log in named for name in (*logs_of(LOGS[log].command), log)))


def absent(command: str, run: Run, data: Path) -> list[str]:
    """Files of the data that a command needs and that are not there."""
    sources = [*(LOGS[name].source for name in logs_of(command)), run.source]
    return [source for source in sources if source and not (data / source).exists()]


def call(command: str, folder: Path, *, minutes: float) -> str:
    """What a command of ours prints, run in a folder.

    Raises:
        RuntimeError: it failed, or took too long.
    """
    program, *arguments = shlex.split(command)
    ours = ["-m", "dirprim_filter"] if program == "dirprim" else []
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
        last = done.stderr.strip().splitlines()[-1:] or ["no output"]
        raise RuntimeError(f"ended with {done.returncode}, {last[0]}: {command}")
    return done.stdout


def measure(table: Table, run: Run, folder: Path) -> Record:
    """Run the command of a table and keep its figures; its logs are there."""
    command, commit = command_of(table, run), commit_at_hand()
    output = call(command, folder, minutes=table.minutes)
    entries = (run.entries or table.entries)(output)
    return {
        "command": command,
        "commit": commit,
        "date": datetime.now(UTC).date().isoformat(),
        "versions": {"python": platform.python_version()} | {name: version(name) for name in PACKAGES},
        "figures": {
            name: [rounded(column.read(entry)) for column in table.columns] for name, entry in entries.items()
        },
        "settings": [rounded(setting) for setting in settings_of(json.loads(output))] if "--json" in command else [],
    }  # fmt: skip


def settings_of(output: Any) -> list[dict[str, Any]]:
    """What was chosen for rivals, and between which values, wherever a command's JSON has it."""
    if isinstance(output, dict) and {"low", "chosen", "high"} <= output.keys():
        return [output]
    inner = output.values() if isinstance(output, dict) else output if isinstance(output, list) else ()
    return [setting for part in inner for setting in settings_of(part)]


def rounded(figure: Any) -> Any:
    """To six digits: what is stored is to be read."""
    if isinstance(figure, dict):
        return {name: rounded(number) for name, number in figure.items()}
    if isinstance(figure, list):
        return [rounded(number) for number in figure]
    if isinstance(figure, float):
        return float(f"{figure:.6g}") if math.isfinite(figure) else None
    return figure


def commit_at_hand() -> str:
    """Its short name; marked as not clean if anything but documents differs from it, which a run writes."""
    git = ["git", "-C", str(ROOT)]
    status = [*git, "status", "--porcelain", "--untracked-files=no", "--", ".", ":!docs", ":!README.md"]
    others = subprocess.run(status, capture_output=True, text=True, check=True).stdout  # noqa: S603
    name = subprocess.run([*git, "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True).stdout  # noqa: S603
    return name.strip() + ("-dirty" if others.strip() else "")


def stored(name: str) -> dict[str, Record]:
    """The records of a table's runs, by their names."""
    path = STORE / f"{name}.json"
    return dict(json.loads(path.read_text())) if path.exists() else {}


def store(name: str, records: dict[str, Record]) -> None:
    """Write them, in the order of the runs."""
    ordered = {run.name: records[run.name] for run in TABLES[name].runs if run.name in records}
    text = LIST.sub(lambda found: json.dumps(json.loads(found[0])), json.dumps(ordered, indent=1))
    (STORE / f"{name}.json").write_text(text + "\n")


def page() -> str:
    """The page: the text, and each table in its place."""
    own = {"summary": _summary, "logs": _logs}
    return PLACE.sub(
        lambda found: "\n".join(own[found[1]]() if found[1] in own else _table(found[1])), TEXT.read_text()
    )


def readme() -> str:
    """README, with its tables as they are measured now."""
    own = {"grounds": _grounds, "packages": _packages}
    return MADE.sub(lambda found: "\n".join([found[1].strip(), "", *own[found[2]](), "", found[3]]), README.read_text())


def _figure(table: str, run: str, row: str, head: str) -> Any:
    """One that is stored; None where it is not measured."""
    figures = stored(table).get(run, {}).get("figures", {}).get(row)
    return None if figures is None else figures[[of.head for of in TABLES[table].columns].index(head)]


def _grounds() -> Iterator[str]:
    """Ours beside a rival on one ground after the other; those that are not measured are left out."""
    yield from _head("where", "what", "ours", "beside it", "ours is better by")
    for row in GROUNDS:
        mine, theirs = (_figure(row.table, row.run, of, row.column) for of in (row.ours, row.rival))
        gain = _figure(row.table, row.run, row.rival, row.gain)
        if mine is not None and theirs is not None:
            better = f"{shown(gain, row.digits if row.unit != ' m' else 0)}{' %' * (row.unit == ' m')}" if gain else ""
            if better and "**" not in better:
                better += " (not distinguishable)"
            yield _line(
                row.where, row.what, f"{shown(mine, row.digits)}{row.unit}",
                f"{row.called} {shown(theirs, row.digits)}{row.unit}", better,
            )  # fmt: skip


def _packages() -> Iterator[str]:
    """HOTA in percent of ours and of other packages; a place that is not measured is left out."""
    places = [place for place in PLACES if place.run in stored(place.table)]
    yield from _head("HOTA, %", *(place.head for place in places), "better at")
    for called, name, better_at in PACKAGES_BESIDE:
        cells = []
        for place in places:
            row = place.row.format(OURS.get(name, name) if place.table == "peers" else name)
            hota = _figure(place.table, place.run, row, "HOTA")
            cells.append(shown(hota and place.times * hota, 1))
        yield _line(called, *cells, better_at)


def _summary() -> Iterator[str]:
    """What the map gains on one question after the other; those that are not measured are left out."""
    yield from _head("question", "where", "against", "the map gains")
    for what, unit, table, run, row, column in SUMMARY:
        if (figure := _figure(table, run, row, column)) is not None:
            (digits,) = (of.digits for of in TABLES[table].columns if of.head == column)
            found = shown(figure, digits)
            name = row.rpartition(": ")[2]
            yield _line(what, run, name, f"{found}{unit}")


def _logs() -> Iterator[str]:
    for name, log in LOGS.items():
        if log.about:
            yield f"- `{log.command.format(data='DATA', log=name)}`: {log.about}"


def _table(name: str) -> Iterator[str]:
    table, records = TABLES[name], stored(name)
    if not records:
        yield "Not yet measured."
        return
    layout = _by_method if table.beside else _by_run if table.blocks else _by_figure
    yield from layout(table, records)
    of_commit: dict[str, list[str]] = {}
    for run, record in records.items():
        of_commit.setdefault(f"{record['commit']} ({record['date']})", []).append(run)
    commits = next(iter(of_commit)) if len(of_commit) == 1 else "; ".join(
        f"{commit} {', '.join(runs)}" for commit, runs in of_commit.items()
    )  # fmt: skip
    yield f"\n`{table.command.format(logs='LOG', options='OPTIONS').strip()}`, {commits}"


def _line(*cells: str) -> str:
    return f"|{'|'.join(cells)}|"


def _head(*cells: str) -> tuple[str, str]:
    return _line(*cells), _line(*["---"] * len(cells))


def _rows(table: Table, record: Record) -> dict[str, list[Any]]:
    """The figures that the page shows, by the names that it gives them."""
    named = {}
    for row, figures in record["figures"].items():
        shown_as = row
        for pattern, name in table.renamed:
            shown_as = re.sub(pattern, name, shown_as)
        if shown_as:
            named[shown_as] = figures
    return named


def _by_figure(table: Table, records: dict[str, Record]) -> Iterator[str]:
    """A column for each figure, run after run."""
    found = {run: _rows(table, record) for run, record in records.items()}
    runs = [""] * (len(found) > 1 and not all(row.startswith(run) for run, rows in found.items() for row in rows))
    yield from _head(*runs, table.of, *(column.head for column in table.columns))
    for run, rows in found.items():
        for i, (row, figures) in enumerate(rows.items()):
            cells = [shown(figure, column.digits) for figure, column in zip(figures, table.columns, strict=True)]
            yield _line(*("" if i else run for _ in runs), row, *cells)


def _by_run(table: Table, records: dict[str, Record]) -> Iterator[str]:
    """A block for some figures, with a column for each run."""
    found = [_rows(table, record) for record in records.values()]
    for caption, columns in table.blocks:
        yield from _head(caption, *records)
        for row in dict.fromkeys(row for rows in found for row in rows):
            cells = [_joined(rows.get(row), table, columns) for rows in found]
            if any(cells):
                yield _line(row, *cells)
        yield ""


def _by_method(table: Table, records: dict[str, Record]) -> Iterator[str]:
    """A block for some figures, with a column for each method: a row is named by the cells before, then `: METHOD`."""
    rows: dict[str, dict[str, list[Any]]] = {}
    for run, record in records.items():
        for name, figures in _rows(table, record).items():
            case, _, method = name.rpartition(": ")
            rows.setdefault(f"{run}|{case}", {})[method] = figures
    methods = list(dict.fromkeys(method for by_method in rows.values() for method in by_method))
    for caption, columns in table.blocks:
        yield f"{caption}:\n"
        yield from _head("", *table.of.split("|"), *methods)
        for case, by_method in rows.items():
            cells = [_joined(by_method.get(method), table, columns).rstrip("/") for method in methods]
            if any(cells):
                yield _line(case, *cells)
        yield ""


def _joined(figures: list[Any] | None, table: Table, columns: tuple[int, ...]) -> str:
    cells = [shown(figures[i], table.columns[i].digits) for i in columns] if figures else []
    return "/".join(cells) if any(cells) else ""


def chosen(asked: list[str]) -> Iterator[tuple[str, Run]]:
    """Tables and their runs, by `TABLE` or `TABLE/RUN`.

    Raises:
        SystemExit: there is no such table or run.
    """
    for one in asked:
        name, _, run = one.partition("/")
        runs = [each for each in TABLES[name].runs if run in {"", each.name}] if name in TABLES else []
        if not runs:
            raise SystemExit(f"{one}: expected one of {', '.join(TABLES)}, or TABLE/RUN")
        yield from ((name, each) for each in runs)


def run_tables(asked: list[str], data: Path, *, only_new: bool = False) -> bool:
    """Run what is asked for, and store it; whether all of it went well."""
    commit = commit_at_hand()
    with tempfile.TemporaryDirectory(prefix="dirprim-results-") as name:
        folder, wanted = Path(name), []
        for table, run in chosen(asked):
            missing = absent(command_of(TABLES[table], run), run, data)
            if missing:
                say(f"{table}/{run.name}: skipped, no {data / missing[0]}")
            elif not (only_new and stored(table).get(run.name, {}).get("commit") == commit):
                wanted.append((table, run))
        for log in dict.fromkeys(log for table, run in wanted for log in logs_of(command_of(TABLES[table], run))):
            call(LOGS[log].command.format(data=data.resolve(), log=log), folder, minutes=10)

        well = True
        for table, run in wanted:
            try:
                record = measure(TABLES[table], run, folder)
            except (RuntimeError, ValueError, KeyError) as error:
                say(f"{table}/{run.name}: {error!r}; its former figures stay")
                well = False
                continue
            store(table, stored(table) | {run.name: record})
            say(f"{table}/{run.name}: done")
    return well


def say(line: str) -> None:
    """To whoever waits."""
    sys.stderr.write(line + "\n")


def main() -> int:
    """Run what is asked for, write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tables", nargs="*", metavar="TABLE", help=", ".join(TABLES))
    parser.add_argument("--all", action="store_true", help="every run that this commit has no figures of")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the data; default: %(default)s")
    given = parser.parse_args()
    asked = list(TABLES) if given.all else given.tables
    well = run_tables(asked, given.data, only_new=given.all)
    PAGE.write_text(page())
    README.write_text(readme())
    return 0 if well else 1


if __name__ == "__main__":
    sys.exit(main())
