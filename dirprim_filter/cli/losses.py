"""Reports of lost input, and the exit code for it."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import typer

from dirprim_filter.cli.counts import counted

if TYPE_CHECKING:
    from pathlib import Path

    from dirprim_filter.recording.losses import Losses
    from dirprim_filter.recording.tables import Table

DONE, INPUT_LOST = 0, 3


def exit_code(losses: Losses) -> int:
    """3 where a part of the input, if one row, could not be read or used; the library's log has said what."""
    return INPUT_LOST if losses.damage or losses.dropped else DONE


@contextmanager
def said_later() -> Iterator[None]:
    """Within, warnings about a log that is read are left out: it is read once more, and they are said then."""
    logger = logging.getLogger("dirprim_filter.recording")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


def report_dropped(source: Path, table: Table) -> int:
    """One line on stderr for each reason why rows of a table were dropped; -> the exit code."""
    for reason, count in table.losses.dropped.items():
        typer.echo(f"{source}: dropped {counted(count, 'row')}: {reason}", err=True)
    return exit_code(table.losses)
