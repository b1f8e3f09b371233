"""How the tables of `results.md` read their figures: first a command's output as rows, then figures of a row."""

from __future__ import annotations

import json
import re
import statistics
from collections.abc import Callable, Mapping
from typing import Any

Figure = float | dict[str, float | None] | str | None
"""A number; a difference with its interval, `value`, `low` and `high`; a mean with its `deviation`; or a text."""
Entries = Callable[[str], Mapping[str, Any]]
"""The output of a command as the table's rows: each row's name, and what its figures are read from."""


def trackers(output: str) -> dict[str, Any]:
    """The methods of `evaluate tracking`, each with the comparison of the first to it."""
    table = json.loads(output)
    beside = {found["other"]: found for found in table["comparisons"]}
    return {method["name"]: method | {"against": beside.get(method["name"], {})} for method in table["methods"]}


def densities(output: str) -> dict[str, Any]:
    """The methods of `evaluate density`."""
    return {method["name"]: method for method in json.loads(output)["methods"]}


def forecasts(output: str) -> dict[str, Any]:
    """The methods of `evaluate forecast`, by horizon, and the least and greatest share in each region."""
    rows = {}
    for method in json.loads(output)["methods"]:
        shares = {of: [score[f"coverage_{of}"] for score in method["horizons"]] for of in ("50", "90")}
        by_horizon = {f"{score['horizon_s']:g}": score for score in method["horizons"]}
        rows[method["name"]] = {
            "energy": {horizon: score["energy"] for horizon, score in by_horizon.items()},
            "less": {horizon: score["gain"] for horizon, score in by_horizon.items()},
            "coverage": {of: f"{min(held):.2f} to {max(held):.2f}" for of, held in shares.items() if held},
        }
    return rows


def cue_rows(output: str) -> dict[str, Any]:
    """The two observations of `evaluate cues`, each with the prior."""
    table = json.loads(output)["table"]
    return {
        name: table[key] | {"prior": table["prior"]}
        for name, key in (("cell before", "cell_before"), ("own course", "own_course"))
    }


def mechanisms(output: str) -> dict[str, Any]:
    """The mechanisms of the one scene of the ablation that was run."""
    (rows,) = json.loads(output)["rows"].values()
    return dict(rows)


def changes(row: Any) -> Figure:
    """A row's difference with its interval."""
    if row.get("difference") is None:
        return None
    return {"value": row["difference"], "low": row["low"], "high": row["high"]}


def peers(output: str) -> dict[str, Any]:
    """The trackers of the one scene of `peers.py` that was run."""
    (rows,) = json.loads(output).values()
    parts = {"value": "behind", "low": "behind_low", "high": "behind_high"}
    return {name: row | {"behind": {part: row[key] for part, key in parts.items()}} for name, row in rows.items()}


def neutral(output: str) -> dict[str, Any]:
    """The methods of every table of `neutral.py`, each with what the first gains on it."""
    found: dict[str, dict[str, Any]] = {}
    for title, table in json.loads(output).items():
        where = re.sub(r" \(.*?\)", "", title.partition(":")[0])
        beside = {re.split(" against |, (?:less|more) ", of)[1]: gain for of, gain in table["gains"].items()}
        for name, row in table["rows"].items():
            found[f"{where}: {name}"] = row | {"gain": beside.get(name)}
    return found


def rows_of(output: str) -> dict[str, Any]:
    """Rows of a benchmark's JSON, by their names."""
    return dict(json.loads(output)["rows"])


def of_key(*names: str, times: float = 1.0) -> Callable[[Any], Figure]:
    """A figure by the keys that lead to it; nothing where there is none."""

    def read(entry: Any) -> Figure:
        for name in names:
            entry = entry.get(name) if isinstance(entry, Mapping) else None
        if isinstance(entry, Mapping):
            return {name: None if entry[name] is None else times * entry[name] for name in ("value", "low", "high")}
        return entry if entry is None or isinstance(entry, str) else times * float(entry)

    return read


def mean_of(figure: str) -> Callable[[Any], Figure]:
    """A figure of a tracking method: mean and deviation of the seeds that have it."""

    def read(method: Any) -> Figure:
        known = [report[figure] for report in method["reports"] if report[figure] is not None]
        if len(known) < 2:
            return known[0] if known else None
        return {"value": statistics.fmean(known), "deviation": statistics.stdev(known)}

    return read


def printed(**patterns: str) -> Entries:
    """Numbers by the patterns that find them in what is printed, each row's own."""

    def read(output: str) -> dict[str, Any]:
        found = {name: re.search(pattern, output) for name, pattern in patterns.items()}
        missing = [name for name, match in found.items() if match is None]
        if missing:
            raise ValueError(f"{missing[0]}: nothing of the kind in the output:\n{output}")
        return {name: match.groups() for name, match in found.items() if match is not None}

    return read


def group(number: int) -> Callable[[Any], Figure]:
    """A number that a pattern found."""
    return lambda groups: float(groups[number].replace(",", "")) if number < len(groups) else None


def shown(figure: Figure, digits: int) -> str:
    """A figure as the page shows it: a difference is bold where its interval does not hold 0."""
    if figure is None or isinstance(figure, str):
        return (figure or "").replace(" / ", "/").replace(" to ", "-")
    if not isinstance(figure, Mapping):
        return f"{figure:,.{digits}f}"
    value, low, high = (figure.get(name) for name in ("value", "low", "high"))
    if value is None or value == low == high:  # of a method beside itself nothing is to be said
        return ""
    if "deviation" in figure:
        return f"{value:,.{digits}f}"
    rounded = round(value, digits)
    text = f"{rounded:+,.{digits}f}" if rounded else f"{0.0:.{digits}f}"  # nought has no sign
    if low is None or high is None:
        return text
    if low > 0 or high < 0:
        text = f"**{text}**"
    return f"{text}±{0.5 * (high - low):,.{digits}f}"
