"""The tables of `dirprim evaluate` as charts."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dirprim_filter.evaluation.cues import CueTable
from dirprim_filter.evaluation.density import DensityScore, DensityTable, clusters
from dirprim_filter.evaluation.intervals import Interval
from dirprim_filter.viewer.figures.page import DOTS_PER_INCH, LARGE, NORMAL, SMALL, dress, open_frame
from dirprim_filter.viewer.layers import FOCUS_COLOR, OTHER_COLOR

OURS = "primitive"
"""The names of our methods begin so."""
BASELINE_COLOR = "0.55"
WORST_SHOWN = 5.0
"""Nat below the best method: what is worse is an arrow with its number, or it would flatten all others."""
ROW_HEIGHT = 0.3
"""Inches for each method."""


def density_table_figure(table: DensityTable) -> Figure:
    """Table I: for each method the mean log density, with its interval, and the mean density of held-out motion.

    Our methods are coloured, the baselines grey.
    """
    blocks: list[tuple[str, str, list[DensityScore | None]]] = [
        ("Direction", "1/rad", [row.direction for row in table.methods]),
        ("Speed", "s/m", [row.speed for row in table.methods]),
        ("Direction and speed", "s/(m rad)", [row.joint for row in table.methods]),
    ]
    depth = ROW_HEIGHT * (len(table.methods) + 1)
    figure = Figure(figsize=(11.0, 2.0 * depth + 1.9), dpi=DOTS_PER_INCH, layout="constrained")
    panels = figure.subplots(2, len(blocks), sharey=True)
    for (title, unit, scores), (upper, lower) in zip(blocks, panels.T, strict=True):
        best = max((score.mean_log.value for score in scores if score is not None), default=0.0)
        logs = [None if score is None else score.mean_log for score in scores]
        _draw_scores(upper, table, logs, least=best - WORST_SHOWN)
        means = [None if score is None else _without_interval(score.mean) for score in scores]
        _draw_scores(lower, table, means, least=0.0)
        upper.set(xlabel=f"mean log density [nat], density in {unit}")
        upper.set_xlim(left=max(upper.get_xlim()[0], best - 1.05 * WORST_SHOWN))
        lower.set(xlabel=f"mean density [{unit}]", xlim=(-0.05 * lower.get_xlim()[1], None))
        upper.set_title(title, loc="left", fontsize=LARGE)
    for axes in panels[:, 0]:
        axes.set_yticks(range(len(table.methods)), [row.name for row in table.methods], fontsize=NORMAL)
        axes.set_ylim(len(table.methods) - 0.5, -0.5)
    folds = f"{table.n_folds} {'fold' if table.n_folds == 1 else 'folds'}"
    figure.suptitle(
        f"{table.n_held_out:,} rows held out by {table.split_by} of {table.n_rows:,} rows and {table.n_vehicles:,} "
        f"vehicles, in {folds}; right is better, whiskers: 95 % over {clusters(table)}",
        fontsize=NORMAL,
    )
    return figure


def _without_interval(value: float) -> Interval:
    return Interval(value, value, value, 0)


def cue_table_figure(table: CueTable) -> Figure:
    """Table II: the log density that prior, observation and posterior give to what vehicles did next."""
    figure = Figure(figsize=(7.0, 3.4), dpi=DOTS_PER_INCH, layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    kinds = (
        ("Observed: usual direction of the cell before", table.cell_before),
        ("Observed: own course", table.own_course),
    )
    for panel, (title, score) in zip(axes, kinds, strict=True):
        found = [of.mean_log for of in (table.prior, score.observation, score.posterior)]
        drawn = panel.bar(
            ["prior", "observation", "posterior"], [log.value for log in found], width=0.6,
            yerr=np.nan_to_num([log.half_width for log in found]), color=[OTHER_COLOR, BASELINE_COLOR, FOCUS_COLOR],
        )  # fmt: skip
        panel.bar_label(drawn, fmt="%.2f", fontsize=SMALL, padding=2)
        gain = score.log_gain
        panel.set_title(
            f"{title}\nthe prior adds {gain.value:+.2f} nat ({gain.low:.2f} to {gain.high:.2f}) a step",
            loc="left", fontsize=NORMAL,
        )  # fmt: skip
        open_frame(panel)
        panel.tick_params(axis="x", labelsize=NORMAL, length=0)
    axes[0].set_ylabel("mean log density of the truth [nat]")
    return figure


def _draw_scores(axes: Axes, table: DensityTable, scores: list[Interval | None], *, least: float) -> None:
    """A dot for each method that has such a score, with its interval; an arrow for one that is below `least`."""
    for row, (method, score) in enumerate(zip(table.methods, scores, strict=True)):
        if score is None:
            continue
        color = FOCUS_COLOR if method.name.startswith(OURS) else BASELINE_COLOR
        mean, half = score.value, np.nan_to_num(score.half_width)
        shown = max(mean, least)
        if mean >= least:
            axes.errorbar(mean, row, xerr=half, fmt="o", color=color, markersize=5, linewidth=1.2)
        else:
            axes.plot(least, row, "<", color=color, markersize=6)
        label = f"{mean:.3g}" if abs(mean) < 1 else f"{mean:.2f}"
        axes.annotate(label, (shown, row), (0, 5), textcoords="offset points", ha="center", fontsize=SMALL - 1)
    axes.grid(axis="x", color="0.9", linewidth=0.6)
    axes.set_axisbelow(True)
    dress(axes)
