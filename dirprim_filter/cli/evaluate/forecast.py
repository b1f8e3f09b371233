"""`dirprim evaluate forecast`: how good forecasts of held-out vehicles are, half a second to eight seconds ahead."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dirprim_filter.cli.options import Config, Json, Logs, Split
from dirprim_filter.cli.reading import Reading
from dirprim_filter.cli.results import read_experiment, report
from dirprim_filter.cli.texts import UNKNOWN, columns, counted

if TYPE_CHECKING:
    from dirprim_filter.evaluation.forecasting import ForecastTable
    from dirprim_filter.evaluation.intervals import Interval

FIGURES = {
    "energy": "energy, m", "ade": "ADE, m", "fde": "FDE, m", "coverage_50": "in 50 %", "coverage_90": "in 90 %",
}  # fmt: skip
"""The figures of a score, and what the table calls them."""
CONCLUDED_S = (1.0, 5.0)
"""Horizons of the conclusion; or those nearest to them."""
SAID = {"place-free": "the same model without the map", "one cell": "one cell for all places"}
"""What the conclusion calls methods."""


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
    import numpy as np

    from dirprim_filter.cli.progress import step_progress
    from dirprim_filter.evaluation.forecast_cases import HORIZONS_S
    from dirprim_filter.evaluation.forecasting import evaluate_forecasts
    from dirprim_filter.evaluation.splits import honest_split

    given: dict[str, Any] = {
        "split_by": split, "horizons_s": horizon or None, "n_folds": folds,
        "n_samples": samples, "seed": seed,
    }  # fmt: skip
    given = read_experiment(config) | {n: of for n, of in given.items() if of is not None}
    log = reading.tracks(logs)
    defaults = {
        "split_by": honest_split(log.tracks), "horizons_s": list(HORIZONS_S), "n_folds": 4,
        "n_samples": 100, "seed": 0,
    }  # fmt: skip
    if unknown := [name for name in given if name not in defaults]:
        raise ValueError(f"experiment: {unknown[0]}: expected one of {', '.join(defaults)}")
    made: dict[str, Any] = defaults | given
    of_table = {name: value for name, value in made.items() if name != "seed"}
    with step_progress("evaluating", "fits") as step:
        table = evaluate_forecasts(
            log.tracks, **of_table, progress=step, rng=np.random.default_rng(made["seed"]),
        )  # fmt: skip
    return report(
        "evaluate forecast", logs, reading, log.losses, table=asdict(table), settings=made,
        text=lambda: forecast_text(table), as_json=as_json,
    )  # fmt: skip


def forecast_text(table: ForecastTable) -> str:
    """The table as text: a block for each method, a line for each horizon; then what the first gains."""
    lines = [
        f"{counted(table.n_vehicles, 'vehicle')} held out by {table.split_by}, {counted(table.n_folds, 'fold')}; "
        f"{counted(table.n_samples, 'rollout')} each"
    ]
    first, *others = table.methods
    for row in table.methods:
        figures = [[f"{score.horizon_s:g} s", str(score.n_cases), *(_figure(getattr(score, n)) for n in FIGURES)]
                   for score in row.horizons]  # fmt: skip
        lines += ["", *columns([[row.name, "cases", *FIGURES.values()], *figures])]
    horizons = [score.horizon_s for score in first.horizons]
    n = first.horizons[0].gain.n_clusters
    lines += ["", f"Energy score of the {first.name}, with 95 % intervals over {counted(n, table.split_by)}:"]
    for i in sorted({min(range(len(horizons)), key=lambda h: abs(horizons[h] - at)) for at in CONCLUDED_S}):
        heads = [f"  at {horizons[i]:g} s", *[""] * len(others)]
        lines += [
            f"{head:<11}{_gain(row.horizons[i].gain, row.name)}" for head, row in zip(heads, others, strict=False)
        ]
    return "\n".join(lines)


def _figure(value: float) -> str:
    return UNKNOWN if math.isnan(value) else f"{value:.2f}"


def _gain(found: Interval, name: str) -> str:
    """What the first method takes off the energy of another, or adds to it."""
    sign, word = (1.0, "less") if found.value >= 0 else (-1.0, "more")
    low, high = sorted((100.0 * sign * found.low, 100.0 * sign * found.high))
    chance = "" if found.is_apart else ": not distinguishable"
    of = SAID.get(name, name)
    return f"{100.0 * sign * found.value:.1f} % ({low:.1f} to {high:.1f} %) {word} than {of}{chance}"
