"""What was learned, and one vehicle tracked with it: the picture that `dirprim demo` ends with."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dirprim_filter.arrays import BoolArray, FloatArray
from dirprim_filter.drawing import shapes
from dirprim_filter.estimates import Estimates, TrackedFrame
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer.figures.map import BUSY_SHARE, Forecasts
from dirprim_filter.viewer.figures.page import DOTS_PER_INCH, add_axes, dress_map, mark_close_up
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
    draw_wheel,
)

WAY_S = 5.0
"""Seconds of the way that vehicles have come, in the demo."""
IN_SIGHT_S = 0.5
"""Vehicles that were not seen for longer are left out."""
CLOSE_UP = 3.0
"""Metres from the vehicle to the border of the close-up of its particles, at least."""


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
        forecasts: rollouts from `frame` on.
        focus: the vehicle shown; the first of the forecasts, else of the frame, if absent.

    Raises:
        ValueError: the frame holds no vehicle, or not that one.
    """
    forecasts = forecasts or {}
    row = _focus_row(frame, forecasts, focus)
    seen = replace(frame, estimates=frame.estimates[_in_sight(frame.estimates, row)])
    name = str(frame.estimates.track_id[row])
    color = {name: FOCUS_COLOR}
    figure = Figure(figsize=(13.0, 5.0), dpi=DOTS_PER_INCH)
    window = _window(primitives, frame.estimates.position[row])
    learned = add_axes(figure, (0.62, 0.5, 4.2, 4.2))
    colors = draw_map(learned, primitives)
    draw_tracks(learned, tracks)
    dress_map(learned, window)
    learned.set_title("(a)  Learned: how vehicles move at each place", loc="left", fontsize=10)

    tracked = add_axes(figure, (5.02, 0.5, 4.2, 4.2))
    draw_map(tracked, primitives, opacity=0.3)
    recent = _recent(estimates, frame.time_ns)
    draw_estimates(
        tracked, recent[np.isin(recent.track_id.astype(np.str_), seen.estimates.track_id.astype(np.str_))], color
    )
    for other, paths in _from_here(forecasts, seen.estimates).items():
        draw_forecast(tracked, paths, color.get(other, OTHER_COLOR), opacity=0.5 if other == name else 0.15)
    draw_frame(tracked, seen, truth, color, marker=3.5)
    dress_map(tracked, window)
    tracked.set(ylabel="", yticklabels=[])
    tracked.set_title(f"(b)  Tracked: vehicle {name} and its rollouts", loc="left", fontsize=10)

    close_up = add_axes(figure, (9.45, 2.25, 2.45, 2.45))
    _draw_close_up(close_up, primitives, frame, truth, row)
    mark_close_up(tracked, close_up, "c")
    draw_wheel(add_axes(figure, (12.02, 3.9, 0.8, 0.8)), "their\ndirection")
    _draw_key(add_axes(figure, (9.45, 0.85, 3.4, 1.25)), has_truth=truth is not None)
    bar = figure.colorbar(colors, cax=add_axes(figure, (9.45, 0.53, 2.45, 0.12)), orientation="horizontal")
    bar.set_label("mean speed in (a) [m/s]", fontsize=9, labelpad=2)
    bar.ax.tick_params(labelsize=8, color="0.6", pad=2)
    bar.outline.set_visible(False)
    return figure


# --- The panels ----------------------------------------------------------------------------------------


def _draw_close_up(axes: Axes, primitives: PrimitiveMap, frame: TrackedFrame, truth: Tracks | None, row: int) -> None:
    estimates = frame.estimates
    draw_map(axes, primitives, opacity=0.12)
    draw_particles(axes, frame.particles.of(row))
    draw_frame(axes, frame, truth, {str(estimates.track_id[row]): FOCUS_COLOR}, marker=5.5)
    half_axes, _ = shapes.covariance_axes(estimates.covariance[row], probability=CONFIDENCE)
    half = max(CLOSE_UP, 1.3 * float(half_axes.max()))
    box = estimates.position[row] + half * np.array([[-1.0], [1.0]])
    axes.set(xlim=box[:, 0], ylim=box[:, 1], aspect="equal", xticks=[], yticks=[])
    axes.set_title("(c)  Its particles", loc="left", fontsize=10)
    west, south = box[0] + 0.12 * half
    axes.plot([west, west + 1.0], [south, south], color=INK, linewidth=2.0, solid_capstyle="butt")
    axes.text(west + 0.5, south + 0.05 * half, "1 m", ha="center", va="bottom", fontsize=8)


def _draw_key(axes: Axes, *, has_truth: bool) -> None:
    """What the marks mean."""
    focus: dict[str, Any] = {"color": FOCUS_COLOR, "markeredgecolor": "white"}
    marks = [
        Line2D([], [], linewidth=1.6, marker="o", label=f"estimate, 90 % region, last {WAY_S:g} s", **focus),
        Line2D([], [], linewidth=0.7, marker=".", color=FOCUS_COLOR, label="its rollouts"),
        Line2D([], [], linewidth=1.6, marker="o", color=OTHER_COLOR, markeredgecolor="white", label="other vehicles"),
        Line2D([], [], linewidth=0, marker="x", color=INK, label="detection"),
    ]
    if has_truth:
        marks.append(Line2D([], [], linewidth=0.9, color=INK, label="true vehicle"))
    axes.legend(
        handles=marks, loc="upper left", frameon=False, borderpad=0.0, borderaxespad=0.0, fontsize=9, labelspacing=0.65
    )
    axes.axis("off")


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


def _in_sight(estimates: Estimates, row: int) -> BoolArray:
    """Vehicles seen lately, and that in `row`: what is left of false detections is everywhere, and hides the others."""
    seen = estimates.unseen_s <= IN_SIGHT_S
    seen[row] = True
    return seen


def _from_here(forecasts: Forecasts, estimates: Estimates) -> Forecasts:
    """Forecasts of these vehicles begin one step ahead; what is returned begins at the vehicle."""
    place = {str(name): position for name, position in zip(estimates.track_id, estimates.position, strict=True)}
    return {name: np.insert(paths, 0, place[name], axis=1) for name, paths in forecasts.items() if name in place}


def _recent(estimates: Estimates, time_ns: int) -> Estimates:
    """Of the last `WAY_S` before an instant."""
    age_ns = time_ns - estimates.time_ns
    kept = (age_ns >= 0) & (age_ns <= WAY_S * 1e9)
    return estimates[kept]
