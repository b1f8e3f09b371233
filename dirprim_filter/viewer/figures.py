"""The map as a figure for papers, talks and pages: petals by speed.

Drawn through matplotlib's objects and never through pyplot: nothing global changes and no window opens. Sizes that mean
something are in metres, so that they hold at every scale; line widths are in points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from io import BytesIO
from itertools import compress
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.course import Ways
from dirprim_filter.drawing import shapes
from dirprim_filter.drawing.colors import speed_color
from dirprim_filter.estimates import Estimates
from dirprim_filter.partial_file import PartialFile
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks

SMALL, NORMAL = 8, 9
"""Points: numbers at ticks and keys, labels."""
INK, FAINT, CELL_GREY, TRACK_GREY = "0.15", "0.6", "0.87", "0.45"
STYLE: dict[Any, Any] = {
    "figure.dpi": 200, "figure.constrained_layout.use": True, "figure.constrained_layout.w_pad": 0.1,
    "figure.constrained_layout.h_pad": 0.1, "axes.labelsize": NORMAL, "axes.edgecolor": FAINT,
    "legend.fontsize": SMALL, "legend.frameon": False,
    **{f"{axis}tick.{name}": of for axis in "xy"
       for name, of in {"labelsize": SMALL, "color": FAINT, "labelcolor": "black"}.items()},
}  # fmt: skip
"""Of all figures, as they are made and as they are saved; what is around their panels finds its own room."""
ESTIMATES_COLOR, FORECAST_COLOR = "#0072B2", "#D55E00"
"""Of Okabe and Ito (2008)."""

WIDTH, TALLEST = 7.9, 9.0
"""Inches across a figure; and the height of one that is longer north to south."""
AROUND = (1.7, 1.1)
"""Inches beside and below the map: numbers, colour bar, key."""
POLAR = np.array([(x, y) for y in (5 / 6, 3 / 6, 1 / 6) for x in (1 / 6, 3 / 6, 5 / 6)])
"""Where polar plots are in their panel, as shares of its sides; they follow a path."""
POLAR_RADIUS, SHARPEST, ANGLES = 0.13, 60.0, np.linspace(-np.pi, np.pi, 361)
"""Of a polar plot as a share of the panel; its concentrations go up to 7 degrees of deviation: narrower is a line."""
NUMBERED = {"boxstyle": "circle,pad=0.15", "facecolor": "white", "edgecolor": FAINT, "linewidth": 0.6}
KEY: Mapping[str, dict[str, Any]] = {
    "cells": {"color": CELL_GREY, "linewidth": 0.8},
    "petals, where vehicles go": {"color": INK, "marker": ">", "markersize": 4, "linestyle": "none"},
    "tracks": {"color": TRACK_GREY, "linewidth": 0.5},
    "estimates, thin: coasting": {"color": ESTIMATES_COLOR, "linewidth": 1.6},
    "forecast samples": {"color": FORECAST_COLOR, "linewidth": 0.7},
}


@mpl.rc_context(STYLE)
def map_figure(
    primitives: PrimitiveMap, *, tracks: Tracks | None = None, estimates: Estimates | None = None,
    paths: FloatArray | None = None, extent: FloatArray | None = None,
) -> Figure:  # fmt: skip
    """The learned map: cells, and petals coloured by mean speed; a legend explains every kind of line.

    Where cells are small in the picture, those in a square have one rose together.

    Args:
        primitives: the map.
        tracks: what it was learned from, as thin lines underneath.
        estimates: tracked vehicles, as lines in a panel of their own.
        paths: (n_samples, n_steps, 2) metres, rollouts of a vehicle. A panel of their own has polar plots of
            p(theta | x), the map's density of direction, at places along one of them (Senanayake et al. 2020, Fig. 8):
            areas are probabilities.
        extent: (2, 2) metres, the south-west and the north-east corner to show. Default: the paths, else 99 % of
            the traffic.
    """
    if extent is not None:
        box = extent
    elif paths is not None:
        box = shapes.extent(paths.reshape(-1, 2))
        box = box.mean(axis=0) + 0.5 * np.ptp(box, axis=0).max() * np.array([[-1.0], [1.0]])
    else:
        box = shapes.map_extent(primitives, share=0.99)  # a vehicle that is far away must not make all others small
    figure, axes, inches = _page(box, n_panels=1 + (estimates is not None) + (paths is not None))
    apart = 0.27 / inches  # of nearer roses the directions could not be read
    colors = _draw_map(axes[0], primitives, spacing=float(np.ptp(box[:, 0])) * apart)
    if tracks is not None:  # observed motion, under the roses, fainter the more there is: it lies over each other
        lines = _paths(tracks.vehicle, tracks.time_ns, tracks.position)
        faint = float(np.clip(30.0 / max(len(lines), 1), 0.12, 0.5))
        axes[0].add_collection(LineCollection(lines, colors=TRACK_GREY, linewidths=0.4, alpha=faint, zorder=2))
    if estimates is not None:
        _draw_cells(axes[1], primitives)
        _draw_estimates(axes[1], estimates)
    if paths is not None:  # thin lines with a dot at their ends
        axes[0].add_collection(LineCollection(list(paths), colors=FORECAST_COLOR, linewidths=0.7, alpha=0.4, zorder=5))
        axes[0].plot(*paths[:, -1].T, ".", color=FORECAST_COLOR, markersize=3.5, alpha=0.8, markeredgewidth=0, zorder=5)
        _draw_polar(axes[0], axes[-1], primitives, paths, box)
    bar = figure.colorbar(colors, ax=list(axes), extend="max", shrink=0.6, aspect=25, label="mean speed [m/s]")
    bar.outline.set_visible(False)
    shown = (True, True, tracks is not None, estimates is not None, paths is not None)
    keys = [Line2D([], [], label=name, **style) for name, style in compress(KEY.items(), shown)]
    n_rows = -(-len(keys) // max(int(figure.get_figwidth() / 1.6), 2))  # inches, of an entry
    figure.legend(handles=keys, loc="outside lower center", ncols=-(-len(keys) // n_rows))
    return figure


def save_figure(figure: Figure, path: Path, *, force: bool = False) -> None:
    """Write a figure in the format of the path's suffix; under a temporary name until it is whole.

    The same figure gives the same bytes: no dates, no random names. Text stays text: TrueType in PDF, as publishers
    ask for, and fonts by name in SVG.

    Args:
        figure: the figure.
        path: .png, .pdf or .svg.
        force: replace an existing file.

    Raises:
        OutputExistsError: the file exists and `force` is not given.
        ValueError: the suffix is no format that matplotlib writes.
        OSError: the file cannot be written.
    """
    output, drawn = PartialFile(path, force=force), BytesIO()
    undated = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}}.get(path.suffix.lower())
    with mpl.rc_context(STYLE | {"svg.hashsalt": "dirprim", "svg.fonttype": "none", "pdf.fonttype": 42}):
        figure.savefig(drawn, metadata=undated, format=path.suffix[1:].lower())
    with output as file:
        file.write(drawn.getvalue())


def _page(box: FloatArray, *, n_panels: int) -> tuple[Figure, Sequence[Axes], float]:
    """East and north in metres, of one scale, over a box of (2, 2) corners.

    -> The page, its panels, and how wide about one is, inches.
    """
    shape = float(np.divide(*np.ptp(box, axis=0)))
    rows, columns = (n_panels, 1) if shape > 1.5 else (1, n_panels)  # of a wide box the second panel is below
    width, whole = WIDTH * (1.5 if columns > 1 else 1.0), shape * columns / rows
    height = min((width - AROUND[0]) / whole + AROUND[1], TALLEST)
    across = (height - AROUND[1]) * whole + AROUND[0]
    figure = Figure(figsize=(across, height))
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel().tolist()
    for axes in panels:
        axes.set(xlim=box[:, 0], ylim=box[:, 1], aspect="equal")
        axes.xaxis.set_major_locator(MaxNLocator(6))
        axes.yaxis.set_major_locator(MaxNLocator(6))
    for axes in panels[-columns:]:
        axes.set_xlabel("east [m]")
    for axes in panels[::columns]:
        axes.set_ylabel("north [m]")
    return figure, panels, (across - AROUND[0]) / columns


def _draw_cells(axes: Axes, primitives: PrimitiveMap) -> None:
    outlines = shapes.cell_outlines(primitives.tessellation)
    axes.add_collection(LineCollection(outlines, colors=CELL_GREY, linewidths=0.3, zorder=1))


def _draw_map(axes: Axes, primitives: PrimitiveMap, *, spacing: float) -> ScalarMappable:
    """Cells and roses, as arrows; -> the colours of speed, for a colour bar."""
    _draw_cells(axes, primitives)
    petals = shapes.rose_petals(primitives, spacing=spacing)
    fastest = shapes.fastest_speed(petals)
    color = shapes.petal_colors(petals, fastest=fastest)[:, 1] / 255.0
    color[:, 3] = np.where(petals.is_disc, 0.4, 1.0)  # standing vehicles must not hide those that go
    axes.add_collection(PolyCollection(list(petals.polygon), facecolors=color, linewidths=0, zorder=3))
    axes.add_collection(PolyCollection(list(shapes.petal_heads(petals)), facecolors=INK, linewidths=0, zorder=4))
    steps = speed_color(np.linspace(0.0, 1.0, 256), fastest=1.0) / 255.0
    return ScalarMappable(Normalize(0.0, fastest), ListedColormap(steps))


def _draw_estimates(axes: Axes, estimates: Estimates) -> None:
    """The path of each vehicle; thin and faint where it coasts."""
    usual = 1.6 if np.unique(estimates.track_id).size <= 12 else 0.8
    for coasts, width, opacity in ((False, usual, 1.0), (True, 0.3 * usual, 0.6)):
        own = estimates[estimates.is_coasting == coasts]
        axes.add_collection(LineCollection(
            _paths(own.track_id, own.time_ns, own.position), colors=ESTIMATES_COLOR, linewidths=width, alpha=opacity,
            capstyle="round", zorder=6,
        ))  # fmt: skip


def _draw_polar(axes: Axes, panel: Axes, primitives: PrimitiveMap, paths: FloatArray, box: FloatArray) -> None:
    """Numbered places along the path that is longest on the map, and in a panel the density of direction at each."""
    step = np.hypot(*np.moveaxis(np.diff(paths, axis=1), -1, 0))
    step[primitives.tessellation.cell_of(paths)[:, 1:] < 0] = 0.0
    longest = int(step.sum(axis=1).argmax())
    length = np.concatenate([[0.0], np.cumsum(step[longest])])
    at = np.linspace(0.0, length[-1], len(POLAR))
    place = np.column_stack([np.interp(at, length, of) for of in paths[longest].T])
    mixture = primitives.primitive_at(place[:, None]).direction
    drawn = replace(mixture, concentration=np.minimum(mixture.concentration, SHARPEST))
    radius = np.exp(0.5 * drawn.log_density(ANGLES))
    circle = POLAR_RADIUS * np.ptp(box, axis=0).min() * np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])
    center = box[0] + POLAR * np.ptp(box, axis=0)
    curves = center[:, None] + radius[..., None] / radius.max(axis=1)[:, None, None] * circle
    panel.add_collection(PolyCollection(list(center[:, None] + circle), facecolors="none", edgecolors=FAINT))
    panel.add_collection(PolyCollection(list(curves), facecolors=FORECAST_COLOR, edgecolors=INK, linewidths=0.6))
    panel.set_axis_off()
    ends = center + 1.2 * circle[len(ANGLES) // 8]
    for number, (there, beside) in enumerate(zip(place, ends, strict=True), 1):
        axes.text(there[0], there[1], str(number), fontsize=SMALL, ha="center", va="center", bbox=NUMBERED, zorder=8)
        panel.text(beside[0], beside[1], str(number), fontsize=SMALL, ha="center", va="center", bbox=NUMBERED)


def _paths(track_id: AnyArray, time_ns: IntArray, position: FloatArray) -> list[FloatArray]:
    """The line of each vehicle, split where it was unseen for long."""
    _, vehicle = np.unique(track_id, return_inverse=True)
    ways = Ways.of(vehicle, time_ns, position, longest_gap_s=np.inf)
    return np.split(ways.position, np.flatnonzero(np.diff(ways.first)) + 1)
