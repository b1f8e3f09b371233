"""Charts of evaluations."""

from __future__ import annotations

from matplotlib.figure import Figure

from dirprim_filter.evaluation.experiment import TrackingTable
from dirprim_filter.evaluation.forecasting import ForecastTable

PANELS = {
    "RMSE, m": {"seen": "seen_rmse", "in gaps": "hidden_rmse"},
    "90 % regions hold": {"all": "coverage_90", "in gaps": "hidden_coverage_90"},
    "GOSPA squared, m²": {"localisation": "localisation", "missed": "missed", "false": "false"},
    "identity switches": {"switches": "switches"},
}
"""Title of each panel, and the figures of a report that its bars show."""

FORECAST_PANELS = {
    "energy score, m": "energy", "best of 20, m": "best_of_20", "mean to truth, m": "fde",
    "90 % regions hold": "coverage_90",
}  # fmt: skip


def forecast_chart(table: ForecastTable) -> Figure:
    """A panel for each figure, a line for each method over the seconds ahead."""
    figure = Figure(figsize=(3.2 * len(FORECAST_PANELS), 3.4), layout="constrained")
    for axes, (title, name) in zip(figure.subplots(1, len(FORECAST_PANELS)), FORECAST_PANELS.items(), strict=True):
        for row in table.methods:
            axes.plot([s.horizon_s for s in row.horizons], [getattr(s, name) for s in row.horizons], label=row.name)
        if name == "coverage_90":
            axes.axhline(0.9, color="black", linewidth=0.8, linestyle=":")
            axes.set_ylim(0.0, 1.0)
        else:
            axes.set_ylim(bottom=0.0)
        axes.set_title(title, fontsize=10)
        axes.set_xlabel("seconds ahead")
    axes.legend(fontsize=7)
    return figure


def tracking_chart(table: TrackingTable) -> Figure:
    """A panel for each kind of figure, a group of bars for each method, whiskers for the deviation of the runs."""
    figure = Figure(figsize=(3.2 * len(PANELS), 3.4), layout="constrained")
    for axes, (title, bars) in zip(figure.subplots(1, len(PANELS)), PANELS.items(), strict=True):
        width = 0.8 / len(bars)
        for i, (label, name) in enumerate(bars.items()):
            at = [row + (i - 0.5 * (len(bars) - 1)) * width for row in range(len(table.methods))]
            means, deviations = [m.mean(name) for m in table.methods], [m.std(name) for m in table.methods]
            axes.barh(at, means, height=width, xerr=deviations, label=label, error_kw={"linewidth": 0.8})
        axes.set_yticks(range(len(table.methods)), [m.name for m in table.methods])
        axes.invert_yaxis()
        axes.set_title(title, fontsize=10)
        if len(bars) > 1:
            axes.legend(fontsize=7)
    return figure
