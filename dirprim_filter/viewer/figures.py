"""Figures for papers and pages: the learned map, and what tracking with it looks like.

Drawn through matplotlib's objects and never through pyplot: nothing global changes and no window opens.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle, Wedge
from matplotlib.ticker import MaxNLocator

from dirprim_filter.estimates import Estimates, TrackedFrame
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer import shapes
from dirprim_filter.viewer.colors import direction_color
from dirprim_filter.viewer.layers import (
    CONFIDENCE,
    FOCUS_COLOR,
    INK,
    OTHER_COLOR,
    draw_estimates,
    draw_forecast,
    draw_frame,
    draw_map,
    draw_particles,
    draw_tracks,
)
from tessellation.arrays import FloatArray

Forecasts = Mapping[str, FloatArray]
"""Sampled futures by track id, (n_samples, n_steps, 2) metres each."""

DOTS_PER_INCH = 160
MAP_WIDTH = 6.5
"""Inches across a map; as tall as the map asks for."""
BUSY_SHARE = 0.6
"""The demo shows the square that holds this share of the traffic."""
WAY_S = 5.0
"""Seconds of the way that vehicles have come, in the demo."""
CLOSE_UP = 3.0
"""Metres from the vehicle to the border of the close-up of its particles, at least."""


def map_figure(
    primitives: PrimitiveMap,
    *,
    tracks: Tracks | None = None,
    estimates: Estimates | None = None,
    forecasts: Forecasts | None = None,
) -> Figure:
    """The learned map: cells, and roses coloured by mean speed.

    Args:
        primitives: the map.
        tracks: what it was learned from, as thin lines underneath.
        estimates: tracked vehicles, as lines.
        forecasts: sampled futures.
    """
    box = shapes.map_extent(primitives)
    width, depth = box[1] - box[0]
    height = float(np.clip(MAP_WIDTH * depth / width, 2.0, 9.0))
    figure = Figure(figsize=(MAP_WIDTH + 1.5, height + 0.6), dpi=DOTS_PER_INCH, layout="compressed")
    axes = figure.add_subplot()
    colors = draw_map(axes, primitives)
    if tracks is not None:
        draw_tracks(axes, tracks)
    if estimates is not None:
        draw_estimates(axes, estimates, {})
    for paths in (forecasts or {}).values():
        draw_forecast(axes, paths, FOCUS_COLOR, opacity=0.4)
    _dress(axes, box)
    bar = figure.colorbar(colors, ax=axes, label="mean speed [m/s]", shrink=0.6, pad=0.02)
    bar.ax.tick_params(labelsize=8, color="0.6")
    bar.outline.set_visible(False)
    return figure


def demo_figure(
    primitives: PrimitiveMap,
    *,
    tracks: Tracks,
    frame: TrackedFrame,
    estimates: Estimates,
    truth: Tracks | None = None,
    forecasts: Forecasts | None = None,
    focus: str | None = None,
) -> Figure:
    """What was learned, and one vehicle tracked with it.

    Args:
        primitives: the map.
        tracks: what it was learned from.
        frame: the instant shown on the right.
        estimates: of the whole log: the way that the vehicles have come.
        truth: where the vehicles truly were.
        forecasts: sampled futures from `frame` on.
        focus: the vehicle shown; the first of the forecasts, else of the frame, if absent.

    Raises:
        ValueError: the frame holds no vehicle, or not that one.
    """
    forecasts = forecasts or {}
    row = _focus_row(frame, forecasts, focus)
    name = str(frame.estimates.track_id[row])
    color = {name: FOCUS_COLOR}
    figure = Figure(figsize=(13.0, 5.0), dpi=DOTS_PER_INCH)
    window = _window(primitives, frame.estimates.position[row])
    learned = _add_axes(figure, (0.62, 0.5, 4.2, 4.2))
    colors = draw_map(learned, primitives)
    draw_tracks(learned, tracks)
    _dress(learned, window)
    learned.set_title("(a)  Learned: how vehicles move at each place", loc="left", fontsize=10)

    tracked = _add_axes(figure, (5.02, 0.5, 4.2, 4.2))
    draw_map(tracked, primitives, opacity=0.3)
    draw_estimates(tracked, _recent(estimates, frame.time_ns), color)
    for other, paths in _from_here(forecasts, frame.estimates).items():
        draw_forecast(tracked, paths, color.get(other, OTHER_COLOR), opacity=0.5 if other == name else 0.15)
    draw_frame(tracked, frame, truth, color, marker=3.5)
    _dress(tracked, window)
    tracked.set(ylabel="", yticklabels=[])
    tracked.set_title(f"(b)  Tracked: vehicle {name} and its futures", loc="left", fontsize=10)

    close_up = _add_axes(figure, (9.45, 2.25, 2.45, 2.45))
    _draw_close_up(close_up, primitives, frame, truth, row)
    _mark(tracked, close_up, "c")
    _draw_wheel(_add_axes(figure, (12.02, 3.9, 0.8, 0.8)))
    _draw_key(_add_axes(figure, (9.45, 0.85, 3.4, 1.25)), has_truth=truth is not None)
    bar = figure.colorbar(colors, cax=_add_axes(figure, (9.45, 0.53, 2.45, 0.12)), orientation="horizontal")
    bar.set_label("mean speed in (a) [m/s]", fontsize=9, labelpad=2)
    bar.ax.tick_params(labelsize=8, color="0.6", pad=2)
    bar.outline.set_visible(False)
    return figure


def save_figure(figure: Figure, path: Path, *, force: bool = False) -> None:
    """Write a figure in the format of the path's suffix; under a temporary name until it is whole.

    Raises:
        FileExistsError: the file exists and `force` is not given.
        ValueError: a suffix that is no format of matplotlib.
    """
    if path.exists() and not force:
        raise FileExistsError(f"{path}: exists already; overwrite it with --force or choose another name")
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.stem}.part{path.suffix}")
    figure.savefig(part)
    part.replace(path)


# --- The panels ----------------------------------------------------------------------------------------


def _draw_close_up(axes: Axes, primitives: PrimitiveMap, frame: TrackedFrame, truth: Tracks | None, row: int) -> None:
    estimates = frame.estimates
    draw_map(axes, primitives, opacity=0.12)
    draw_particles(axes, frame.particles, row)
    draw_frame(axes, frame, truth, {str(estimates.track_id[row]): FOCUS_COLOR}, marker=5.5)
    half_axes, _ = shapes.covariance_axes(estimates.covariance[row], probability=CONFIDENCE)
    half = max(CLOSE_UP, 1.3 * float(half_axes.max()))
    box = estimates.position[row] + half * np.array([[-1.0], [1.0]])
    axes.set(xlim=box[:, 0], ylim=box[:, 1], aspect="equal", xticks=[], yticks=[])
    axes.set_title("(c)  Its particles", loc="left", fontsize=10)
    west, south = box[0] + 0.12 * half
    axes.plot([west, west + 1.0], [south, south], color=INK, linewidth=2.0, solid_capstyle="butt")
    axes.text(west + 0.5, south + 0.05 * half, "1 m", ha="center", va="bottom", fontsize=8)


def _mark(axes: Axes, close_up: Axes, letter: str) -> None:
    """A frame around what another panel shows closer."""
    west, east = close_up.get_xlim()
    south, north = close_up.get_ylim()
    axes.add_patch(
        Rectangle((west, south), east - west, north - south, fill=False, color=INK, linewidth=0.8, zorder=11)
    )
    axes.annotate(f"({letter})", (east, north), (3, 3), textcoords="offset points", fontsize=8, va="center", zorder=11)


def _draw_key(axes: Axes, *, has_truth: bool) -> None:
    """What the marks mean."""
    focus: dict[str, Any] = {"color": FOCUS_COLOR, "markeredgecolor": "white"}
    marks = [
        Line2D([], [], linewidth=1.6, marker="o", label=f"estimate, 90 % region, last {WAY_S:g} s", **focus),
        Line2D([], [], linewidth=0.7, marker=".", color=FOCUS_COLOR, label="its sampled futures"),
        Line2D([], [], linewidth=1.6, marker="o", color=OTHER_COLOR, markeredgecolor="white", label="other vehicles"),
        Line2D([], [], linewidth=0, marker="x", color=INK, label="detection"),
    ]
    if has_truth:
        marks.append(Line2D([], [], linewidth=0.9, color=INK, label="true vehicle"))
    axes.legend(
        handles=marks, loc="upper left", frameon=False, borderpad=0.0, borderaxespad=0.0, fontsize=9, labelspacing=0.65
    )
    axes.axis("off")


def _draw_wheel(axes: Axes) -> None:
    """A ring with the colours of direction."""
    edges = np.linspace(-180.0, 180.0, 73)
    wedges = [Wedge((0, 0), 1.0, start, end + 0.5, width=0.35) for start, end in pairwise(edges)]
    colors = direction_color(np.radians(0.5 * (edges[1:] + edges[:-1]))) / 255.0
    axes.add_collection(PatchCollection(wedges, facecolors=colors, linewidths=0))
    for letter, x, y in (("N", 0.0, 0.36), ("E", 0.36, 0.0), ("S", 0.0, -0.36), ("W", -0.36, 0.0)):
        axes.text(x, y, letter, ha="center", va="center", fontsize=6, color=INK)
    axes.set(xlim=(-1.05, 1.05), ylim=(-1.05, 1.05), aspect="equal")
    axes.text(0.0, -1.2, "their\ndirection", ha="center", va="top", fontsize=8)
    axes.axis("off")


def _add_axes(figure: Figure, box: tuple[float, float, float, float]) -> Axes:
    """Axes at (left, bottom, width, height) in inches."""
    width, height = figure.get_size_inches()
    return figure.add_axes((box[0] / width, box[1] / height, box[2] / width, box[3] / height))


def _dress(axes: Axes, box: FloatArray) -> None:
    axes.set(xlim=box[:, 0], ylim=box[:, 1], aspect="equal", xlabel="east [m]", ylabel="north [m]")
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.yaxis.set_major_locator(MaxNLocator(6))
    axes.tick_params(color="0.6", labelsize=8)
    axes.spines[:].set_color("0.6")


# --- What is chosen ------------------------------------------------------------------------------------


def _focus_row(frame: TrackedFrame, forecasts: Forecasts, focus: str | None) -> int:
    names = [str(name) for name in frame.estimates.track_id]
    wanted = focus if focus is not None else next((n for n in forecasts if n in names), next(iter(names), None))
    if wanted not in names:
        raise ValueError(f"focus: vehicle {wanted} is not among the frame's {len(names)}")
    return names.index(wanted)


def _window(primitives: PrimitiveMap, position: FloatArray) -> FloatArray:
    """The busy square (2, 2), moved so far that a vehicle stands well inside."""
    box = shapes.busy_box(primitives, share=BUSY_SHARE)
    free = 0.25 * (box[1] - box[0])
    shift = np.minimum(0.0, position - (box[0] + free)) + np.maximum(0.0, position - (box[1] - free))
    return np.asarray(box + shift)


def _from_here(forecasts: Forecasts, estimates: Estimates) -> Forecasts:
    """Forecasts begin one step ahead; these begin at the vehicle, where it is known."""
    place = {str(name): position for name, position in zip(estimates.track_id, estimates.position, strict=True)}
    return {
        name: np.insert(paths, 0, place[name], axis=1) if name in place else paths for name, paths in forecasts.items()
    }


def _recent(estimates: Estimates, time_ns: int) -> Estimates:
    """Of the last `WAY_S` before an instant."""
    age_ns = time_ns - estimates.time_ns
    kept = (age_ns >= 0) & (age_ns <= WAY_S * 1e9)
    return Estimates(**{f.name: getattr(estimates, f.name)[kept] for f in fields(Estimates)})
