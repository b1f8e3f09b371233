"""Charts of tracking and of forecasts, in colours safe for colour blindness (Okabe and Ito, 2008)."""

from __future__ import annotations

from collections.abc import Callable
from math import isnan

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from dirprim_filter.evaluation.experiment import TrackingTable
from dirprim_filter.evaluation.forecasting import ForecastTable
from dirprim_filter.evaluation.scores import ScoreTable
from dirprim_filter.viewer.figures.page import DOTS_PER_INCH, LARGE, NORMAL, SMALL

PANELS = {
    "RMSE, m": {"all": "rmse", "in sight": "seen_rmse", "in gaps": "hidden_rmse"},
    "90 % regions hold": {"all": "coverage_90", "in gaps": "hidden_coverage_90"},
    "HOTA and its parts": {"HOTA": "hota", "DetA": "deta", "AssA": "assa"},
    "IDF1 and MOTA": {"IDF1": "idf1", "MOTA": "mota"},
    "GOSPA squared per vehicle, m²": {"localisation": "localisation", "missed": "missed", "false": "false"},
    "identity switches": {"switches": "switches"},
}
"""Title of each panel, and the figures of a report that its bars show."""

FORECAST_PANELS = {
    "energy score, m": "energy", "first is ahead by, %": "gain", "mean to truth, m": "fde",
    "90 % regions hold": "coverage_90",
}  # fmt: skip
COLUMNS = 3
"""Of panels of bars."""
COVERAGE = 0.9
COVERAGE_PANEL = "90 % regions hold"
OVER_LINES = withStroke(linewidth=2.5, foreground="white")
"""Keeps numbers legible where a line passes under them."""
BAR_COLORS = ("#0072B2", "#E69F00", "#999999")
LINE_STYLES = (
    ("#0072B2", "-", "o"), ("#D55E00", "--", "s"), ("#009E73", "-.", "^"), ("#CC79A7", ":", "D"),
    ("#E69F00", "--", "v"), ("#56B4E9", "-.", "P"), ("#000000", ":", "x"),
)  # fmt: skip
"""Colour, dashes and mark of each method's line: any one of the three identifies it."""


def forecast_chart(table: ForecastTable) -> Figure:
    """A panel for each figure, a line for each method over the seconds ahead; whiskers are 95 % intervals."""
    figure = Figure(figsize=(7.6, 6.4), dpi=DOTS_PER_INCH, layout="constrained")
    panels = figure.subplots(2, len(FORECAST_PANELS) // 2).flat
    for axes, (title, name) in zip(panels, FORECAST_PANELS.items(), strict=True):
        for k, row in enumerate(table.methods):
            color, dashes, mark = LINE_STYLES[k % len(LINE_STYLES)]
            values, error = [getattr(s, name) for s in row.horizons], None
            if name == "gain":
                values, error = [100.0 * gain.value for gain in values], [100.0 * gain.half_width for gain in values]
            axes.errorbar(
                [s.horizon_s for s in row.horizons], values, error, label=row.name, color=color, linestyle=dashes,
                marker=mark, markersize=4, elinewidth=0.8, capsize=2.0,
            )  # fmt: skip
        if title == COVERAGE_PANEL:
            axes.axhline(COVERAGE, color="0.3", linewidth=0.8, linestyle=":")
            axes.set_ylim(0.0, 1.0)
        elif name != "gain":
            axes.set_ylim(bottom=0.0)
        _dress(axes, title.replace("first", table.methods[0].name))
        axes.set_xlabel("seconds ahead")
    figure.legend(
        *figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=SMALL, frameon=False
    )
    return figure


def tracking_chart(table: TrackingTable) -> Figure:
    """A panel for each kind of figure, a group of bars for each method, whiskers for the deviation of the runs."""

    def runs(name: str) -> tuple[list[float], list[float]]:
        return [m.mean(name) for m in table.methods], [m.std(name) for m in table.methods]

    return _bar_chart([m.name for m in table.methods], runs)


def score_chart(table: ScoreTable) -> Figure:
    """A panel for each kind of figure, a group of bars for each tracker."""

    def figures(name: str) -> tuple[list[float], None]:
        return [getattr(found.report, name) for found in table.scores], None

    return _bar_chart([found.name for found in table.scores], figures)


def _bar_chart(
    names: list[str],
    figures: Callable[[str], tuple[list[float], list[float] | None]],
) -> Figure:
    """The panels of bars; `figures`: values and, where there are any, deviations of a figure, one for each name."""
    n_rows = -(-len(PANELS) // COLUMNS)
    size = (3.4 * COLUMNS, n_rows * (1.1 + 0.42 * len(names)))
    figure = Figure(figsize=size, dpi=DOTS_PER_INCH, layout="constrained")
    grid = figure.subplots(n_rows, COLUMNS, sharey=True)
    for axes, (title, bars) in zip(grid.flat, PANELS.items(), strict=True):
        width = 0.8 / len(bars)
        ends = np.zeros(1)
        for i, (label, name) in enumerate(bars.items()):
            at = [row + (i - 0.5 * (len(bars) - 1)) * width for row in range(len(names))]
            values, deviations = figures(name)
            drawn = axes.barh(
                at, values, height=width, xerr=deviations, label=label, color=BAR_COLORS[i], error_kw={"linewidth": 0.8}
            )
            numbers = ["" if isnan(value) else f"{value:.2f}" for value in values]
            axes.bar_label(drawn, numbers, fontsize=SMALL, padding=3, path_effects=[OVER_LINES], zorder=5)
            spread = np.nan_to_num(deviations) if deviations else 0.0
            ends = np.concatenate([ends, np.nan_to_num(values) - spread, np.nan_to_num(values) + spread])
        if title == COVERAGE_PANEL:
            axes.axvline(COVERAGE, color="0.3", linewidth=0.8, linestyle=":")
        axes.set_yticks(range(len(names)), names, fontsize=NORMAL)
        axes.set_xlim(1.24 * ends.min(), 1.24 * max(ends.max(), 1.0))  # a number beside the longest bar
        _dress(axes, title)
        if len(bars) > 1:
            axes.legend(fontsize=SMALL, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=len(bars))
    grid[0, 0].invert_yaxis()
    return figure


def _dress(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=LARGE)
    axes.tick_params(labelsize=SMALL)
    axes.spines[["top", "right"]].set_visible(False)
