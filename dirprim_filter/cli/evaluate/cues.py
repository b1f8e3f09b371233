"""`dirprim evaluate cues`: what the prior adds to an observation (Table II, Eq. 4)."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from dirprim_filter.cli.evaluate.density import interval_text
from dirprim_filter.cli.options import Folds, Json, Logs, Seed, Split, Tessellation
from dirprim_filter.cli.reading import Reading
from dirprim_filter.cli.results import report
from dirprim_filter.cli.texts import columns, counted

if TYPE_CHECKING:
    from dirprim_filter.evaluation.cues import CueTable


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
    import numpy as np

    from dirprim_filter.cli.progress import step_progress
    from dirprim_filter.evaluation.cues import evaluate_cues

    log = reading.tracks(logs)
    (deal,) = np.random.default_rng(seed).spawn(1)
    with step_progress("evaluating", "folds") as step:
        table = evaluate_cues(
            log.tracks, split_by=split, n_folds=folds, tessellation=tessellation, progress=step,
            rng=deal,
        )  # fmt: skip
    return report(
        "evaluate cues", logs, reading, log.losses, as_json=as_json, text=lambda: cues_text(table),
        table={"table": asdict(table)},
        settings={
            "split_by": table.split_by, "n_folds": folds, "tessellation": tessellation, "seed": seed,
        },
    )  # fmt: skip


def cues_text(table: CueTable) -> str:
    """Table II as text."""
    rows = [
        ["", "mean log density, nat", "prior adds, nat", "adds to the prior, nat", "mean density"],
        ["prior", interval_text(table.prior.mean_log), "", "", f"{table.prior.mean:.3f}"],
    ]
    for name, score in (("cell before", table.cell_before), ("own course", table.own_course)):
        alone, both = score.observation, score.posterior
        gains = [interval_text(score.log_gain), interval_text(score.over_prior)]
        rows.append([name, interval_text(alone.mean_log), "", "", f"{alone.mean:.3f}"])
        rows.append([f"{name}, posterior", interval_text(both.mean_log), *gains, f"{both.mean:.3f}"])
    return "\n".join([
        f"{table.n_steps} steps from cell to cell, {counted(table.n_vehicles, 'vehicle')}, "
        f"held out by {table.split_by}, {counted(table.n_folds, 'fold')}",
        "",
        *columns(rows),
        "",
        "no figure is the paper's +54 %: that is of sums of densities, by an observation of unstated concentration",
    ])  # fmt: skip
