"""`dirprim evaluate`: how good maps of primitives are on held-out vehicles of a log, beside other methods."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from dirprim_filter.cli.commands import register
from dirprim_filter.cli.evaluate.tracking import tracking
from dirprim_filter.cli.options import Config, Folds, Json, Logs, Seed, Split, Tessellation
from dirprim_filter.cli.reading import Reading

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
    logs: Logs,
    split: Annotated[
        Literal["vehicle", "group", "random"] | None,
        typer.Option(help="What to hold out together. Default: groups if the log has several. random: 10 % of rows."),
    ] = None,
    folds: Folds = 5,
    every: Annotated[float | None, typer.Option(help="Seconds between a vehicle's rows. Default: all rows.")] = None,
    seed: Seed = 0,
    as_json: Json = False,
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
    logs: Logs,
    split: Split = None,
    folds: Folds = 5,
    tessellation: Tessellation = "joint",
    seed: Seed = 0,
    as_json: Json = False,
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
    logs: Logs,
    split: Split = None,
    config: Config = None,
    horizon: Annotated[
        list[float] | None, typer.Option(help="Seconds ahead; may be repeated. Default: 0.5 to 8 s.")
    ] = None,
    folds: Annotated[int | None, typer.Option(min=2, help="Number of folds, each held out once. Default: 4.")] = None,
    samples: Annotated[int | None, typer.Option(min=20, help="Rollouts of each vehicle. Default: 100.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="The same seed gives the same result. Default: 0.")] = None,
    as_json: Json = False,
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


for experiment in (tracking, forecast, density, cues):
    register(evaluate, experiment)
