"""What a command tells of input that was lost, and the exit code that says so."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from dirprim_filter.recording.damage import Damage

DONE, INPUT_LOST = 0, 3


def exit_code(damage: Sequence[Damage], n_dropped: int = 0) -> int:
    """3 where a part of the input could not be read or used; the library's log has said what."""
    return INPUT_LOST if damage or n_dropped else DONE


def tell_dropped(source: Path, dropped: Mapping[str, int]) -> int:
    """One line on stderr for each reason why rows were dropped; -> the exit code."""
    for reason, count in dropped.items():
        typer.echo(f"{source}: dropped {count} rows: {reason}", err=True)
    return INPUT_LOST if any(dropped.values()) else DONE
