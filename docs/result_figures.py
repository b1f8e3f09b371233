"""How the tables of `results.md` read their figures: first a command's output as rows, then figures of a row."""

from __future__ import annotations

import json
import re
import statistics
from collections.abc import Callable, Iterable, Mapping
from typing import Any

Figure = float | list[float | None] | None
"""A number, or a number and what stands beside it."""
Entries = Callable[[str], Mapping[str, Any]]
"""The output of a command as the table's rows: each row's name, and what its figures are read from."""


def methods(output: str) -> dict[str, Any]:
    """The methods of an `evaluate` command's JSON, each with that of the last, by which it may be divided."""
    methods = json.loads(output)["methods"]
    return {method["name"]: method | {"last": methods[-1]} for method in methods}


def quantities(output: str) -> dict[str, Any]:
    """Directions and speeds of `evaluate density`, all methods of each."""
    methods = json.loads(output)["methods"]
    return {
        name: {method["name"]: method[name] for method in methods if method[name]}
        for name in ("direction", "speed", "joint")
    }


def observations(output: str) -> dict[str, Any]:
    """The two observations of `evaluate cues`, each with the prior."""
    table = json.loads(output)["table"]
    return {
        name: table[key] | {"prior": table["prior"]}
        for name, key in (("cell before", "cell_before"), ("own course", "own_course"))
    }


def of_key(*names: str) -> Callable[[Any], Figure]:
    """A figure by the keys that lead to it."""

    def read(entry: Any) -> Figure:
        for name in names:
            entry = entry[name]
        return None if entry is None else float(entry)

    return read


def rows_of(output: str) -> dict[str, Any]:
    """Rows of a benchmark's JSON, by their names."""
    return dict(json.loads(output)["rows"])


def mean_of(figure: str) -> Callable[[Any], Figure]:
    """A figure of a tracking method: mean and deviation of the seeds that have it."""

    def read(method: Any) -> Figure:
        return _mean_and_deviation(report[figure] for report in method["reports"])

    return read


def most_in_a_group(figure: str) -> Callable[[Any], Figure]:
    """The greatest of the groups of all seeds."""
    return lambda method: max(report[figure] for seed in method["by_group"] for report in seed)


def coverages(method: Any) -> Figure:
    """The least and the greatest share of the truth in the 90 % region, over the horizons."""
    shares = [horizon["coverage_90"] for horizon in method["horizons"]]
    return [min(shares), max(shares)]


def energy(horizon_s: float, *, to_last: bool) -> Callable[[Any], Figure]:
    """The energy score at a horizon: with its standard error, or over that of the last method."""

    def read(method: Any) -> Figure:
        own, last = (
            next((h for h in of["horizons"] if h["horizon_s"] == horizon_s), None) for of in (method, method["last"])
        )
        if own is None or last is None:
            return None
        return own["energy"] / last["energy"] if to_last else [own["energy"], own["energy_se"]]

    return read


def density(method: str) -> Callable[[Any], Figure]:
    """Mean density, and mean log density."""
    return lambda entry: [entry[method]["mean"], entry[method]["mean_log"]] if method in entry else None


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


def _mean_and_deviation(values: Iterable[float | None]) -> Figure:
    known = [value for value in values if value is not None]
    if not known:
        return None
    return [statistics.fmean(known), statistics.stdev(known)] if len(known) > 1 else known[0]
