"""`dirprim evaluate density`: the density that each method gives to held-out rows (the paper's Table I)."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from dirprim_filter.cli.options import Folds, Json, Logs, Seed
from dirprim_filter.cli.reading import Reading
from dirprim_filter.cli.results import report
from dirprim_filter.cli.texts import columns, counted

if TYPE_CHECKING:
    from dirprim_filter.evaluation.density import DensityTable
    from dirprim_filter.evaluation.intervals import Interval
    from dirprim_filter.evaluation.settings import Choice


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
    import numpy as np

    from dirprim_filter.cli.progress import step_progress
    from dirprim_filter.evaluation.density import conclusion, evaluate_density

    log = reading.tracks(logs)
    with step_progress("evaluating", "fits") as step:
        table = evaluate_density(
            log.tracks, split_by=split, n_folds=folds, interval_s=every, progress=step,
            rng=np.random.default_rng(seed),
        )  # fmt: skip
    return report(
        "evaluate density", logs, reading, log.losses, as_json=as_json, text=lambda: density_text(table),
        table=asdict(table) | {"conclusion": conclusion(table)},
        settings={
            "split_by": table.split_by, "n_folds": folds, "interval_s": every, "seed": seed,
        },
    )  # fmt: skip


def density_text(table: DensityTable) -> str:
    """Table I as text, a block for each quantity, and what follows from it."""
    from dirprim_filter.evaluation.density import clusters, conclusion

    blocks = {"direction, per rad": "direction", "speed, per m/s": "speed", "direction and speed": "joint"}
    lines = [
        f"{counted(table.n_held_out, 'row')} held out of {table.n_rows}, {counted(table.n_vehicles, 'vehicle')}, "
        f"by {table.split_by}, {counted(table.n_folds, 'fold')}; 95 % intervals over {clusters(table)}"
    ]
    for title, quantity in blocks.items():
        rows = [[title, "mean log density, nat", "behind the first by", "mean density"]]
        for row in table.methods:
            if (score := getattr(row, quantity)) is not None:
                behind = "" if row is table.methods[0] else interval_text(score.behind)
                rows.append([row.name, interval_text(score.mean_log), behind, f"{score.mean:.3f}"])
        lines += ["", *columns(rows)]
    rivals = [row for row in table.methods if row.settings]
    lines += ["", "chosen by held-out training vehicles, fold by fold:"] if rivals else []
    lines += [f"{row.name}: {settings_text(row.settings)}" for row in rivals]
    return "\n".join([*lines, "", conclusion(table)])


def interval_text(found: Interval) -> str:
    """A figure with its interval."""
    return f"{found.value:.3f} ({found.low:.3f} to {found.high:.3f})"


def settings_text(settings: tuple[tuple[Choice, ...], ...]) -> str:
    """Settings of all folds: each with its name, the values chosen, and the range that was searched."""
    return "; ".join(
        f"{of_folds[0].name} {', '.join(f'{choice.chosen:.3g}' for choice in of_folds)} "
        f"(of {min(choice.low for choice in of_folds):.3g} to {max(choice.high for choice in of_folds):.3g})"
        for of_folds in zip(*settings, strict=True)
    )
