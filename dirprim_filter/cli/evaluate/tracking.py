"""`dirprim evaluate tracking`: the same tracker on several motion models, on traffic that a sensor reports badly."""

from __future__ import annotations

import csv
from dataclasses import asdict, dataclass, replace
from io import StringIO
from pathlib import Path
from typing import Annotated

import typer

from dirprim_filter.cli.commands import check_outputs
from dirprim_filter.cli.options import FILE, PICTURES, WRITTEN, Config, Force, Json, Logs
from dirprim_filter.cli.reading import Reading, Settings, taken
from dirprim_filter.cli.tables import latex, main_rows, markdown, tracking_text
from dirprim_filter.partial_file import PartialFile


@dataclass(frozen=True, slots=True, kw_only=True)
class Own:
    """Settings of the command."""

    time_limit_s: float = 600.0


def tracking(
    logs: Logs,
    map_file: Annotated[
        Path | None,
        typer.Option("--map", help="Track with this map. Default: learn one from a part of the log.", **FILE),
    ] = None,
    method: Annotated[
        list[str] | None,
        typer.Option(
            help="Of ours only this; or NAME='COMMAND {detections} {estimates}', another's beside ours. Repeatable."
        ),
    ] = None,
    estimates: Annotated[
        list[str] | None,
        typer.Option(help="Another tracker's tables, such as theirs_seed{seed}.csv, one for each run. Repeatable."),
    ] = None,
    gap: Annotated[
        float | None, typer.Option(help="Seconds out of sight of each vehicle; 0: none. Default: 3.")
    ] = None,
    with_ids: Annotated[bool | None, typer.Option("--ids/--no-ids", help="Whether the sensor reports ids.")] = None,
    seeds: Annotated[int | None, typer.Option(min=1, help="Runs, each with random numbers of its own.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="The same seed gives the same result.")] = None,
    config: Config = None,
    as_json: Json = False,
    as_markdown: Annotated[bool, typer.Option("--markdown", help="Print the main figures in Markdown.")] = False,
    as_latex: Annotated[bool, typer.Option("--latex", help="Print the main figures in LaTeX.")] = False,
    plot: Annotated[
        Path | None,
        typer.Option(help=f"Draw errors and reliability: {', '.join(PICTURES)}; a .csv beside has the data."),
        WRITTEN,
        PICTURES,
    ] = None,
    force: Force = False,
    *,
    reading: Reading,
    settings: Annotated[Settings, "those of an experiment", "fields of FilterConfig and TrackingConfig", Own],
) -> int:
    """Compare trackers on known traffic, by a simulated sensor.

    The sensor adds noise, gaps, misses and false detections. Trackers with and without the map get the same ones.
    docs/experiments.md lists what --set takes, such as noise_m or miss_rate.

    Example: dirprim evaluate tracking recordings/roundabout_learn.mcap --gap 3 --seeds 2
    """
    from dirprim_filter.cli.coverage import Coverage
    from dirprim_filter.cli.evaluate.others import others_of
    from dirprim_filter.cli.motion import map_of
    from dirprim_filter.cli.progress import step_progress
    from dirprim_filter.cli.results import read_tracking, report
    from dirprim_filter.evaluation.tracking import comparisons, evaluate_tracking

    if as_json + as_markdown + as_latex > 1:
        raise typer.BadParameter("expected one of --json, --markdown and --latex")
    own, commands = taken(Own, settings), [text for text in method or () if "=" in text]
    made = read_tracking(
        config, settings, Own, gap_s=gap, with_ids=with_ids, n_seeds=seeds, seed=seed,
        methods=[name for name in method or () if "=" not in name] or None,
    )  # fmt: skip
    if not own.time_limit_s > 0:
        raise typer.BadParameter(f"time_limit_s: expected positive seconds, got {own.time_limit_s}", param_hint="--set")
    others, tables = others_of(commands, estimates or (), made, limit_s=own.time_limit_s)
    primitive_map, reading = map_of(map_file, reading)
    inputs = [*logs, *filter(None, [map_file]), *tables]
    if plot is not None:
        check_outputs([plot.with_suffix(".csv")], inputs, force=force)
    log = reading.tracks(logs)
    Coverage(primitive_map, map_file, logs[0]).check(log.tracks.position)
    with step_progress("evaluating", "steps") as step:
        table = evaluate_tracking(log.tracks, made, primitive_map=primitive_map, others=others, progress=step)
    if plot is not None:
        from dirprim_filter.evaluation.error_curves import HEADS, curves
        from dirprim_filter.viewer.experiment_figure import experiment_figure
        from dirprim_filter.viewer.figures import save_figure

        save_figure(experiment_figure(table), plot, force=force)
        data = StringIO()
        csv.writer(data).writerows([HEADS, *curves(table)])
        with PartialFile(plot.with_suffix(".csv"), force=force) as file:
            file.write(data.getvalue().encode())
    bare = replace(table, methods=tuple(replace(method, errors=()) for method in table.methods))
    lines = markdown if as_markdown else latex if as_latex else None
    return report(
        "evaluate tracking", inputs, reading, log.losses, settings=asdict(made), as_json=as_json,
        table=asdict(bare) | {"comparisons": comparisons(table)}
        | ({"others": [*commands, *(estimates or ())]} if others else {}),
        text=lambda: "\n".join(lines(main_rows(table))) if lines else tracking_text(table),
    )  # fmt: skip
