"""What every experiment ends with: its table for people or machines, its picture, its exit code."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dirprim_filter.cli import losses
from dirprim_filter.cli.reading import Reading
from dirprim_filter.cli.results import as_json, result_object

if TYPE_CHECKING:
    from dirprim_filter.recording.track_log import TrackLog
    from dirprim_filter.viewer.figures import Figure

Folds = Annotated[int, typer.Option(min=1, help="How many times rows are held out.")]
MinSpeed = Annotated[float, typer.Option(min=0.0, help="m/s; slower rows do not count, as in the paper.")]
Json = Annotated[bool, typer.Option("--json", help="All figures and the experiment, for machines.")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """An experiment that has run.

    Attributes:
        command: its name after `dirprim`.
        inputs: the files that it read.
        reading: the options by which it read them.
        experiment: what the figures follow from.
        table: the figures, for machines.
        text: the figures, for people.
        figure: draws them.
    """

    command: str
    inputs: Sequence[Path]
    reading: Reading
    experiment: Mapping[str, Any]
    table: Mapping[str, Any]
    text: Callable[[], str]
    figure: Callable[[], Figure]

    def deliver(self, log: TrackLog, *, plot: Path | None, as_json: bool, force: bool) -> int:
        """Draw and print it; -> the exit code."""
        if plot is not None:
            from dirprim_filter.viewer.figures import save_figure

            save_figure(self.figure(), plot, force=force)
        typer.echo(self._json() if as_json else self.text())
        return losses.exit_code([damage for _, damage in log.damage], log.dropped.lost)

    def _json(self) -> str:
        return as_json(
            result_object(
                self.command, inputs=self.inputs, experiment=self.experiment, reading=self.reading, table=self.table
            )
        )


def table_line(name: str, cells: Sequence[str], *, width: int) -> str:
    """One line of a table whose columns are so many characters wide."""
    return f"{name:<24}" + "".join(f"{cell:>{width}}" for cell in cells)
