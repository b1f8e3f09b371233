"""`dirprim evaluate forecast`: how good forecasts of held-out vehicles are, half a second to eight seconds ahead."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dirprim_filter.cli import losses
from dirprim_filter.cli.options import Force, Logs, Seed
from dirprim_filter.cli.reading import Reading, reads_logs

if TYPE_CHECKING:
    from dirprim_filter.evaluation.forecasting import ForecastTable

FIGURES = {
    "energy": "energy, m", "ade": "ADE, m", "fde": "FDE, m", "best_of_20": "best of 20, m", "nll": "NLL",
    "coverage_50": "in 50 %", "coverage_90": "in 90 %",
}  # fmt: skip
"""The figures of a score, and what the table calls them."""


@reads_logs
def forecast(
    logs: Logs,
    by_group: Annotated[bool, typer.Option("--by-group", help="Hold out whole groups, not single vehicles.")] = False,
    horizon: Annotated[
        list[float] | None, typer.Option(help="Seconds ahead; may be given again. Left out, 0.5 to 8 s.")
    ] = None,
    folds: Annotated[int, typer.Option(min=2, help="Parts of the vehicles, each held out once.")] = 4,
    seeds: Annotated[int, typer.Option(min=1, help="How many times vehicles are dealt anew.")] = 1,
    samples: Annotated[int, typer.Option(min=20, help="Futures of each vehicle.")] = 100,
    seed: Seed = 0,
    reading: Reading = Reading(),
    plot: Annotated[Path | None, typer.Option("--plot", help="Draw the table as well: a .png, .pdf or .svg.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="All figures, for machines.")] = False,
    force: Force = False,
) -> int:
    """Forecast held-out vehicles with the prior, without places, and at constant velocity.

    Example: dirprim evaluate forecast recordings/roundabout_learn.mcap --seeds 5 --plot forecast.png
    """
    import numpy as np

    from dirprim_filter.cli.evaluate import _as_json, _check_plot
    from dirprim_filter.cli.progress import step_progress
    from dirprim_filter.evaluation.forecasting import HORIZONS_S, evaluate_forecasts

    _check_plot(plot, force=force)
    log = reading.tracks(logs)
    with step_progress("evaluating", "fits") as told:
        table = evaluate_forecasts(
            log.tracks, split_by="group" if by_group else "vehicle", horizons_s=horizon or HORIZONS_S, n_folds=folds,
            n_seeds=seeds, n_samples=samples, progress=told, rng=np.random.default_rng(seed),
        )  # fmt: skip
    if plot is not None:
        from dirprim_filter.viewer.charts import forecast_chart
        from dirprim_filter.viewer.figures import save_figure

        save_figure(forecast_chart(table), plot, force=force)
    typer.echo(_as_json(asdict(table) | {"seed": seed}) if as_json else forecast_text(table))
    return losses.exit_code([damage for _, damage in log.damage], log.dropped.total)


def forecast_text(table: ForecastTable) -> str:
    """The table as text: a block for each method, a line for each horizon."""
    lines = [
        f"{table.n_vehicles} vehicles held out by {table.split_by}, {table.n_folds} folds, {table.n_seeds} seeds; "
        f"{table.n_samples} futures each"
    ]
    baseline = {score.horizon_s: score.energy for score in table.methods[-1].horizons}
    for row in table.methods:
        heads = ["cases", *FIGURES.values(), "std of seeds", f"to {table.methods[-1].name}"]
        lines += ["", f"{row.name:<18}" + "".join(f"{head:>15}" for head in heads[:-1]) + f"  {heads[-1]}"]
        for score in row.horizons:
            figures = [f"{getattr(score, name):.2f}" for name in FIGURES]
            relative = f"{score.energy / baseline[score.horizon_s]:.2f}" if score.horizon_s in baseline else ""
            cells = [str(score.n_cases), *figures, f"{score.energy_std:.3f}"]
            lines.append(
                f"{score.horizon_s:>6g} s          " + "".join(f"{cell:>15}" for cell in cells) + f"  {relative}"
            )
    return "\n".join(lines)
