"""Charts of tracking and of forecasts, in colours safe for colour blindness (Okabe and Ito, 2008)."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from dirprim_filter.evaluation.forecasting import ForecastTable
from dirprim_filter.evaluation.scores import ScoreTable
from dirprim_filter.evaluation.tracking import TrackingTable
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
FORECAST_PANELS = {"energy score, m": "energy", "mean to truth, m": "fde", "90 % regions hold": "coverage_90"}
COVERAGE = {"90 % regions hold": 0.9}
"""Where the values of a panel should be."""
OVER_LINES = withStroke(linewidth=2.5, foreground="white")
"""Keeps numbers legible where a line passes under them."""
COLORS = ("#0072B2", "#E69F00", "#999999", "#56B4E9", "#CC79A7", "#009E73")
Bars = Mapping[str, list[tuple[float, float]]]
"""By label a value and half the length of its whisker for each method."""


def forecast_chart(table: ForecastTable) -> Figure:
    """A panel for each figure, a bar for each method and horizon; whiskers are 95 % intervals."""
    methods, labels = table.methods, [f"{at.horizon_s:g} s" for at in table.methods[0].horizons]
    panels = {
        title: {label: [(getattr(m.horizons[k], name), 0.0) for m in methods] for k, label in enumerate(labels)}
        for title, name in FORECAST_PANELS.items()
    }
    panels[f"{methods[0].name} is ahead by, %"] = {
        label: [(100.0 * m.horizons[k].gain.value, 100.0 * m.horizons[k].gain.half_width) for m in methods]
        for k, label in enumerate(labels)
    }
    return _bar_chart([m.name for m in methods], panels)


def tracking_chart(table: TrackingTable) -> Figure:
    """A panel for each kind of figure, a group of bars for each method, whiskers for the deviation of the runs."""
    methods = table.methods
    return _report_chart([m.name for m in methods], lambda name: [(m.mean(name), m.std(name)) for m in methods])


def score_chart(table: ScoreTable) -> Figure:
    """A panel for each kind of figure, a group of bars for each tracker."""
    scores = table.scores
    return _report_chart([s.name for s in scores], lambda name: [(getattr(s.report, name), 0.0) for s in scores])


def _report_chart(names: list[str], figures: Callable[[str], list[tuple[float, float]]]) -> Figure:
    """The figures of a report; `figures`: of a figure's name."""
    panels = {title: {label: figures(name) for label, name in bars.items()} for title, bars in PANELS.items()}
    return _bar_chart(names, panels)


def _bar_chart(names: list[str], panels: Mapping[str, Bars]) -> Figure:
    """A panel for each kind of figure; names stand at the left once."""
    n_bars = max(len(bars) for bars in panels.values())
    figure = new_figure(1.7 * len(panels), 2.0 * (1.1 + 0.14 * max(n_bars, 3) * len(names)))
    grid = figure.subplots(2, len(panels) // 2, sharey=True)
    for axes, (title, bars) in zip(grid.flat, panels.items(), strict=True):
        width, ends = 0.8 / len(bars), np.zeros(1)
        for i, (label, of_each) in enumerate(bars.items()):
            at = np.arange(len(names)) + (i - 0.5 * (len(bars) - 1)) * width
            values, spread = np.array(of_each, dtype=np.float64).T
            known, spread = np.nan_to_num(values), np.nan_to_num(spread)
            drawn = axes.barh(
                at, values, width, xerr=spread if spread.any() else None, label=label, color=COLORS[i % len(COLORS)],
                error_kw={"linewidth": 0.8},
            )  # fmt: skip
            numbers = ["" if np.isnan(value) else f"{value:.2f}" for value in values]
            axes.bar_label(drawn, numbers, fontsize=SMALL, padding=3, path_effects=[OVER_LINES], zorder=5)
            ends = np.concatenate([ends, known - spread, known + spread])
        if title in COVERAGE:
            axes.axvline(COVERAGE[title], color="0.3", linewidth=0.8, linestyle=":")
        axes.set_yticks(range(len(names)), names)
        axes.set_xlim(1.24 * ends.min(), 1.24 * max(ends.max(), 1.0))  # a number beside the longest bar
        dress(axes, title, is_open=True)
        axes.tick_params(axis="y", labelsize=NORMAL)
        if len(bars) > 1:
            axes.legend(fontsize=SMALL, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=4)
    grid[0, 0].invert_yaxis()
    return figure
