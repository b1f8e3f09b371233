"""A tracking experiment as a figure for papers: error by time unseen, reliability, error by place and by method."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from dirprim_filter.arrays import FloatArray
from dirprim_filter.evaluation.error_curves import curves
from dirprim_filter.evaluation.tracking import SMOOTHED_SUFFIX, TrackingTable
from dirprim_filter.viewer.figures import FAINT, INK, SMALL, STYLE

COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#F0E442")
"""Of Okabe and Ito (2008); a method and its smoother have the same."""


@rc_context(STYLE)
def experiment_figure(table: TrackingTable) -> Figure:
    """Four panels, a colour for each method; bars are 95 % intervals over vehicles or groups. `curves` has their data.

    RMSE by how long a vehicle was unseen; the share of true positions in ellipses that should hold so many, in gaps
    (without gaps in sight); where on the map the first method errs, likewise; RMSE in sight and in gaps by method,
    without ids HOTA.
    """
    figure = Figure(figsize=(14.0, 3.4))
    times, reliable, places, methods = figure.subplots(1, 4)
    rows: dict[tuple[str, str], list[Sequence[Any]]] = {}
    for panel, name, *numbers in curves(table):
        rows.setdefault((str(panel), str(name)), []).append(numbers)
    data = {of: np.array(numbers, np.float64).T for of, numbers in rows.items()}  # (5, k) x, y, value, low and high
    own = list(dict.fromkeys(method.name.removesuffix(SMOOTHED_SUFFIX) for method in table.methods))
    styles = {  # of each method's line: a colour, dashed for smoothers, and its name
        name: {
            "color": COLORS[own.index(name.removesuffix(SMOOTHED_SUFFIX)) % len(COLORS)],
            "linestyle": "--" if name.endswith(SMOOTHED_SUFFIX) else "-", "label": name.lstrip("_"),
        }
        for name in (method.name for method in table.methods)
    }  # fmt: skip
    where, names = "in gaps" if table.n_gaps else "in sight", list(styles)
    reliable.plot([0.0, 1.0], [0.0, 1.0], color=FAINT, linewidth=0.8)
    for row, (name, style) in enumerate(styles.items()):
        of, color = data["time", name], style["color"]
        times.errorbar(of[0], of[2], yerr=_bars(of), marker="o", markersize=3, linewidth=1.2, elinewidth=0.7, **style)
        share, _, held, *_ = data["reliability", name]
        reliable.plot(share, held, linewidth=1.2, **style)
        for of in data["method", name].T[:, :, None]:
            methods.errorbar(
                of[2], row + np.nan_to_num(0.15 * (2.0 * of[0] - 1.0)), xerr=_bars(of), marker="o", markersize=4,
                color=color, markerfacecolor="white" if of[0] == 0 else color, elinewidth=0.8, linestyle="none",
            )  # fmt: skip
    times.set_ylim(bottom=0.0)
    if not table.n_gaps:
        times.set_xticks([0.0])
    times.set(xlabel="time since last seen [s]", ylabel="RMSE [m]")
    reliable.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0), aspect="equal", ylabel="share of true positions in it")
    reliable.set_xlabel(f"share that a region should hold, {where}")
    east, north, error, *_ = data.get(("map", names[0]), np.empty((5, 0)))
    most = float(np.quantile(error, 0.95)) if error.size else 1.0
    shown = places.scatter(east, north, c=error, s=14, marker="s", linewidths=0, cmap="viridis", vmin=0.0, vmax=most)
    places.set(aspect="equal", xlabel="east [m]", ylabel="north [m]")
    what = f"RMSE of {names[0].lstrip('_')}, {where} [m]"
    figure.colorbar(shown, ax=places, extend="max", shrink=0.8).set_label(what, fontsize=SMALL)
    methods.set_yticks(range(len(names)), [style["label"] for style in styles.values()])
    methods.set_ylim(len(names) - 0.4, -0.6)
    text = "RMSE [m], hollow in sight, full in gaps" if table.experiment.with_ids else "HOTA"
    methods.set_xlabel(text, color=INK)
    handles, labels = times.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 6))
    return figure


def _bars(of: FloatArray) -> FloatArray:
    """(2, k) how far intervals reach below and above values; 0 where they are unknown."""
    _, _, value, low, high = of
    return np.asarray(np.nan_to_num(np.stack([value - low, high - value])))
