"""Charts of tracking and of forecasts, in colours safe for colour blindness (Okabe and Ito, 2008)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from dirprim_filter.evaluation.experiment import TrackingTable
from dirprim_filter.evaluation.forecasting import ForecastTable
from dirprim_filter.evaluation.scores import ScoreTable
from dirprim_filter.viewer.figures.page import NORMAL, SMALL, dress, new_figure

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
COVERAGE = {"90 % regions hold": 0.9}
"""Where the values of a panel should be."""
AIM = {"color": "0.3", "linewidth": 0.8, "linestyle": ":"}
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
    figure = new_figure(7.6, 6.4)
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
        if title in COVERAGE:
            axes.axhline(COVERAGE[title], **AIM)
            axes.set_ylim(0.0, 1.0)
        elif name != "gain":
            axes.set_ylim(bottom=0.0)
        axes.set_xlabel("seconds ahead")
        dress(axes, title.replace("first", table.methods[0].name), is_open=True)
    lines = figure.axes[0].get_legend_handles_labels()
    figure.legend(*lines, loc="outside lower center", ncols=4, fontsize=SMALL, frameon=False)
    return figure


def tracking_chart(table: TrackingTable) -> Figure:
    """A panel for each kind of figure, a group of bars for each method, whiskers for the deviation of the runs."""
    methods = table.methods
    return _bar_chart([m.name for m in methods], lambda name: [(m.mean(name), m.std(name)) for m in methods])


def score_chart(table: ScoreTable) -> Figure:
    """A panel for each kind of figure, a group of bars for each tracker."""
    scores = table.scores
    return _bar_chart([s.name for s in scores], lambda name: [(getattr(s.report, name), 0.0) for s in scores])


def _bar_chart(names: list[str], figures: Callable[[str], list[tuple[float, float]]]) -> Figure:
    """The panels of bars; `figures`: value and deviation of a figure, one for each name."""
    figure = new_figure(10.2, 2.0 * (1.1 + 0.42 * len(names)))
    grid = figure.subplots(2, 3, sharey=True)
    for axes, (title, bars) in zip(grid.flat, PANELS.items(), strict=True):
        width = 0.8 / len(bars)
        ends = np.zeros(1)
        for i, (label, name) in enumerate(bars.items()):
            at = np.arange(len(names)) + (i - 0.5 * (len(bars) - 1)) * width
            values, spread = np.array(figures(name), dtype=np.float64).T
            spread = np.nan_to_num(spread)
            error = spread if spread.any() else None
            drawn = axes.barh(
                at, values, width, xerr=error, label=label, color=BAR_COLORS[i], error_kw={"linewidth": 0.8}
            )
            numbers = ["" if np.isnan(value) else f"{value:.2f}" for value in values]
            axes.bar_label(drawn, numbers, fontsize=SMALL, padding=3, path_effects=[OVER_LINES], zorder=5)
            known = np.nan_to_num(values)
            ends = np.concatenate([ends, known - spread, known + spread])
        if title in COVERAGE:
            axes.axvline(COVERAGE[title], **AIM)
        axes.set_yticks(range(len(names)), names)
        axes.set_xlim(1.24 * ends.min(), 1.24 * max(ends.max(), 1.0))  # a number beside the longest bar
        dress(axes, title, is_open=True)
        axes.tick_params(axis="y", labelsize=NORMAL)
        if len(bars) > 1:
            axes.legend(fontsize=SMALL, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=len(bars))
    grid[0, 0].invert_yaxis()
    return figure
