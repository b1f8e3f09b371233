"""`dirprim evaluate`: how good maps of primitives are on held-out vehicles of a log, beside other methods."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from dirprim_filter.cli import options
from dirprim_filter.cli.commands import check_outputs, register
from dirprim_filter.cli.reading import Reading
from dirprim_filter.cli.settings import Settings, taken
from dirprim_filter.partial_file import PartialFile

if TYPE_CHECKING:
    from dirprim_filter.recording.reader import TrackResult

evaluate = typer.Typer(
    name="evaluate",
    help=(
        "Compare methods on held-out vehicles of your own log. "
        "Example: dirprim evaluate density recordings/roundabout_learn.mcap"
    ),
    no_args_is_help=True,
)


def density(
    logs: options.Logs,
    split: Annotated[
        Literal["vehicle", "group", "random"] | None,
        typer.Option(help="What to hold out together. Default: groups if the log has several. random: 10 % of rows."),
    ] = None,
    folds: options.Folds = 5,
    every: Annotated[float | None, typer.Option(help="Seconds between a vehicle's rows. Default: all rows.")] = None,
    seed: options.Seed = 0,
    as_json: options.Json = False,
    *,
    reading: Reading,
) -> int:
    """Compare densities of held-out motion (the paper's Table I).

    Example: dirprim evaluate density recordings/roundabout_learn.mcap --split vehicle --folds 5
    """
    from dirprim_filter.cli.tables import density_text
    from dirprim_filter.evaluation.density import conclusion, evaluate_density

    return _evaluated(
        "density", logs, reading, reading.tracks(logs), evaluate_density, density_text, as_json=as_json,
        settings={"split_by": split, "n_folds": folds, "interval_s": every, "seed": seed},
        as_object=lambda table: asdict(table) | {"conclusion": conclusion(table)},
    )  # fmt: skip


def cues(
    logs: options.Logs,
    split: options.Split = None,
    folds: options.Folds = 5,
    tessellation: options.Tessellation = "joint",
    seed: options.Seed = 0,
    as_json: options.Json = False,
    *,
    reading: Reading,
) -> int:
    """Compare what the prior adds to an observation (Table II).

    Example: dirprim evaluate cues recordings/roundabout_learn.mcap
    """
    from dirprim_filter.cli.tables import cues_text
    from dirprim_filter.evaluation.cues import evaluate_cues

    return _evaluated(
        "cues", logs, reading, reading.tracks(logs),
        lambda tracks, rng, **how: evaluate_cues(tracks, rng=rng.spawn(1)[0], **how),  # so are docs/results.md
        cues_text, as_json=as_json, unit="folds",
        settings={"split_by": split, "n_folds": folds, "tessellation": tessellation, "seed": seed},
        as_object=lambda table: {"table": asdict(table)},
    )  # fmt: skip


def forecast(
    logs: options.Logs,
    split: options.Split = None,
    config: options.Config = None,
    horizon: Annotated[
        list[float] | None, typer.Option(help="Seconds ahead; may be repeated. Default: 0.5 to 8 s.")
    ] = None,
    folds: Annotated[int | None, typer.Option(min=2, help="Number of folds, each held out once. Default: 4.")] = None,
    samples: Annotated[int | None, typer.Option(min=20, help="Rollouts of each vehicle. Default: 100.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="The same seed gives the same result. Default: 0.")] = None,
    as_json: options.Json = False,
    *,
    reading: Reading,
) -> int:
    """Compare forecasts of held-out vehicles.

    The map is compared with one cell, no cells, remembered tracks and constant velocity.

    Example: dirprim evaluate forecast recordings/roundabout_learn.mcap
    """
    from dirprim_filter.cli.results import read_experiment
    from dirprim_filter.cli.tables import forecast_text
    from dirprim_filter.evaluation.forecast_cases import HORIZONS_S
    from dirprim_filter.evaluation.forecasting import evaluate_forecasts
    from dirprim_filter.evaluation.splits import honest_split

    asked = {"split_by": split, "horizons_s": horizon or None, "n_folds": folds, "n_samples": samples, "seed": seed}
    given = read_experiment(config) | {name: of for name, of in asked.items() if of is not None}
    log = reading.tracks(logs)
    if unknown := [name for name in given if name not in asked]:
        raise ValueError(f"experiment: {unknown[0]}: expected one of {', '.join(asked)}")
    by = honest_split(log.tracks)
    made = {"split_by": by, "horizons_s": list(HORIZONS_S), "n_folds": 4, "n_samples": 100, "seed": 0} | given
    return _evaluated("forecast", logs, reading, log, evaluate_forecasts, forecast_text, as_json=as_json, settings=made)


def _evaluated(
    what: str, logs: list[Path], reading: Reading, log: TrackResult, evaluate: Callable[..., Any],
    text: Callable[[Any], str], *, settings: dict[str, Any], as_json: bool, unit: str = "fits",
    as_object: Callable[[Any], dict[str, Any]] = asdict,
) -> int:  # fmt: skip
    """Evaluate the tracks by these settings, with random numbers of their seed, and print the table."""
    import numpy as np

    from dirprim_filter.cli.progress import step_progress
    from dirprim_filter.cli.results import report

    rng, given = np.random.default_rng(settings["seed"]), {name: of for name, of in settings.items() if name != "seed"}
    with step_progress("evaluating", unit) as step:
        table = evaluate(log.tracks, **given, progress=step, rng=rng)
    return report(
        f"evaluate {what}", logs, reading, log.losses, table=as_object(table), as_json=as_json,
        settings=settings | {"split_by": table.split_by}, text=lambda: text(table),
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Own:
    """Settings of `evaluate tracking`."""

    time_limit_s: float = 600.0


def tracking(
    logs: options.Logs,
    map_file: Annotated[
        Path | None,
        typer.Option("--map", help="Track with this map. Default: learn one from a part of the log.", **options.FILE),
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
    config: options.Config = None,
    as_json: options.Json = False,
    as_markdown: Annotated[bool, typer.Option("--markdown", help="Print the main figures in Markdown.")] = False,
    as_latex: Annotated[bool, typer.Option("--latex", help="Print the main figures in LaTeX.")] = False,
    plot: Annotated[
        Path | None,
        typer.Option(help=f"Draw errors and reliability: {', '.join(options.PICTURES)}; a .csv beside has the data."),
        options.WRITTEN,
        options.PICTURES,
    ] = None,
    force: options.Force = False,
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
    from dirprim_filter.cli.motion import map_of
    from dirprim_filter.cli.other_trackers import others_of
    from dirprim_filter.cli.progress import step_progress
    from dirprim_filter.cli.results import read_tracking, report
    from dirprim_filter.cli.tables import latex, main_rows, markdown, tracking_text
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


for experiment in (tracking, forecast, density, cues):
    register(evaluate, experiment)
