"""A place on the command line: its forms, and whether the map covers it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from dirprim_filter.primitives import PrimitiveMap

OPTION = "--at"
EITHER_WAY = f"metres east and north: {OPTION} 3 17 or {OPTION} 3,17"
"""What the help of the option says."""
PAIR = re.compile(rf"(?:{OPTION}=)?\s*([^\s,]+)\s*,\s*([^\s,]+)\s*")


def pairs_apart(arguments: Sequence[str]) -> Iterator[str]:
    """The same arguments, where `--at 3,17` and `--at=3,17` have become `--at 3 17`."""
    before = ""
    for argument in arguments:
        is_joined = argument.startswith(f"{OPTION}=")
        pair = PAIR.fullmatch(argument) if before == OPTION or is_joined else None
        if pair is None:
            yield argument
        else:
            yield from (OPTION, *pair.groups()) if is_joined else pair.groups()
        before = argument


def tell_if_outside(learned: PrimitiveMap, at: tuple[float, float]) -> None:
    """On stderr, that no cell of the map covers a place, and how far the map is."""
    import numpy as np

    from tessellation import OUTSIDE

    cells = learned.tessellation
    if cells.cell_of(np.array(at)) != OUTSIDE:
        return
    warning = f"({at[0]:g}, {at[1]:g}) is outside of every cell of the map"
    if cells.n_cells:
        nearest = float(np.hypot(*(cells.centers - at).T).min())
        warning += f", {nearest:.0f} m from the centre of the nearest"
    typer.echo(f"{warning}: the background model answers", err=True)
