"""`dirprim evaluate`: how good maps of primitives are on held-out vehicles of a log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from dirprim_filter.cli import evaluate_forecast, evaluate_tracking, losses
from dirprim_filter.cli.options import Cells, Force, Logs, Plot, Seed, Tessellation, WholeVehicles
from dirprim_filter.cli.reading import Reading, reads_logs
from dirprim_filter.cli.results import as_json as json_text
from dirprim_filter.cli.results import check_plot, result_object

if TYPE_CHECKING:
    from dirprim_filter.evaluation.cues import CueTable, SignalExample
    from dirprim_filter.evaluation.density import DensityScore, DensityTable

evaluate = typer.Typer(
    name="evaluate",
    help=(
        "Compare methods on held-out vehicles: the paper's tables for a log of your own. "
        "Example: dirprim evaluate density recordings/roundabout_learn.mcap"
    ),
    no_args_is_help=True,
)
evaluate.command()(evaluate_tracking.tracking)
evaluate.command()(evaluate_forecast.forecast)


class SplitBy(StrEnum):
    """What is held out together."""

    VEHICLE = "vehicle"
    GROUP = "group"
    RANDOM = "random"


Folds = Annotated[int, typer.Option(min=1, help="How many times rows are held out.")]
MinSpeed = Annotated[float, typer.Option(min=0.0, help="m/s; slower rows do not count, as in the paper.")]
Json = Annotated[bool, typer.Option("--json", help="All figures and the experiment, for machines.")]


@evaluate.command()
@reads_logs
def density(
    logs: Logs,
    split: Annotated[
        SplitBy | None,
        typer.Option(help="Hold out so; left out, by group if there are several, else by vehicle. random: 10 % each."),
    ] = None,
    folds: Folds = 5,
    every: Annotated[float | None, typer.Option(help="Seconds between a vehicle's rows; left out, all rows.")] = None,
    min_speed: MinSpeed = 0.5,
    seed: Seed = 0,
    reading: Reading = Reading(),
    plot: Plot = None,
    as_json: Json = False,
    force: Force = False,
) -> int:
    """The density that each method gives to held-out directions and speeds (the paper's Table I).

    Example: dirprim evaluate density recordings/roundabout_learn.mcap --split vehicle --folds 5
    """
    import numpy as np

    from dirprim_filter.cli.progress import step_progress
    from dirprim_filter.evaluation.density import evaluate_density

    check_plot(plot, force=force)
    log = reading.tracks(logs)
    with step_progress("evaluating", "fits") as told:
        table = evaluate_density(
            log.tracks, split_by=None if split is None else split.value, n_folds=folds, min_speed=min_speed,
            interval_s=every, progress=told, rng=np.random.default_rng(seed),
        )  # fmt: skip
    if plot is not None:
        from dirprim_filter.viewer.figures import density_table_figure, save_figure

        save_figure(density_table_figure(table), plot, force=force)
    if as_json:
        experiment = {
            "split_by": table.split_by, "n_folds": folds, "interval_s": every, "min_speed": min_speed, "seed": seed
        }  # fmt: skip
        told_all = asdict(table)
        typer.echo(
            json_text(
                result_object("evaluate density", inputs=logs, experiment=experiment, reading=reading, table=told_all)
            )
        )
    else:
        typer.echo(density_text(table))
    return losses.exit_code([damage for _, damage in log.damage], log.dropped.total)


@evaluate.command()
@reads_logs
def cues(
    logs: Logs,
    split: Annotated[
        WholeVehicles | None, typer.Option(help="Hold out so; left out, by group if there are several.")
    ] = None,
    folds: Folds = 5,
    tessellation: Tessellation = Cells.JOINT,
    min_speed: MinSpeed = 0.5,
    seed: Seed = 0,
    reading: Reading = Reading(),
    plot: Plot = None,
    as_json: Json = False,
    force: Force = False,
) -> int:
    """What the prior adds to an observation, and a turn signal to the prior (the paper's Table II and Eq. 4).

    Example: dirprim evaluate cues recordings/roundabout_learn.mcap
    """
    import numpy as np

    from dirprim_filter.cli.progress import step_progress
    from dirprim_filter.evaluation.cues import evaluate_cues, turn_signal_example
    from dirprim_filter.primitives import learn_primitives

    check_plot(plot, force=force)
    log = reading.tracks(logs)
    deal, learn, draw = np.random.default_rng(seed).spawn(3)
    with step_progress("evaluating", "folds") as told:
        table = evaluate_cues(
            log.tracks, split_by=None if split is None else split.value, n_folds=folds, tessellation=tessellation.value,
            min_speed=min_speed, progress=told, rng=deal,
        )  # fmt: skip
    learned = learn_primitives(log.tracks, tessellation=tessellation.value, rng=learn)
    example = turn_signal_example(learned, rng=draw)
    if plot is not None:
        from dirprim_filter.viewer.figures import cue_table_figure, save_figure

        save_figure(cue_table_figure(table), plot, force=force)
    if as_json:
        signal = asdict(example) | {"position": example.position.tolist()}
        experiment = {
            "split_by": table.split_by, "n_folds": folds, "tessellation": tessellation.value, "min_speed": min_speed,
            "seed": seed,
        }  # fmt: skip
        both = {"table": asdict(table), "turn_signal": signal}
        typer.echo(
            json_text(result_object("evaluate cues", inputs=logs, experiment=experiment, reading=reading, table=both))
        )
    else:
        typer.echo(cues_text(table, example))
    return losses.exit_code([damage for _, damage in log.damage], log.dropped.total)


def density_text(table: DensityTable) -> str:
    """Table I as text, a block for each quantity."""
    blocks: dict[str, list[DensityScore | None]] = {
        "direction, per rad": [row.direction for row in table.methods],
        "speed, per m/s": [row.speed for row in table.methods],
        "direction and speed": [row.joint for row in table.methods],
    }
    lines = [
        f"{table.n_held_out} rows held out of {table.n_rows}, {table.n_vehicles} vehicles, "
        f"by {table.split_by}, {table.n_folds} folds"
    ]
    for title, scores in blocks.items():
        lines += ["", _line(title, ["density", "std of rows", "of folds", "log density", "of folds"], width=13)]
        for row, score in zip(table.methods, scores, strict=True):
            if score is not None:
                figures = (score.mean, score.std, score.fold_std, score.mean_log, score.fold_log_std)
                lines.append(_line(row.name, [f"{figure:.3f}" for figure in figures], width=13))
    told = [f"{row.name}: {row.setting}: the best for these rows" for row in table.methods if row.setting]
    return "\n".join([*lines, "", *told])


def cues_text(table: CueTable, example: SignalExample) -> str:
    """Table II and the turn-signal example as text."""
    import numpy as np

    heads = ["prior", "observation", "posterior", "gain per vehicle", "of log, nat"]
    lines = [
        f"{table.n_steps} steps from cell to cell, {table.n_vehicles} vehicles, "
        f"held out by {table.split_by}, {table.n_folds} folds",
        "",
        _line("sum of densities", heads, width=18),
    ]
    for name, score in (("cell before", table.cell_before), ("own course", table.own_course)):
        sums = [f"{value:.3f}" for value in (table.prior, score.observation, score.posterior)]
        gain = f"{score.gain:+.1%}"
        lines.append(_line(name, [*sums, gain, f"{score.log_gain:+.3f}"], width=18))
    before, after, heading = np.rad2deg([example.rmse_before, example.rmse_after, example.heading])
    x, y = example.position
    lines += [
        "",
        f"turn signal to the right at ({x:.1f}, {y:.1f}) m, heading {heading:.0f} deg: RMSE of {example.n_samples} "
        f"directions from the turn {before:.1f} deg, with the signal {after:.1f} deg",
    ]
    return "\n".join(lines)


def _line(name: str, cells: Sequence[str], *, width: int) -> str:
    return f"{name:<24}" + "".join(f"{cell:>{width}}" for cell in cells)
