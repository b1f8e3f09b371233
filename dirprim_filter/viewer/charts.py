"""Bar charts of evaluations."""

from __future__ import annotations

from matplotlib.figure import Figure

from dirprim_filter.evaluation.experiment import TrackingTable

PANELS = {
    "RMSE, m": {"seen": "seen_rmse", "in gaps": "hidden_rmse"},
    "90 % regions hold": {"all": "coverage_90", "in gaps": "hidden_coverage_90"},
    "GOSPA squared, m²": {"localisation": "localisation", "missed": "missed", "false": "false"},
    "identity switches": {"switches": "switches"},
}
"""Title of each panel, and the figures of a report that its bars show."""


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
