"""What all experiments share: logs are read before, a table, a figure and an exit code come after."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

import typer

from dirprim_filter.cli import losses
from dirprim_filter.cli.options import WholeVehicles
from dirprim_filter.cli.reading import Reading
from dirprim_filter.cli.results import as_json as json_of
from dirprim_filter.cli.results import result_object

if TYPE_CHECKING:
    from dirprim_filter.recording.objects.tracks import TrackResult
    from dirprim_filter.viewer.figures import Figure

Split = Annotated[
    WholeVehicles | None, typer.Option(help="What to hold out together. Default: groups if the log has several.")
]
Folds = Annotated[int, typer.Option(min=1, help="Number of folds, each held out once.")]
MinSpeed = Annotated[float, typer.Option(min=0.0, help="m/s; slower rows are left out, as in the paper.")]
Json = Annotated[bool, typer.Option("--json", help="Print the experiment and all figures as JSON.")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """An experiment on logs, from reading them to its report.

    Attributes:
        command: its name after `dirprim`.
        inputs: the files it reads.
        reading: the options for reading them.
        plot: the figure to write, if any.
        as_json: print JSON instead of text.
        force: let the figure replace a file.
        log: the tracks to evaluate on.
    """

    command: str
    inputs: Sequence[Path]
    reading: Reading
    plot: Path | None
    as_json: bool
    force: bool
    log: TrackResult

    @classmethod
    def on(
        cls,
        logs: list[Path],
        *,
        command: str,
        reading: Reading,
        as_json: bool,
        force: bool = False,
        plot: Path | None = None,
        more_inputs: Sequence[Path] = (),
    ) -> Self:
        """Read the logs.

        Raises:
            RecordingError: a log cannot be read.
        """
        return cls(
            command=command, inputs=[*logs, *more_inputs], reading=reading, plot=plot, as_json=as_json, force=force,
            log=reading.tracks(logs),
        )  # fmt: skip

    def report(
        self,
        table: Mapping[str, Any],
        *,
        settings: Mapping[str, Any],
        text: Callable[[], str],
        figure: Callable[[], Figure] | None = None,
    ) -> int:
        """Draw and print the result.

        Args:
            table: the figures, for JSON.
            settings: what the figures follow from, for JSON.
            text: makes the text.
            figure: makes the figure.

        Returns:
            The exit code.
        """
        if self.plot is not None and figure is not None:
            from dirprim_filter.viewer.figures import save_figure

            save_figure(figure(), self.plot, force=self.force)
        typer.echo(self._json(table, settings) if self.as_json else text())
        return losses.exit_code(self.log.losses)

    def _json(self, table: Mapping[str, Any], settings: Mapping[str, Any]) -> str:
        return json_of(
            result_object(self.command, inputs=self.inputs, experiment=settings, reading=self.reading, table=table)
        )


def table_line(name: str, cells: Sequence[str], *, width: int) -> str:
    """One line of a table whose columns are `width` characters wide."""
    return f"{name:<24}" + "".join(f"{cell:>{width}}" for cell in cells)
