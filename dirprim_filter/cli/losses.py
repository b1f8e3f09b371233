"""Reports of lost input, and the exit code for it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from dirprim_filter.cli.counts import counted

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from dirprim_filter.recording.container.damage import Damage
    from dirprim_filter.recording.tables import Table

DONE, INPUT_LOST = 0, 3


def exit_code(damage: Sequence[Damage], n_lost: int = 0) -> int:
    """3 where a part of the input could not be read or used; the library's log has said what."""
    return INPUT_LOST if damage or n_lost else DONE


def tell_dropped(source: Path, table: Table) -> int:
    """One line on stderr for each reason why rows of a table were dropped; -> the exit code."""
    for reason, count in table.dropped.items():
        typer.echo(f"{source}: dropped {counted(count, 'row')}: {reason}", err=True)
    return INPUT_LOST if table.n_lost else DONE
