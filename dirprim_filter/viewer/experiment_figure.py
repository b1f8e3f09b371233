"""A tracking experiment as a figure for papers: error by time unseen, reliability, error by place and by method."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from dirprim_filter.arrays import FloatArray
from dirprim_filter.evaluation.error_curves import SHARES, by_place, by_sight, by_time, reliability
from dirprim_filter.evaluation.intervals import Interval
from dirprim_filter.evaluation.tracking import SMOOTHED_SUFFIX, TrackingTable, hota_of
from dirprim_filter.viewer.figures import DOTS_PER_INCH, FAINT, INK, NORMAL, PAD, SMALL

SIZE = (14.0, 3.4)
"""Inches: four panels side by side."""
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#F0E442")
"""Of Okabe and Ito (2008); a method and its smoother have the same."""


def experiment_figure(table: TrackingTable) -> Figure:
    """Four panels, a colour for each method; bars are 95 % intervals over vehicles or groups. `curves` has their data.

    RMSE by how long a vehicle was unseen; the share of true positions in ellipses that should hold so many, in gaps
    (without gaps in sight); where on the map the first method errs, likewise; RMSE in sight and in gaps by method,
    without ids HOTA.
    """
    figure = Figure(figsize=SIZE, dpi=DOTS_PER_INCH, layout=ConstrainedLayoutEngine(w_pad=PAD, h_pad=PAD))
    times, reliable, places, methods = figure.subplots(1, 4)
    styles = _styles([method.name for method in table.methods])
    _draw_times(times, table, styles)
    _draw_reliability(reliable, table, styles)
    _draw_places(figure, places, table)
    _draw_methods(methods, table, styles)
    for axes in figure.axes:
        axes.tick_params(color=FAINT, labelsize=SMALL)
        axes.spines[:].set_color(FAINT)
    handles, labels = times.get_legend_handles_labels()
    columns = min(len(labels), 6)
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, fontsize=SMALL, frameon=False)
    return figure


def _styles(names: Sequence[str]) -> list[dict[str, Any]]:
    """Of each method's line: a colour, dashed for smoothers, and its name."""
    own = list(dict.fromkeys(name.removesuffix(SMOOTHED_SUFFIX) for name in names))
    return [
        {
            "color": COLORS[own.index(name.removesuffix(SMOOTHED_SUFFIX)) % len(COLORS)],
            "linestyle": "--" if name.endswith(SMOOTHED_SUFFIX) else "-", "label": name.lstrip("_"),
        }
        for name in names
    ]  # fmt: skip


def _draw_times(axes: Axes, table: TrackingTable, styles: Sequence[dict[str, Any]]) -> None:
    for method, style in zip(table.methods, styles, strict=True):
        middle, found = by_time(method.errors, table.experiment.gap_s * (table.n_gaps > 0))
        axes.errorbar(
            middle, [of.value for of in found], yerr=_bars(found), marker="o", markersize=3, linewidth=1.2,
            elinewidth=0.7, **style,
        )  # fmt: skip
    axes.set_ylim(bottom=0.0)
    if not table.n_gaps:
        axes.set_xticks([0.0])
    axes.set_xlabel("time since last seen [s]", fontsize=NORMAL)
    axes.set_ylabel("RMSE [m]", fontsize=NORMAL)


def _draw_reliability(axes: Axes, table: TrackingTable, styles: Sequence[dict[str, Any]]) -> None:
    axes.plot([0.0, 1.0], [0.0, 1.0], color=FAINT, linewidth=0.8)
    for method, style in zip(table.methods, styles, strict=True):
        axes.plot(SHARES, reliability(method.errors, SHARES, is_hidden=table.n_gaps > 0), linewidth=1.2, **style)
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0), aspect="equal")
    where = "in gaps" if table.n_gaps else "in sight"
    axes.set_xlabel(f"share that a region should hold, {where}", fontsize=NORMAL)
    axes.set_ylabel("share of true positions in it", fontsize=NORMAL)


def _draw_places(figure: Figure, axes: Axes, table: TrackingTable) -> None:
    first = table.methods[0]
    (east, north), error = (column.T for column in by_place(first.errors, is_hidden=table.n_gaps > 0))
    most = float(np.quantile(error, 0.95)) if error.size else 1.0
    shown = axes.scatter(east, north, c=error, s=14, marker="s", linewidths=0, cmap="viridis", vmin=0.0, vmax=most)
    axes.set_aspect("equal")
    axes.set_xlabel("east [m]", fontsize=NORMAL)
    axes.set_ylabel("north [m]", fontsize=NORMAL)
    bar = figure.colorbar(shown, ax=axes, extend="max", shrink=0.8)
    where = "in gaps" if table.n_gaps else "in sight"
    bar.set_label(f"RMSE of {first.name.lstrip('_')}, {where} [m]", fontsize=SMALL)


def _draw_methods(axes: Axes, table: TrackingTable, styles: Sequence[dict[str, Any]]) -> None:
    row = np.arange(len(table.methods))[::-1]
    for method, style, at in zip(table.methods, styles, row.tolist(), strict=True):
        if not table.experiment.with_ids:
            _draw_point(axes, hota_of(table, method), at, style["color"], style["color"])
            continue
        in_sight, in_gaps = by_sight(method.errors).values()
        _draw_point(axes, in_sight, at + 0.15, style["color"], "white")
        _draw_point(axes, in_gaps, at - 0.15, style["color"], style["color"])
    axes.set_yticks(row, [style["label"] for style in styles])
    axes.set_ylim(-0.6, len(row) - 0.4)
    text = "RMSE [m], hollow in sight, full in gaps" if table.experiment.with_ids else "HOTA"
    axes.set_xlabel(text, fontsize=NORMAL, color=INK)


def _draw_point(axes: Axes, found: Interval, at: float, color: str, face: str) -> None:
    axes.errorbar(
        [found.value], [at], xerr=_bars([found]), marker="o", markersize=4, color=color, markerfacecolor=face,
        elinewidth=0.8, linestyle="none",
    )  # fmt: skip


def _bars(found: Sequence[Interval]) -> FloatArray:
    """(n,) half widths; 0 where an interval is unknown."""
    return np.nan_to_num(np.array([of.half_width for of in found], np.float64))
