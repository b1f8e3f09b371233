"""Texts for people: counts, numbers, tables; and nothing by which a name in a log could steer the terminal."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import typer

UNKNOWN = "-"
FIGURES = {
    "rmse": "RMSE, m", "seen_rmse": "RMSE in sight, m", "hidden_rmse": "RMSE in gaps, m",
    "direction_rmse": "RMSE of course, rad", "speed_rmse": "RMSE of speed, m/s",
    "nees": "NEES", "seen_nees": "NEES in sight", "hidden_nees": "NEES in gaps",
    "coverage_90": "truth in 90 %", "hidden_coverage_90": "in 90 %, in gaps",
    "reported": "reported", "interpolated": "truth interpolated", "hota": "HOTA", "deta": "DetA", "assa": "AssA",
    "loca": "LocA", "idf1": "IDF1", "mota": "MOTA", "switches": "identity switches",
    "gospa": "GOSPA per vehicle, m",
    "localisation": "  localisation, m2", "missed": "  missed, m2", "false": "  false, m2",
}  # fmt: skip
"""The figures of a `TrackingReport`, and what tables call them."""


def counted(n: int, what: str) -> str:
    """A number and what it counts, in the plural unless it is one."""
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def number(value: float) -> str:
    """Three decimals for small numbers, none for large ones; a dash if unknown."""
    if math.isnan(value):
        return UNKNOWN
    if isinstance(value, int):
        return str(value)
    return f"{value:.3f}" if abs(value) < 100 else f"{value:.0f}"


def columns(rows: Sequence[Sequence[str]], *, n_left: int = 1) -> list[str]:
    """Rows as lines; the first columns stand to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if i < n_left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def figure_lines(names: Sequence[str], cell: Callable[[int, str], str]) -> list[str]:
    """The lines of all figures; `cell`: of a column, by its number, and a figure."""
    return columns([["", *names], *([head, *(cell(i, of) for i in range(len(names)))] for of, head in FIGURES.items())])


def say(*lines: str, err: bool = False) -> None:
    """Print lines; what a log calls its things neither breaks them nor steers the terminal."""
    from dirprim_filter.recording.container.errors import one_line

    typer.echo("\n".join(map(one_line, lines)), err=err)
