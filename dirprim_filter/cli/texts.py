"""Texts for people: counts, numbers and columns; and nothing by which a name in a log could steer the terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence

import typer

UNKNOWN = "-"


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


def say(*lines: str, err: bool = False) -> None:
    """Print lines; what a log calls its things neither breaks them nor steers the terminal."""
    from dirprim_filter.recording.container.errors import one_line

    typer.echo("\n".join(map(one_line, lines)), err=err)
